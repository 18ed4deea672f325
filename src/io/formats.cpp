// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/formats.hpp"

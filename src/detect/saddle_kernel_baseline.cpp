// SPDX-License-Identifier: Apache-2.0
#define PLUMBLINE_PACK 4
#include "detect/saddle_kernel_body.hpp"

namespace plumbline::detail {

constinit const SaddleKernels kBaselineSaddleKernels{"baseline", &sum, &respond, &peaks};

}  // namespace plumbline::detail

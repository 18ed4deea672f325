// SPDX-License-Identifier: Apache-2.0
#define PLUMBLINE_PACK 2
#include "refine/view_kernel_body.hpp"

namespace plumbline::detail {

constexpr const Lens* kNoLens = nullptr;
constinit const KernelSet kBaselineKernels = kernels_of(kNoLens, "baseline");

}  // namespace plumbline::detail

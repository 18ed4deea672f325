// SPDX-License-Identifier: Apache-2.0
#define PLUMBLINE_PACK 4
#if defined(PLUMBLINE_X86_KERNELS)
#include "refine/view_kernel_body.hpp"

namespace plumbline::detail {

constexpr const Lens* kNoLens = nullptr;
constinit const KernelSet kAvx2Kernels = kernels_of(kNoLens, "avx2");

}  // namespace plumbline::detail
#endif

// SPDX-License-Identifier: Apache-2.0
#define PLUMBLINE_PACK 8
#if defined(PLUMBLINE_X86_KERNELS)
#include "detect/saddle_kernel_body.hpp"

namespace plumbline::detail {

constinit const SaddleKernels kAvx2SaddleKernels{"avx2", &sum, &respond, &peaks};

}  // namespace plumbline::detail
#endif

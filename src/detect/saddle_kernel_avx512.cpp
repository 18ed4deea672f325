// SPDX-License-Identifier: Apache-2.0
#define PLUMBLINE_PACK 16
#if defined(PLUMBLINE_X86_KERNELS)
#include "detect/saddle_kernel_body.hpp"

namespace plumbline::detail {

constinit const SaddleKernels kAvx512SaddleKernels{"avx512", &sum, &respond, &peaks};

}  // namespace plumbline::detail
#endif

// SPDX-License-Identifier: Apache-2.0
#include "detect/saddle_kernel.hpp"

namespace plumbline::detail {

const SaddleKernels& best_saddle_kernels() {
#ifdef PLUMBLINE_X86_KERNELS
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) return kAvx512SaddleKernels;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return kAvx2SaddleKernels;
#endif
  return kBaselineSaddleKernels;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "refine/view_kernel_sets.hpp"

namespace plumbline::test {

/// The kernels that this processor can run.
inline std::vector<const detail::KernelSet*> kernel_sets_here() {
  std::vector<const detail::KernelSet*> sets{&detail::kBaselineKernels};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) sets.push_back(&detail::kAvx2Kernels);
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"))
    sets.push_back(&detail::kAvx512Kernels);
#endif
  return sets;
}

}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

namespace plumbline {

/// Calls body(i) once for each i in [0, n) on up to `n_threads` threads (<= 0: all cores) and returns when
/// all are done. Each body writes only to what belongs to its own i, so results do not depend on the thread
/// count. The first exception that a body throws is thrown again here, after the other bodies have ended.
void parallel_for(int n, int n_threads, const std::function<void(int)>& body);

}  // namespace plumbline

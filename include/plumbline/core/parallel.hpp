// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <memory>

namespace plumbline {

/// Calls body(i) once for each i in [0, n) on up to `n_threads` threads (<= 0: all cores) and returns when
/// all are done. Each body writes only to what belongs to its own i, so results do not depend on the thread
/// count. Every body is called even when one throws; then the exception of the smallest i is thrown again
/// here. Where the system refuses a thread, fewer do the work.
void parallel_for(int n, int n_threads, const std::function<void(int)>& body);

/// Threads that stay for many short parallel loops, each as parallel_for() runs it.
class Workers {
 public:
  /// \param n_threads  the calling one included; <= 0: all cores
  explicit Workers(int n_threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  /// Not to be called from within a body.
  void run(int n, const std::function<void(int)>& body);

 private:
  struct Shared;
  std::unique_ptr<Shared> shared_;
};

}  // namespace plumbline

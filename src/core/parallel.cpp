// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace plumbline {

void parallel_for(int n, int n_threads, const std::function<void(int)>& body) {
  if (n_threads <= 0) n_threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  n_threads = std::min(n_threads, n);
  std::atomic<int> next{0};
  std::exception_ptr first_failure;  // of the smallest index, so that it does not depend on the thread count
  int first_failed = n;
  std::mutex failure_lock;
  const auto work = [&] {
    for (int i; (i = next.fetch_add(1)) < n;) {
      try {
        body(i);
      } catch (...) {
        const std::lock_guard guard(failure_lock);
        if (i < first_failed) first_failure = std::current_exception(), first_failed = i;
      }
    }
  };
  std::vector<std::thread> helpers;
  try {
    for (int t = 1; t < n_threads; ++t) helpers.emplace_back(work);
  } catch (const std::system_error&) {
    // No more threads to be had: those that run, and this one, do all of it.
  }
  work();
  for (std::thread& helper : helpers) helper.join();
  if (first_failure) std::rethrow_exception(first_failure);
}

}  // namespace plumbline

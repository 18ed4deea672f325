// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace plumbline {
namespace {

// One loop, worked on by any number of threads.
class Loop {
 public:
  Loop(int n, const std::function<void(int)>& body) : n_(n), body_(body), first_failed_(n) {}

  void work() {
    for (int i; (i = next_.fetch_add(1)) < n_;) {
      try {
        body_(i);
      } catch (...) {
        const std::lock_guard guard(failure_lock_);
        if (i < first_failed_) first_failure_ = std::current_exception(), first_failed_ = i;
      }
    }
  }
  void rethrow() const {
    if (first_failure_) std::rethrow_exception(first_failure_);
  }

 private:
  int n_;
  const std::function<void(int)>& body_;
  std::atomic<int> next_{0};
  std::exception_ptr first_failure_;  // of the smallest index, so that it does not depend on the thread count
  int first_failed_;
  std::mutex failure_lock_;
};

int threads_for(int n_threads) {
  return n_threads > 0 ? n_threads : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

}  // namespace

void parallel_for(int n, int n_threads, const std::function<void(int)>& body) {
  n_threads = std::min(threads_for(n_threads), n);
  Loop loop(n, body);
  std::vector<std::thread> helpers;
  try {
    for (int t = 1; t < n_threads; ++t) helpers.emplace_back([&] { loop.work(); });
  } catch (const std::system_error&) {
    // No more threads to be had: those that run, and this one, do all of it.
  }
  loop.work();
  for (std::thread& helper : helpers) helper.join();
  loop.rethrow();
}

namespace {

// Waking a sleeping thread takes longer than many a loop, so a thread that waits looks for a while by itself.
constexpr int kLooks = 5000;
template <class Ready>
void look_for(int looks, Ready&& ready) {
  while (looks-- > 0 && !ready()) {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
  }
}

}  // namespace

struct Workers::Shared {
  std::mutex lock;
  std::condition_variable start, done;
  Loop* loop = nullptr;
  std::atomic<unsigned> round{0};  // counts the loops, so that a thread takes part in each once
  std::atomic<int> busy{0};
  bool stop = false;
  int looks = 0;  // none where threads would take the cores from each other
  std::vector<std::thread> threads;

  void serve() {
    std::unique_lock guard(lock);
    for (unsigned seen = 0;;) {
      guard.unlock();
      look_for(looks, [&] { return round.load() != seen; });
      guard.lock();
      start.wait(guard, [&] { return stop || round != seen; });
      if (stop) return;
      seen = round;
      if (!loop) continue;  // the others were done before this one woke
      Loop* mine = loop;
      ++busy;
      guard.unlock();
      mine->work();
      guard.lock();
      if (--busy == 0) done.notify_one();
    }
  }
};

Workers::Workers(int n_threads) : shared_(std::make_unique<Shared>()) {
  if (threads_for(n_threads) <= static_cast<int>(std::thread::hardware_concurrency()))
    shared_->looks = kLooks;
  try {
    for (int t = 1; t < threads_for(n_threads); ++t)
      shared_->threads.emplace_back([shared = shared_.get()] { shared->serve(); });
  } catch (const std::system_error&) {
    // As in parallel_for().
  }
}

Workers::~Workers() {
  {
    const std::lock_guard guard(shared_->lock);
    shared_->stop = true;
  }
  shared_->start.notify_all();
  for (std::thread& thread : shared_->threads) thread.join();
}

void Workers::run(int n, const std::function<void(int)>& body) {
  Loop loop(n, body);
  if (shared_->threads.empty() || n < 2) {
    loop.work();
    loop.rethrow();
    return;
  }
  {
    const std::lock_guard guard(shared_->lock);
    shared_->loop = &loop;
    ++shared_->round;
  }
  shared_->start.notify_all();
  loop.work();
  {
    const std::lock_guard guard(shared_->lock);
    shared_->loop = nullptr;  // nobody joins any more
  }
  look_for(shared_->looks, [&] { return shared_->busy.load() == 0; });
  std::unique_lock guard(shared_->lock);
  shared_->done.wait(guard, [&] { return shared_->busy == 0; });
  guard.unlock();
  loop.rethrow();
}

}  // namespace plumbline

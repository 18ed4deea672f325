// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <glog/logging.h>

#include <mutex>
#include <utility>

namespace plumbline::detail {

/// Ceres reports failed factorisations, which it then handles, through glog on stderr. A library does not
/// print: while any solve runs, only glog's fatal messages are let through. Counted, because seeds are solved
/// on several threads.
class QuietLog {
 public:
  QuietLog() {
    const std::lock_guard lock(mutex());
    if (count()++ == 0) saved() = std::exchange(FLAGS_minloglevel, google::GLOG_FATAL);
  }
  ~QuietLog() {
    const std::lock_guard lock(mutex());
    if (--count() == 0) FLAGS_minloglevel = saved();
  }
  QuietLog(const QuietLog&) = delete;
  QuietLog& operator=(const QuietLog&) = delete;

 private:
  // Inline functions, so that all files of the library share one count.
  static std::mutex& mutex() {
    static std::mutex m;
    return m;
  }
  static int& count() {
    static int n = 0;
    return n;
  }
  static int& saved() {
    static int level = 0;
    return level;
  }
};

}  // namespace plumbline::detail

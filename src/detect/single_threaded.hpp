// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core.hpp>

namespace plumbline::detail {

/// OpenCV's own threads inside ours would only fight for the cores. Its setting is for the whole process, so
/// it is put back; it changes no result.
class OpenCvSingleThreaded {
 public:
  OpenCvSingleThreaded() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~OpenCvSingleThreaded() { cv::setNumThreads(before_); }
  OpenCvSingleThreaded(const OpenCvSingleThreaded&) = delete;
  OpenCvSingleThreaded& operator=(const OpenCvSingleThreaded&) = delete;

 private:
  int before_;
};

}  // namespace plumbline::detail

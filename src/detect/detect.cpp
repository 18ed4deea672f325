// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/detect.hpp"

#include <fmt/format.h>

#include <exception>
#include <opencv2/core.hpp>

#include "detect/finders.hpp"

namespace plumbline {
namespace {

Result<Detection> find(const cv::Mat& grey, const Target& target) {
  const auto visit = [&](const auto& spec) -> Result<Detection> {
    using Spec = std::decay_t<decltype(spec)>;
    if constexpr (std::is_same_v<Spec, Chessboard>) return detail::detect_chessboard(grey, spec);
    if constexpr (std::is_same_v<Spec, Circles>) return detail::detect_circles(grey, spec);
    if constexpr (std::is_same_v<Spec, Charuco>) return detail::detect_charuco(grey, spec);
    if constexpr (std::is_same_v<Spec, AprilGrid>) return detail::detect_aprilgrid(grey, spec);
    if constexpr (std::is_same_v<Spec, BoardRig>) return detail::detect_rig(grey, spec, target);
    return Error{ErrorCode::kUnsupported,
                 "free points cannot be found in images; give their observations as a corners file",
                 target.name};
  };
  return std::visit(visit, target.spec);
}

}  // namespace

Result<Detection> detect_target(const cv::Mat& grey, const Target& target) {
  PLUMBLINE_CHECK(!grey.empty() && grey.type() == CV_8UC1, "an 8-bit grey image is needed");
  if (std::min(grey.cols, grey.rows) < 16) {
    return Detection{{}, fmt::format("{}x{} pixels are too few to hold a target", grey.cols, grey.rows), ""};
  }
  try {
    return find(grey, target);
  } catch (const cv::Exception& e) {
    return Error{ErrorCode::kDegenerate, fmt::format("the detector failed: {}", e.err), target.name};
  }
}

}  // namespace plumbline

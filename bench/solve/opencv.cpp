// SPDX-License-Identifier: Apache-2.0
// OpenCV makes its own start; its float32 corners and boards are not counted in the time.
#include <cfloat>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "solve/tools.hpp"

namespace bench {
namespace {

using namespace plumbline;

struct Corners {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> px;
  std::vector<std::vector<cv::Point3d>> board_d;
  std::vector<std::vector<cv::Point2d>> px_d;
};

Corners corners_of(const SolveSet& set, int cam) {
  Corners out;
  for (const View& view : set.start.data.views) {
    if (view.cam != cam) continue;
    auto& b = out.board.emplace_back();
    auto& q = out.px.emplace_back();
    auto& bd = out.board_d.emplace_back();
    auto& qd = out.px_d.emplace_back();
    for (const Corner& c : view.corners) {
      const Vec3& p = set.start.data.targets[0].points[c.point];
      bd.emplace_back(p.x(), p.y(), 0);
      qd.emplace_back(c.px.x(), c.px.y());
      b.emplace_back(bd.back());
      q.emplace_back(qd.back());
    }
  }
  return out;
}

Camera camera_of(const SolveSet& set, const cv::Mat& K, const cv::Mat& D, int cam) {
  Camera camera = set.start.rig.cameras[cam];
  cv::Mat d;
  D.convertTo(d, CV_64F);
  const auto k = params(camera.lens);
  k[0] = K.at<double>(0, 0), k[1] = K.at<double>(1, 1), k[2] = K.at<double>(0, 2), k[3] = K.at<double>(1, 2);
  for (std::size_t i = 4; i < k.size(); ++i) k[i] = d.at<double>(static_cast<int>(i) - 4);
  return camera;
}

}  // namespace

std::optional<Outcome> run_opencv(SolveSet& set, bool use_lu) {
  cv::setNumThreads(1);
  const std::string lens(lens_name(set.truth.cameras[0].lens));
  const std::size_t n_cams = set.truth.cameras.size();
  if (n_cams > 2 || (n_cams == 2 && lens == "kb4")) return std::nullopt;
  const Corners left = corners_of(set, 0);
  const cv::Size size(1920, 1200);
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, DBL_EPSILON);
  const int flags = (lens == "opencv8" ? cv::CALIB_RATIONAL_MODEL : 0) | (use_lu ? cv::CALIB_USE_LU : 0);
  Outcome outcome;
  cv::Mat K, D, K2, D2, R, T, E, F;
  std::vector<cv::Mat> r, t;
  double rms = 0;
  try {
    const Stopwatch watch;
    if (lens == "kb4") {
      rms = cv::fisheye::calibrate(left.board_d, left.px_d, size, K, D, r, t,
                                   cv::fisheye::CALIB_RECOMPUTE_EXTRINSIC | cv::fisheye::CALIB_FIX_SKEW,
                                   cv::TermCriteria(criteria.type, 100, DBL_EPSILON));
      watch.stop(outcome);
    } else if (n_cams == 1) {
      rms = cv::calibrateCamera(left.board, left.px, size, K, D, r, t, flags, criteria);
      watch.stop(outcome);
    } else {
      const Corners right = corners_of(set, 1);
      const int mono = flags | cv::CALIB_USE_LU;
      cv::calibrateCamera(left.board, left.px, size, K, D, r, t, mono, criteria);
      cv::calibrateCamera(right.board, right.px, size, K2, D2, r, t, mono, criteria);
      const Stopwatch joint;  // from there, everything free
      rms = cv::stereoCalibrate(left.board, left.px, right.px, K, D, K2, D2, size, R, T, E, F,
                                flags | cv::CALIB_USE_INTRINSIC_GUESS,
                                cv::TermCriteria(criteria.type, 30, 1e-6));
      joint.stop(outcome);
    }
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
  outcome.rms_xy_px = rms / std::sqrt(2.0);
  outcome.rig = set.start.rig;
  outcome.rig.cameras[0] = camera_of(set, K, D, 0);
  return outcome;
}

}  // namespace bench

// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "outliers/outliers.hpp"
#include "plumbline/geometry/so3.hpp"

extern "C" {
#include <mrcal/mrcal.h>
}

namespace plumbline::bench {
namespace {

struct Points {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> px;
};

Points points_of(const Dataset& data) {
  Points points;
  for (const View& view : data.views) {
    points.board.emplace_back();
    points.px.emplace_back();
    for (const Corner& c : view.corners) {
      const Vec3& p = data.targets[0].points[c.point];
      points.board.back().emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 0.F);
      points.px.back().emplace_back(static_cast<float>(c.px.x()), static_cast<float>(c.px.y()));
    }
  }
  return points;
}

std::optional<Camera> camera_of(const Dataset& data, const std::string& lens, std::vector<double> k) {
  const auto made = make_lens(lens, k);
  if (!made) return std::nullopt;
  return Camera{data.cameras[0].name, data.cameras[0].size, *made};
}

mrcal_pose_t pose_of(const SE3& T) {
  const Vec3 w = so3_log(T.R()), t = T.t();
  mrcal_pose_t pose{};
  for (int i = 0; i < 3; ++i) pose.r.xyz[i] = w[i], pose.t.xyz[i] = t[i];
  return pose;
}

}  // namespace

std::optional<Camera> by_opencv(const Dataset& data, const Kind& kind) {
  const Points points = points_of(data);
  const cv::Size size(data.cameras[0].size.width, data.cameras[0].size.height);
  const cv::TermCriteria stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-10);
  cv::Mat K, D;
  std::vector<cv::Mat> r, t;
  try {
    if (kind.lens == "kb4") {
      cv::fisheye::calibrate(points.board, points.px, size, K, D, r, t,
                             cv::fisheye::CALIB_RECOMPUTE_EXTRINSIC | cv::fisheye::CALIB_FIX_SKEW, stop);
    } else {
      const int flags = cv::CALIB_USE_LU | (kind.lens == "opencv8" ? cv::CALIB_RATIONAL_MODEL : 0);
      cv::calibrateCamera(points.board, points.px, size, K, D, r, t, flags, stop);
    }
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
  std::vector<double> k{K.at<double>(0, 0), K.at<double>(1, 1), K.at<double>(0, 2), K.at<double>(1, 2)};
  const int n = kind.lens == "kb4" ? 4 : kind.lens == "opencv8" ? 8 : 5;
  for (int i = 0; i < n; ++i) k.push_back(D.at<double>(i));
  return camera_of(data, kind.lens, k);
}

std::optional<Camera> by_mrcal(const Calibration& truth, const Dataset& data) {
  const std::string lens(lens_name(truth.rig.cameras[0].lens));
  mrcal_lensmodel_t model{};
  if (lens == "opencv5")
    model.type = MRCAL_LENSMODEL_OPENCV5;
  else if (lens == "opencv8")
    model.type = MRCAL_LENSMODEL_OPENCV8;
  else
    return std::nullopt;
  const auto start = params(truth.rig.cameras[0].lens);
  std::vector<double> k(start.begin(), start.end());
  std::vector<mrcal_pose_t> frames;
  std::vector<mrcal_observation_board_t> observations;
  std::vector<mrcal_point3_t> pool;
  for (const View& view : data.views) {
    mrcal_observation_board_t observation{};
    observation.icam.extrinsics = -1;
    observation.iframe = static_cast<int>(frames.size());
    observations.push_back(observation);
    frames.push_back(pose_of(*truth.T_rig_board[view.frame]));
    for (const Corner& c : view.corners) {
      mrcal_point3_t point{};
      point.xyz[0] = c.px.x(), point.xyz[1] = c.px.y(), point.xyz[2] = 1;
      pool.push_back(point);
    }
  }
  int size[] = {data.cameras[0].size.width, data.cameras[0].size.height};
  mrcal_problem_selections_t selections{};
  selections.do_optimize_intrinsics_core = selections.do_optimize_intrinsics_distortions = true;
  selections.do_optimize_frames = true;
  selections.do_apply_outlier_rejection = true;
  mrcal_problem_constants_t constants{};
  constants.point_min_range = 1e-3;
  constants.point_max_range = 1e6;
  const auto& lattice = *data.targets[0].lattice;
  const int n_views = static_cast<int>(frames.size());
  std::vector<double> x(static_cast<std::size_t>(mrcal_num_measurements(
      n_views, 0, lattice.columns, lattice.rows, 1, 0, n_views, 0, 0, selections, &model)));
  const mrcal_stats_t stats = mrcal_optimize(
      nullptr, 0, x.data(), static_cast<int>(x.size() * sizeof(double)), k.data(), nullptr, frames.data(),
      nullptr, nullptr, 1, 0, n_views, 0, 0, observations.data(), nullptr, n_views, 0, pool.data(), &model,
      size, selections, &constants, lattice.spacing_m, lattice.columns, lattice.rows, false, false);
  if (!(stats.rms_reproj_error__pixels >= 0)) return std::nullopt;
  return camera_of(data, lens, k);
}

}  // namespace plumbline::bench

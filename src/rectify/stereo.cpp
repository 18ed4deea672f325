// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "plumbline/geometry/so3.hpp"
#include "plumbline/rectify/rectify.hpp"
#include "plumbline/rig/validity.hpp"
#include "rectify/valid_region.hpp"

namespace plumbline {
namespace {

using detail::Frame;
using detail::RotatedView;

double degrees(double radians) { return radians * 180 / std::numbers::pi; }

// The angle between a direction and the optical axis, the direction's sign left out of account [deg].
double angle_to_axis_deg(const Vec3& v) { return degrees(std::atan2(v.head<2>().norm(), std::abs(v.z()))); }

// The rotation about z by -k quarter turns that brings a camera with relative rotation R nearest to the first
// camera's roll. The roll is the twist of R about the optical axis: 2 atan2(z, w) of its quaternion.
Mat3 quarter_turns_back(const Mat3& R_2_1) {
  const Eigen::Quaterniond q(R_2_1);
  const double roll = 2 * std::atan2(q.z(), q.w());
  const int quarters = static_cast<int>(std::lround(roll / (std::numbers::pi / 2))) & 3;
  Mat3 turn;  // exact, so that an upright second camera is not touched at all
  const int c[4] = {1, 0, -1, 0}, s[4] = {0, 1, 0, -1};
  turn << c[quarters], s[quarters], 0, -s[quarters], c[quarters], 0, 0, 0, 1;
  return turn;
}

struct Rotations {
  std::array<Mat3, 2> R_rect_cam;
  int axis = 0;  // of the baseline in the rectified image: 0 along x, 1 along y
  Vec3 t_rect = Vec3::Zero();
};

// Bouguet's construction; T_2_1 with a baseline that is not zero.
Rotations rectifying_rotations(const SE3& T_2_1) {
  const Mat3 turn = quarter_turns_back(T_2_1.R());
  const Mat3 R = turn * T_2_1.R();
  const Vec3 t = turn * T_2_1.t();
  const Mat3 R_mid_2 = so3_exp(-0.5 * so3_log(R)), R_mid_1 = R_mid_2.transpose();
  const Vec3 t_mid = R_mid_2 * t;
  const Vec3 t_first = R.transpose() * t;  // the axis is chosen in the first image, whose up shall stay up
  Rotations out;
  out.axis = std::abs(t_first.x()) > std::abs(t_first.y()) ? 0 : 1;
  Vec3 along = Vec3::Zero();
  along[out.axis] = t_first[out.axis] > 0 ? 1 : -1;
  const Vec3 normal = t_mid.cross(along);
  const double sine = normal.norm();
  const Mat3 R_rect_mid =
      sine > 0 ? so3_exp(normal * (std::atan2(sine, t_mid.dot(along)) / sine)) : Mat3(Mat3::Identity());
  out.R_rect_cam = {R_rect_mid * R_mid_1, R_rect_mid * R_mid_2 * turn};
  out.t_rect[out.axis] = along[out.axis] * t.norm();
  return out;
}

// OpenCV's frame: the principal point that centres the mean of both images' corners at focal length `focal`,
// fixed while the focal length changes. Not for images whose corners do not all come to lie in the plane.
std::optional<Frame> frame_from_corners(const std::array<RotatedView, 2>& views, double focal,
                                        ImageSize size) {
  Vec2 mean = Vec2::Zero();
  for (const RotatedView& view : views) {
    const ImageSize full = view.camera->size;
    for (int i = 0; i < 4; ++i) {
      const auto ray =
          unproject(*view.camera, Vec2((i & 1) * (full.width - 1), (i >> 1) * (full.height - 1)));
      if (!ray) return std::nullopt;
      const Vec3 p = view.R_new_cam * *ray;
      if (!(p.z() > 0) || angle_to_axis_deg(p) > kMaxHalfAngle_deg) return std::nullopt;
      mean += p.hnormalized() / 8;
    }
  }
  const Vec2 last(size.width - 1, size.height - 1), centre_px = 0.5 * last - focal * mean;
  if ((centre_px.array() < 0.1 * last.array()).any() || (centre_px.array() > 0.9 * last.array()).any())
    return std::nullopt;
  if (!views[0].sees(Vec2::Zero()) || !views[1].sees(Vec2::Zero())) return std::nullopt;
  return Frame{Vec2::Zero(), centre_px, size};
}

// The frame for everything else (fisheyes, strong convergence): centred where the valid image can be largest,
// found on a grid of directions and then on a finer one around the best of them.
std::optional<Frame> frame_from_search(const std::array<RotatedView, 2>& views, ImageSize size) {
  std::optional<Frame> best;
  double best_focal = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Vec2& angles) {
    const Vec2 q(std::tan(angles.x()), std::tan(angles.y()));
    if (!views[0].sees(q) || !views[1].sees(q)) return false;
    const Frame frame{q, 0.5 * Vec2(size.width - 1, size.height - 1), size};
    const double focal =
        focal_of_valid(frame, {inner_outline(views[0], q, 32), inner_outline(views[1], q, 32)});
    if (!(focal < best_focal * (1 - 1e-9))) return false;  // ties: the first, whatever the rounding
    best_focal = focal;
    best = frame;
    return true;
  };
  Vec2 middle = Vec2::Zero();
  double step = 10 * std::numbers::pi / 180;
  for (int half : {7, 2, 2}) {
    Vec2 next = middle;
    for (int row = -half; row <= half; ++row) {
      for (int col = -half; col <= half; ++col) {
        const Vec2 angles = middle + step * Vec2(col, row);
        if (consider(angles)) next = angles;
      }
    }
    middle = next;
    step /= 4;
  }
  return best;
}

// Outlines are dense but not continuous: lengthens the focal length until each border pixel of the rectified
// image is valid in both views.
double until_border_valid(const Frame& frame, const std::array<RotatedView, 2>& views, double focal) {
  const auto all_valid = [&](double f) {
    const auto seen = [&](double x, double y) {
      const Vec2 q = (Vec2(x, y) - frame.anchor_px) / f + frame.anchor;
      return views[0].sees(q) && views[1].sees(q);
    };
    for (int x = 0; x < frame.size.width; ++x) {
      if (!seen(x, 0) || !seen(x, frame.size.height - 1)) return false;
    }
    for (int y = 0; y < frame.size.height; ++y) {
      if (!seen(0, y) || !seen(frame.size.width - 1, y)) return false;
    }
    return true;
  };
  for (double step = 1e-6; step < 1 && !all_valid(focal); step *= 1.5) focal *= 1 + step;
  return focal;
}

void fill_matrices(StereoRectification& out, const Frame& frame, double focal, const Rotations& rotations) {
  const Vec2 c = frame.anchor_px - focal * frame.anchor;
  Mat34 P;
  P << focal, 0, c.x(), 0, 0, focal, c.y(), 0, 0, 0, 1, 0;
  out.P = {P, P};
  const double t = rotations.t_rect[rotations.axis];
  out.P[1](rotations.axis, 3) = focal * t;
  out.Q << 1, 0, 0, -c.x(), 0, 1, 0, -c.y(), 0, 0, 0, focal, 0, 0, -1 / t, 0;
}

Error degenerate(const Rig& rig, int first, int second, std::string message) {
  return {ErrorCode::kDegenerate, std::move(message),
          fmt::format("cameras {} and {}", rig.cameras[first].name, rig.cameras[second].name)};
}

// nullopt when the pose of the two cameras allows a common image plane.
std::optional<Error> fault_of_geometry(const Rig& rig, int first, int second, const SE3& T_2_1) {
  const double baseline_m = T_2_1.t().norm();
  if (!(baseline_m > 1e-9) || !std::isfinite(baseline_m)) {
    return degenerate(
        rig, first, second,
        fmt::format("the baseline is {} m: two cameras in one place show no depth", baseline_m));
  }
  const Vec3 baseline[2] = {T_2_1.centre(), T_2_1.t()};  // in the first and in the second camera's frame
  for (int i = 0; i < 2; ++i) {
    const double angle = angle_to_axis_deg(baseline[i]);
    if (angle >= kMinBaselineAngle_deg) continue;
    return degenerate(
        rig, first, second,
        fmt::format(
            "the baseline lies {:.1f} degrees from the optical axis of camera {}, at least {:.0f} are "
            "needed: one camera stands in front of the other, and no common image plane shows both",
            angle, rig.cameras[i == 0 ? first : second].name, kMinBaselineAngle_deg));
  }
  return std::nullopt;
}

}  // namespace

Result<StereoRectification> rectify_stereo(const Rig& rig, int first, int second,
                                           const RectifyOptions& options) {
  PLUMBLINE_CHECK(options.alpha >= 0 && options.alpha <= 1, "alpha is in [0, 1]");
  PLUMBLINE_CHECK(options.size.width >= 0 && options.size.height >= 0, "the rectified size is not negative");
  PLUMBLINE_CHECK(rig.T_cam_rig.size() == rig.cameras.size(), "a pose for each camera");
  const int n = static_cast<int>(rig.cameras.size());
  if (n < 2 || first < 0 || second < 0 || first >= n || second >= n) {
    return Error{
        ErrorCode::kUnsupported,
        fmt::format("rectification needs two cameras; cameras {} and {} of a rig with {} are asked for",
                    first, second, n),
        "rectify"};
  }
  const SE3 T_2_1 = rig.T_cam_rig[second] * rig.T_cam_rig[first].inverse();
  if (auto fault = fault_of_geometry(rig, first, second, T_2_1)) return *fault;

  const Rotations rotations = rectifying_rotations(T_2_1);
  const Camera* cameras[2] = {&rig.cameras[first], &rig.cameras[second]};
  StereoRectification out;
  out.cameras = {cameras[0]->name, cameras[1]->name};
  out.size = options.size.width > 0 && options.size.height > 0 ? options.size : cameras[0]->size;
  out.R_rect_cam = rotations.R_rect_cam;
  out.vertical = rotations.axis == 1;
  out.baseline_m = T_2_1.t().norm();

  const std::array<RotatedView, 2> views{RotatedView{cameras[0], out.R_rect_cam[0]},
                                         RotatedView{cameras[1], out.R_rect_cam[1]}};
  // OpenCV's starting focal length: the mean of both along the axis across the baseline, at the new size.
  const int across = 1 - rotations.axis;
  const double ratio = out.vertical ? static_cast<double>(out.size.width) / cameras[0]->size.width
                                    : static_cast<double>(out.size.height) / cameras[0]->size.height;
  const double start = 0.5 * ratio * (params(cameras[0]->lens)[across] + params(cameras[1]->lens)[across]);
  std::optional<Frame> frame = frame_from_corners(views, start, out.size);
  if (!frame) frame = frame_from_search(views, out.size);
  if (!frame) {
    const double angle = degrees(std::acos(std::clamp(T_2_1.R()(2, 2), -1.0, 1.0)));
    return degenerate(
        rig, first, second,
        fmt::format("the optical axes are {:.1f} degrees apart, and the cameras see no direction in common",
                    angle));
  }
  const std::vector<std::vector<Vec2>> inner{inner_outline(views[0], frame->anchor),
                                             inner_outline(views[1], frame->anchor)};
  std::vector<std::vector<Vec2>> outer{outer_outline(views[0]), outer_outline(views[1])};
  outer.insert(outer.end(), inner.begin(), inner.end());  // where the lens' domain ends inside the image
  const double valid = until_border_valid(*frame, views, focal_of_valid(*frame, inner));
  const double all = focal_of_all(*frame, outer);
  fill_matrices(out, *frame, (1 - options.alpha) * valid + options.alpha * all, rotations);
  return out;
}

}  // namespace plumbline

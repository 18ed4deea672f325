// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rig/calibration.hpp"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "plumbline/rig/motion.hpp"

namespace plumbline {

std::optional<Vec2> bow_of(const Calibration& calibration, int target) {
  const auto i = static_cast<std::size_t>(target);
  if (i >= calibration.bow_m.size() || !calibration.data.targets[i].outline) return std::nullopt;
  return calibration.bow_m[i];
}

Vec3 board_point(const Calibration& calibration, int target, int point) {
  const Target& board = calibration.data.targets[target];
  Vec3 p = board.points[point];
  if (const auto bow = bow_of(calibration, target)) p.z() += bow->dot(bow_shape(*board.outline, p));
  return p;
}

std::optional<Vec2> predict(const Calibration& calibration, const View& view, int point) {
  const std::optional<SE3>& T_rig_board = calibration.T_rig_board[view.frame];
  if (!T_rig_board) return std::nullopt;
  if (has_clocks(calibration)) return predict(calibration, trajectory_of(calibration), view, point);
  Vec3 p_board0 = board_point(calibration, view.target, point);
  if (view.target > 0) p_board0 = calibration.T_board0_board[view.target] * p_board0;
  const Vec3 p_cam = calibration.rig.T_cam_rig[view.cam] * (*T_rig_board * p_board0);
  return project(calibration.rig.cameras[view.cam].lens, p_cam);
}

std::optional<SE3> board_pose(const Calibration& calibration, const View& view) {
  const std::optional<SE3>& T_rig_board = calibration.T_rig_board[view.frame];
  if (!T_rig_board || view.target == 0) return T_rig_board;
  return *T_rig_board * calibration.T_board0_board[view.target];
}

namespace {
constexpr std::array kStepNames{"r_x", "r_y", "r_z", "t_x", "t_y", "t_z"};
}

std::vector<std::string> shared_parameter_names(const Rig& rig) {
  std::vector<std::string> names;
  for (const Camera& camera : rig.cameras) {
    for (std::string_view name : param_names(camera.lens))
      names.push_back(fmt::format("{} {}", camera.name, name));
  }
  for (std::size_t i = 1; i < rig.cameras.size(); ++i) {
    for (const char* name : kStepNames) names.push_back(rig.cameras[i].name + " " + name);
  }
  return names;
}

std::vector<std::string> shared_parameter_names(const Calibration& calibration) {
  std::vector<std::string> names = shared_parameter_names(calibration.rig);
  for (std::size_t i = 1; i < calibration.data.targets.size(); ++i) {
    for (const char* name : kStepNames) names.push_back(calibration.data.targets[i].name + " " + name);
  }
  for (std::size_t i = 0; i < calibration.data.targets.size(); ++i) {
    if (!bow_of(calibration, static_cast<int>(i))) continue;
    for (const char* name : {"bow_x", "bow_y"})
      names.push_back(calibration.data.targets[i].name + " " + name);
  }
  for (std::size_t i = 0; i < calibration.clocks.size(); ++i) {
    const std::string& camera = calibration.rig.cameras[i].name;
    if (calibration.clocks[i].line_delay_s) names.push_back(camera + " line_delay");
    if (calibration.clocks[i].time_offset_s) names.push_back(camera + " time_offset");
  }
  return names;
}

namespace {
template <class Wanted>
double rms_of(const Calibration& calibration, Wanted&& wanted) {
  double sum = 0;
  int n = 0;
  for (std::size_t v = 0; v < calibration.fits.size(); ++v) {
    if (!wanted(v)) continue;
    for (const CornerFit& fit : calibration.fits[v]) {
      if (fit.outlier) continue;
      sum += fit.residual_px.squaredNorm();
      ++n;
    }
  }
  return n > 0 ? std::sqrt(sum / n) : 0.0;
}
}  // namespace

double camera_rms_px(const Calibration& calibration, int cam) {
  return rms_of(calibration, [&](std::size_t v) { return calibration.data.views[v].cam == cam; });
}

double view_rms_px(const Calibration& calibration, int view) {
  return rms_of(calibration, [&](std::size_t v) { return v == static_cast<std::size_t>(view); });
}

std::string corners_hash(const Dataset& data) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  const auto add_bytes = [&](const void* bytes, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
      hash = (hash ^ static_cast<const unsigned char*>(bytes)[i]) * 0x100000001b3ULL;
  };
  const auto add_number = [&](double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    add_bytes(&bits, sizeof bits);
  };
  for (const CameraInfo& camera : data.cameras) {
    add_bytes(camera.name.data(), camera.name.size());
    add_number(camera.size.width);
    add_number(camera.size.height);
  }
  for (const View& view : data.views) {
    add_number(view.cam);
    add_number(view.frame);
    if (view.target > 0) add_number(view.target);
    if (view.time_s) add_number(*view.time_s);
    for (const Corner& c : view.corners) {
      add_number(c.point);
      add_number(c.px.x());
      add_number(c.px.y());
    }
  }
  return fmt::format("{:016x}", hash);
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <vector>

#include "plumbline/rig/calibration.hpp"

/// Where the boards were between frames, for cameras whose rows or clocks are not at the frame's time.
namespace plumbline {

/// A frame's motion is read from five frames that follow one another.
inline constexpr int kMotionFrames = 5;
/// Frames further apart than this [s] do not follow one another: a hand changes its mind in less.
inline constexpr double kLongestGap_s = 0.15;

struct MotionStencil {
  std::array<int, kMotionFrames> frames{};  ///< ascending in time
  std::array<double, kMotionFrames> t_s{};  ///< from the frame's time
  int centre = 0;                           ///< which of them is the frame itself
};

/// The time of a frame is that of its first view with corners, by that view's own clock. A frame without a
/// pose, without a time, or with less than four others near it (no gap above kLongestGap_s) has no motion.
struct Trajectory {
  std::vector<std::optional<double>> time_s;           ///< per frame
  std::vector<std::optional<MotionStencil>> stencils;  ///< per frame
};
Trajectory trajectory_of(const Calibration& calibration);

/// Whether poses between frames matter: any line delay or time offset is known.
bool has_clocks(const Calibration& calibration);

struct MovingPose {
  Mat3 R = Mat3::Identity();  ///< of T_rig_board
  Vec3 t = Vec3::Zero();
  Vec3 w = Vec3::Zero(), v = Vec3::Zero();  ///< dR/dt = [w]_x R [rad/s], dt/dt [m/s]
};

/// The motion through the poses of a stencil: the polynomial of fourth degree through log(R_j R_c') and t_j,
/// where c is the frame itself. At the frame's time it is that frame's pose exactly. Its velocity errs by the
/// fifth derivative times (time between frames)^4 / 30.
class BoardMotion {
 public:
  BoardMotion(const MotionStencil& stencil, const std::array<SE3, kMotionFrames>& T_rig_board);

  /// d(step of the pose) / d(box_plus step of each pose): rotations, and one factor for translations.
  struct Jacobian {
    std::array<Mat3, kMotionFrames> rotation;
    std::array<double, kMotionFrames> translation{};
  };
  /// \param dt_s  from the frame's time
  MovingPose at(double dt_s, Jacobian* J = nullptr) const;
  /// Whether a time lies among the frames, or no more than kLongestGap_s outside.
  bool covers(double dt_s) const;

 private:
  MotionStencil stencil_;
  Mat3 R_centre_;
  std::array<Vec3, kMotionFrames> w_, t_;
};

/// The rows of one view: row v is exposed at start_s + line_delay_s (v - middle_row) from the frame's time.
struct Exposure {
  double start_s = 0, line_delay_s = 0, middle_row = 0;
};
/// nullopt when the view or its frame has no time.
std::optional<Exposure> exposure_of(const Calibration& calibration, const Trajectory& trajectory,
                                    const View& view);

/// Where a point of the first board's frame appears: the row at which it is exposed is the row where it
/// appears (Newton's method). With the pose at that time.
struct RowPixel {
  Vec2 px = Vec2::Zero();
  double row = 0, dt_s = 0;
  MovingPose pose;
};
std::optional<RowPixel> project_moving(const Lens& lens, const SE3& T_cam_rig, const BoardMotion& motion,
                                       const Exposure& exposure, const Vec3& p_board0);

/// As predict() of rig/calibration.hpp, for many points: the trajectory is that of the calibration.
std::optional<Vec2> predict(const Calibration& calibration, const Trajectory& trajectory, const View& view,
                            int point);

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/hand_eye.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "plumbline/core/check.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;
// Below these the errors of board poses (some hundredths of a degree) are as large as the turns themselves.
constexpr double kLeastTurnDeg = 0.5, kLeastAxesDeg = 1.0;
// Turns across the common axis must stand out of the disagreement of the two cameras' turns.
constexpr double kTimesNoise = 3.0;

// 2 sin(angle) along the axis: the part of R that changes its sign with the turn's. Any X with R_A R_X = R_X
// R_B maps that of B to that of A. It vanishes for half turns, whose axis has no sign.
Vec3 sine_axis(const Mat3& R) { return {R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)}; }

std::vector<Mat3> rotations(std::span<const SE3> poses) {
  std::vector<Mat3> list;
  list.reserve(poses.size());
  for (const SE3& T : poses) list.push_back(T.R());
  return list;
}

// Sums over all pairs of frames of the motions of both cameras.
struct Pairs {
  Mat3 spread = Mat3::Zero();  // of a a'
  Mat3 cross = Mat3::Zero();   // of a b'
  double largest_rad = 0;
  double disagreement = 0;  // mean square of |a| - |b|, which noise alone makes
  double n = 0;
};

Pairs sum_pairs(const std::vector<Mat3>& R1, const std::vector<Mat3>& R2) {
  Pairs sum;
  for (std::size_t i = 0; i < R1.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      const Mat3 A = R1[i] * R1[k].transpose(), B = R2[i] * R2[k].transpose();
      const Vec3 a = sine_axis(A), b = sine_axis(B);
      sum.spread += a * a.transpose();
      sum.cross += a * b.transpose();
      sum.largest_rad = std::max(sum.largest_rad, rotation_angle(A));
      sum.disagreement += (a.norm() - b.norm()) * (a.norm() - b.norm());
      ++sum.n;
    }
  }
  if (sum.n > 0) sum.disagreement /= sum.n;
  return sum;
}

TurnSpread spread_of(const Pairs& pairs, std::size_t n_frames) {
  TurnSpread turns;
  turns.n_frames = static_cast<int>(n_frames);
  turns.largest_turn_deg = kDegPerRad * pairs.largest_rad;
  const auto eigen = sym_eigen_fixed<3>(pairs.spread);  // ascending
  turns.axis_cam1 = eigen.vectors.col(2);
  turns.axes_deg = kDegPerRad * std::atan2(std::sqrt(std::max(0.0, eigen.values[1])),
                                           std::sqrt(std::max(0.0, eigen.values[2])));
  return turns;
}

Status check_turns(const Pairs& pairs, const TurnSpread& turns) {
  const auto bad = [](std::string message) { return Error{ErrorCode::kDegenerate, std::move(message), ""}; };
  if (turns.n_frames < 3)
    return bad(
        fmt::format("{} frames, at least 3 are needed: two turns about different axes", turns.n_frames));
  if (!(turns.largest_turn_deg > kLeastTurnDeg))
    return bad(
        fmt::format("the largest turn between two of {} frames is {:.2g} degrees; turn by 20 degrees and "
                    "more, about at least two axes",
                    turns.n_frames, turns.largest_turn_deg));
  // Root mean square sine of the turns across the common axis.
  const auto eigen = sym_eigen_fixed<3>(pairs.spread);
  const double across = std::sqrt(std::max(0.0, eigen.values[1]) / pairs.n);
  if (turns.axes_deg > kLeastAxesDeg && across > kTimesNoise * std::sqrt(pairs.disagreement)) return {};
  const Vec3& axis = turns.axis_cam1;
  return bad(fmt::format(
      "all turns are about one axis, ({:.2f}, {:.2f}, {:.2f}) in the first camera (the axes of {} frames lie "
      "within {:.2g} degrees): the position of the second camera along it is not determined; add frames that "
      "turn by 20 degrees and more about another axis",
      axis.x(), axis.y(), axis.z(), turns.n_frames, turns.axes_deg));
}

// From R_1 t_Y + t_1 = R_X t_2 + t_X in every frame: t_X - R_1 t_Y = t_1 - R_X t_2.
std::optional<VecX> translations(const std::vector<Mat3>& R1, const Mat3& R_X, std::span<const SE3> T1,
                                 std::span<const SE3> T2) {
  const auto n = static_cast<Eigen::Index>(T1.size());
  MatX A(3 * n, 6);
  VecX b(3 * n);
  for (Eigen::Index f = 0; f < n; ++f) {
    A.block<3, 3>(3 * f, 0) = Mat3::Identity();
    A.block<3, 3>(3 * f, 3) = -R1[f];
    b.segment<3>(3 * f) = T1[f].t() - R_X * T2[f].t();
  }
  return solve_least_squares(A, b);
}

}  // namespace

TurnSpread turn_spread(std::span<const SE3> T_cam1_board1) {
  const std::vector<Mat3> R = rotations(T_cam1_board1);
  return spread_of(sum_pairs(R, R), R.size());
}

Result<HandEye> hand_eye(std::span<const SE3> T1, std::span<const SE3> T2) {
  PLUMBLINE_CHECK(T1.size() == T2.size(), "hand_eye needs a pose of both cameras in every frame");
  for (std::size_t f = 0; f < T1.size(); ++f) {
    for (int i = 0; i < 7; ++i) {
      if (!std::isfinite(T1[f].qt[i]) || !std::isfinite(T2[f].qt[i]))
        return Error{ErrorCode::kInvalidData, "a pose is not finite", fmt::format("frame {}", f)};
    }
  }
  const std::vector<Mat3> R1 = rotations(T1), R2 = rotations(T2);
  const Pairs pairs = sum_pairs(R1, R2);
  HandEye out;
  out.turns = spread_of(pairs, T1.size());
  if (Status ok = check_turns(pairs, out.turns); !ok) return ok.error();
  const Mat3 R_X = nearest_rotation(pairs.cross);
  Mat3 sum = Mat3::Zero();
  for (std::size_t f = 0; f < R1.size(); ++f) sum += R1[f].transpose() * R_X * R2[f];
  const auto t = translations(R1, R_X, T1, T2);
  if (!t) return Error{ErrorCode::kDegenerate, "the motions leave the translations undetermined", ""};
  out.T_cam1_cam2 = SE3(R_X, t->head<3>());
  out.T_board1_board2 = SE3(nearest_rotation(sum), t->tail<3>());
  for (std::size_t f = 0; f < T1.size(); ++f) {
    const Vec6 left = box_minus(T1[f] * out.T_board1_board2, out.T_cam1_cam2 * T2[f]);
    out.rms_rad += left.head<3>().squaredNorm();
    out.rms_m += left.tail<3>().squaredNorm();
  }
  out.rms_rad = std::sqrt(out.rms_rad / static_cast<double>(T1.size()));
  out.rms_m = std::sqrt(out.rms_m / static_cast<double>(T1.size()));
  return out;
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "detect/point_features.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "detect/tag_bits.hpp"

namespace plumbline::detail {
namespace {

PointFeature on_board(double unit_m, const Vec3& towards_viewer) {
  PointFeature f;
  f.u = Vec3(unit_m, 0, 0), f.v = Vec3(0, unit_m, 0);
  f.towards_viewer = towards_viewer;
  return f;
}

int parity(int c, int r) { return (c + r) % 2 == 0 ? 1 : -1; }

void append(const Chessboard& board, double, std::vector<PointFeature>& out) {
  for (int r = 0; r < board.rows; ++r) {
    for (int c = 0; c < board.columns; ++c) {
      out.push_back(on_board(board.square_m, -Vec3::UnitZ()));
      // Where colours tell the ends apart the square diagonal to point 0 is black by definition.
      const bool is_known = (board.columns + board.rows) % 2 != 0;
      out.back().sign = is_known ? -parity(c, r) : parity(c, r);
      out.back().is_sign_absolute = is_known;
    }
  }
}

void append(const Charuco& board, double, std::vector<PointFeature>& out) {
  for (int r = 0; r + 1 < board.rows; ++r) {
    for (int c = 0; c + 1 < board.columns; ++c) {
      out.push_back(on_board(board.square_m, -Vec3::UnitZ()));
      out.back().sign = parity(c, r);
      out.back().window.across = (1 - board.marker_m / board.square_m) / 2;  // the markers stand beside
    }
  }
}

/// Of the black border [tags], of one module whatever the target says: boards printed elsewhere need not say
/// it.
double border_width(const AprilGrid& board) { return 1.0 / (april_book(board.family)->n + 2); }

void append(const AprilGrid& board, double, std::vector<PointFeature>& out) {
  for (int tag = 0; tag < board.columns * board.rows; ++tag) {
    for (int k = 0; k < 4; ++k) {
      PointFeature f = on_board(board.tag_m, Vec3::UnitZ());
      // As far as the tag's border and the small square, which ends with the gap.
      f.window.across = std::min(border_width(board), board.spacing);
      f.window.leak_blurs = 2;  // as in the first look
      const bool tag_is_right = k == 0 || k == 3, tag_is_up = k == 0 || k == 1;
      f.window.low = Vec2(tag_is_right ? -board.spacing : -1, tag_is_up ? -board.spacing : -1);
      f.window.high = Vec2(tag_is_right ? 1 : board.spacing, tag_is_up ? 1 : board.spacing);
      f.sign = k % 2 == 0 ? -1 : 1;  // dark: the tag, and the small square across from it
      f.is_sign_absolute = true;
      out.push_back(f);
    }
  }
}

void append(const Circles& board, double diameter_m, std::vector<PointFeature>& out) {
  const double diameter = (diameter_m > 0 ? diameter_m : printed_diameter_m(board)) / board.spacing_m;
  for (int i = 0; i < board.columns * board.rows; ++i) {
    out.push_back(on_board(board.spacing_m, -Vec3::UnitZ()));
    out.back().radius = diameter / 2;
    out.back().gap = (board.asymmetric ? std::numbers::sqrt2 : 1) - diameter;
  }
}

void append(const Points3d&, double, std::vector<PointFeature>&) {}

void append(const BoardRig& rig, double diameter_m, std::vector<PointFeature>& out) {
  for (const BoardPart& part : rig.parts) {
    std::vector<PointFeature> own;
    std::visit([&](const auto& board) { append(board, diameter_m, own); }, part.board);
    const Mat3 R = part.T_target_board.R();
    for (PointFeature& f : own) {
      f.u = R * f.u, f.v = R * f.v, f.towards_viewer = R * f.towards_viewer;
      out.push_back(f);
    }
  }
}

}  // namespace

double printed_diameter_m(const Circles& board) {
  return board.diameter_m > 0 ? board.diameter_m : board.spacing_m * (board.asymmetric ? 0.8 : 0.5);
}

std::vector<PointFeature> point_features(const Target& target, double disc_diameter_m) {
  std::vector<PointFeature> out;
  std::visit([&](const auto& board) { append(board, disc_diameter_m, out); }, target.spec);
  return out;
}

std::optional<PointPlace> place_of(const Lens& lens, const SE3& T_cam_target, const Vec3& p_target,
                                   const PointFeature& feature) {
  constexpr double kStep = 0.4;          // board units; windows reach half a unit
  constexpr double kLeastSlant = 0.087;  // sin 5 degrees
  const Vec3 p_cam = T_cam_target * p_target;
  if ((T_cam_target.R() * feature.towards_viewer).dot(-p_cam.normalized()) < kLeastSlant) return std::nullopt;
  const auto at = [&](const Vec3& step) { return project(lens, T_cam_target * (p_target + kStep * step)); };
  const auto px = project(lens, p_cam), right = at(feature.u), left = at(-feature.u), down = at(feature.v),
             up = at(-feature.v);
  if (!px || !right || !left || !down || !up) return std::nullopt;
  PointPlace place{*px, Mat2::Zero(), Vec2::Zero()};
  const Vec2 ahead[2] = {*right, *down}, behind[2] = {*left, *up};
  for (int axis = 0; axis < 2; ++axis) {
    const Vec2 a = (ahead[axis] - behind[axis]) / (2 * kStep),
               b = (ahead[axis] + behind[axis] - 2 * *px) / (kStep * kStep);
    place.J.col(axis) = a;
    place.curvature[axis] = (a.x() * b.y() - a.y() * b.x()) / (a.norm() * a.squaredNorm());
  }
  return place;
}

}  // namespace plumbline::detail

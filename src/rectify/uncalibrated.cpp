// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/uncalibrated.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr int kGrid = 9;  // points of the measure along each side
using Row2 = Eigen::RowVector2d;

// Pixels to coordinates of which the image's half diagonal is the unit and its centre the origin.
struct Frame {
  Mat3 from_px;
  Vec2 half;  // of the image's sides
};

Frame frame_of(ImageSize size, bool vertical) {
  const Vec2 centre((size.width - 1) / 2.0, (size.height - 1) / 2.0);
  const double unit = std::hypot(size.width, size.height) / 2;
  Frame frame;
  frame.from_px << 1 / unit, 0, -centre.x() / unit, 0, 1 / unit, -centre.y() / unit, 0, 0, 1;
  frame.half = Vec2(size.width, size.height) / (2 * unit);
  if (vertical) {
    // Columns become rows; undone at the end.
    frame.from_px.row(0).swap(frame.from_px.row(1));
    std::swap(frame.half.x(), frame.half.y());
  }
  return frame;
}

std::vector<Vec2> grid_of(const Vec2& half) {
  std::vector<Vec2> grid;
  for (int r = 0; r < kGrid; ++r) {
    for (int c = 0; c < kGrid; ++c) {
      const Vec2 side(2.0 * c / (kGrid - 1) - 1, 2.0 * r / (kGrid - 1) - 1);
      grid.push_back(side.cwiseProduct(half));
    }
  }
  return grid;
}

Vec2 apply(const Mat3& H, const Vec2& p) { return (H * p.homogeneous()).hnormalized(); }

Mat2 jacobian(const Mat3& H, const Vec2& p) {
  const Vec3 q = H * p.homogeneous();
  return (H.topLeftCorner<2, 2>() - q.hnormalized() * H.bottomLeftCorner<1, 2>()) / q.z();
}

// The rotation nearest to M, and the squared distance from it: (s1 - 1)^2 + (s2 - 1)^2 for det M > 0.
Mat2 nearest_turn(const Mat2& M) {
  const double angle = std::atan2(M(1, 0) - M(0, 1), M(0, 0) + M(1, 1));
  return Eigen::Rotation2Dd(angle).toRotationMatrix();
}

// A pair of homographies of the family, and what it costs.
struct Candidate {
  std::array<Mat3, 2> H;
  double cost = 0;  // mean over both images of (s1 - 1)^2 + (s2 - 1)^2
};

// All pairs that match the rows are F = w2 v1' - v2 w1' for their rows v and w. v1, w1 span the epipolar
// lines of the first image; for an orthonormal pair of them w2 = F v1 and v2 = -F w1. The angle of w1 in the
// pencil decides the perspective of both images; what is left free is affine: H <- [a b c; 0 s d; 0 0 1] H
// with s and d in common.
class Family {
 public:
  Family(const Mat3& F, const Svd3& svd, const Vec2& half)
      : F_(F),
        pencil_(svd.V.leftCols<2>()),
        epipole_{svd.V.col(2), svd.U.col(2)},
        half_(half),
        grid_(grid_of(half)) {}

  // Homographies with the line at infinity of angle theta and nothing else chosen; nullopt when that line
  // crosses one of the images.
  std::optional<std::array<Mat3, 2>> perspective(double theta) const {
    const Vec3 w1 = pencil_ * Vec2(std::cos(theta), std::sin(theta));
    const Vec3 v1 = pencil_ * Vec2(-std::sin(theta), std::cos(theta));
    const std::array<Vec3, 2> w{w1, F_ * v1}, v{v1, -F_ * w1};
    std::array<Mat3, 2> H;
    for (int i = 0; i < 2; ++i) {
      int positive = 0;
      for (int corner = 0; corner < 4; ++corner) {
        const Vec2 p((corner & 1 ? 1 : -1) * half_.x(), (corner & 2 ? 1 : -1) * half_.y());
        // A hundredth of the centre's value is a magnification of ten thousand: the line touches the image.
        positive += w[i].dot(p.homogeneous()) / w[i].z() > 0.01;
      }
      if (positive != 4) return std::nullopt;
      H[i] << epipole_[i].transpose(), v[i].transpose(), w[i].transpose();
      H[i] /= w[i].z();
    }
    return H;
  }

  // The least distortion with the line at infinity of angle theta: by turns the rotations nearest to the
  // local maps, and the affine parts that come nearest to these rotations; each turn lowers the cost.
  std::optional<Candidate> best_at(double theta, int max_turns) const {
    auto H = perspective(theta);
    if (!H) return std::nullopt;
    std::array<std::vector<Mat2>, 2> J;
    std::array<Mat2, 2> A;
    const double s = 1 / jacobian((*H)[0], Vec2::Zero()).row(1).norm();
    const double up = jacobian((*H)[0], Vec2::Zero())(1, 1) < 0 ? -s : s;
    for (int i = 0; i < 2; ++i) {
      for (const Vec2& p : grid_) J[i].push_back(jacobian((*H)[i], p));
      A[i] = start(jacobian((*H)[i], Vec2::Zero()), up);
    }
    double cost = relax(J, A), before = 0;
    for (int turn = 0; turn < max_turns; ++turn) {
      before = std::exchange(cost, relax(J, A));
      if (before - cost <= 1e-13 * before) break;
    }
    for (int i = 0; i < 2; ++i) {
      Mat3 affine = Mat3::Identity();
      affine.topLeftCorner<2, 2>() = A[i];
      (*H)[i] = affine * (*H)[i];
    }
    return Candidate{*H, cost};
  }

 private:
  // Upper triangular A with s given such that A J is a multiple of a rotation as nearly as may be.
  static Mat2 start(const Mat2& J, double s) {
    const Row2 down = s * J.row(1);
    const Row2 along = Row2(down.y(), -down.x()) / down.norm();
    Mat2 A = Mat2::Zero();
    A.row(0) = along * J.inverse();
    A(1, 1) = s;
    return A;
  }

  // One turn; \returns the cost before it.
  static double relax(const std::array<std::vector<Mat2>, 2>& J, std::array<Mat2, 2>& A) {
    double cost = 0, down_R = 0, down_down = 0;
    for (int i = 0; i < 2; ++i) {
      Mat2 N = Mat2::Zero(), right = Mat2::Zero();
      for (const Mat2& j : J[i]) {
        const Mat2 M = A[i] * j, R = nearest_turn(M);
        cost += (M - R).squaredNorm();
        N += j * j.transpose();
        right.row(0) += R.row(0) * j.transpose();
        down_R += j.row(1).dot(R.row(1));
        down_down += j.row(1).squaredNorm();
      }
      A[i].row(0) = right.row(0) * N.inverse();
    }
    A[0](1, 1) = A[1](1, 1) = down_R / down_down;
    return cost / static_cast<double>(J[0].size() + J[1].size());
  }

  Mat3 F_;
  Eigen::Matrix<double, 3, 2> pencil_;
  std::array<Vec3, 2> epipole_;
  Vec2 half_;
  std::vector<Vec2> grid_;
};

// The best angle: the best of a coarse sample, then a golden section around it.
std::optional<Candidate> least_distorted(const Family& family) {
  constexpr int kSamples = 90;
  const double step = std::numbers::pi / kSamples;
  std::optional<Candidate> best;
  double at = 0;
  const auto keep = [&](double theta, int max_turns) {
    auto candidate = family.best_at(theta, max_turns);
    const double cost = candidate ? candidate->cost : std::numeric_limits<double>::infinity();
    if (candidate && (!best || cost < best->cost)) {
      best = std::move(candidate);
      at = theta;
    }
    return cost;
  };
  // A few turns tell the valley, many its floor.
  for (int i = 0; i < kSamples; ++i) keep(i * step, 5);
  if (!best) return std::nullopt;
  const int many = 200;
  const double golden = (std::sqrt(5.0) - 1) / 2;
  double low = at - step, high = at + step;
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double cost_a = keep(a, many), cost_b = keep(b, many);
  while (high - low > 1e-7) {
    if (cost_a <= cost_b) {
      high = std::exchange(b, a);
      cost_b = cost_a;
      a = high - golden * (high - low);
      cost_a = keep(a, many);
    } else {
      low = std::exchange(a, b);
      cost_a = cost_b;
      b = low + golden * (high - low);
      cost_b = keep(b, many);
    }
  }
  return best;
}

// kDegenerate for an epipole inside an image of F in pixels.
Status check_epipoles(const Svd3& svd, ImageSize size) {
  for (int i = 0; i < 2; ++i) {
    const Vec3 e = i == 0 ? svd.V.col(2) : svd.U.col(2);
    if (std::abs(e.z()) * 1e9 < e.head<2>().norm()) continue;
    const Vec2 px = e.hnormalized();
    if (px.x() < -0.5 || px.y() < -0.5 || px.x() > size.width - 0.5 || px.y() > size.height - 0.5) continue;
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the epipole of image {} lies inside it, at ({:.1f}, {:.1f}): the camera moved "
                    "towards what it sees, and no homographies match the rows; a polar rectification "
                    "is needed",
                    i + 1, px.x(), px.y()),
        ""};
  }
  return {};
}

// The fit x1' = [a b c] (x1, y1, 1) to x2 (Hartley & Zisserman, 11.12.2).
Status fit_columns(Mat3& H1, const Mat3& H2, std::span<const Vec2> px1, std::span<const Vec2> px2) {
  MatX A(px1.size(), 3);
  VecX b(px1.size());
  for (std::size_t i = 0; i < px1.size(); ++i) {
    A.row(static_cast<Eigen::Index>(i)) = apply(H1, px1[i]).homogeneous();
    b[static_cast<Eigen::Index>(i)] = apply(H2, px2[i]).x();
  }
  const auto fit = px1.size() < 3 ? std::nullopt : solve_least_squares(A, b);
  if (!fit || !((*fit)[0] > 0)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("{} points do not fit the first image to the second along the rows: at least three "
                    "that are not on a line are needed, and an order that is not reversed",
                    px1.size()),
        ""};
  }
  Mat3 affine = Mat3::Identity();
  affine.row(0) = fit->transpose();
  H1 = affine * H1;
  return {};
}

// The middle of the images' centres to the middle of the rectified image; along the rows each centre by
// itself, unless the columns have been fitted to one another.
void centre(std::array<Mat3, 2>& H, bool columns_fitted) {
  const Vec2 c1 = apply(H[0], Vec2::Zero()), c2 = apply(H[1], Vec2::Zero()), between = (c1 + c2) / 2;
  for (int i = 0; i < 2; ++i) {
    Mat3 move = Mat3::Identity();
    move(0, 2) = columns_fitted ? -between.x() : -(i == 0 ? c1 : c2).x();
    move(1, 2) = -between.y();
    H[i] = move * H[i];
  }
}

void measure(UncalibratedRectification& out, std::span<const Vec2> px1, std::span<const Vec2> px2,
             ImageSize size) {
  for (int i = 0; i < 2; ++i) out.distortion[i] = homography_distortion(out.H[i], size);
  const int along = out.vertical ? 1 : 0;
  double sum = 0;
  for (std::size_t i = 0; i < px1.size(); ++i) {
    const Vec2 d = apply(out.H[0], px1[i]) - apply(out.H[1], px2[i]);
    sum += d[1 - along] * d[1 - along];
    out.min_disparity_px = i == 0 ? d[along] : std::min(out.min_disparity_px, d[along]);
    out.max_disparity_px = i == 0 ? d[along] : std::max(out.max_disparity_px, d[along]);
  }
  if (!px1.empty()) out.row_rms_px = std::sqrt(sum / static_cast<double>(px1.size()));
}

}  // namespace

double homography_distortion(const Mat3& H, ImageSize size) {
  const Frame frame = frame_of(size, false);
  const Mat3 Hn = frame.from_px * H * frame.from_px.inverse();
  double sum = 0;
  const auto grid = grid_of(frame.half);
  for (const Vec2& p : grid) {
    const Mat2 J = jacobian(Hn, p);
    sum += (J - nearest_turn(J)).squaredNorm();
  }
  return std::sqrt(sum / (2.0 * static_cast<double>(grid.size())));
}

Result<UncalibratedRectification> rectify_uncalibrated(const Mat3& F, std::span<const Vec2> px1,
                                                       std::span<const Vec2> px2, ImageSize size,
                                                       const UncalibratedOptions& options) {
  PLUMBLINE_CHECK(px1.size() == px2.size(), "each point needs its partner");
  bool finite = F.allFinite() && size.width > 0 && size.height > 0;
  for (std::size_t i = 0; i < px1.size(); ++i) finite = finite && px1[i].allFinite() && px2[i].allFinite();
  if (!finite) return Error{ErrorCode::kInvalidData, "F, a point or the size of the image is no number", ""};

  const Frame upright = frame_of(size, false);
  const Mat3 to_px = upright.from_px.inverse();
  const Svd3 first = svd3(to_px.transpose() * F * to_px);
  if (!(first.s[1] > 1e-9 * first.s[0])) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("F has rank 1: its second singular value is {:.1e} of the first",
                             first.s[1] / first.s[0]),
                 ""};
  }
  // The epipoles of the singular F that is nearest in these coordinates.
  Svd3 px = first;
  px.V.col(2) = to_px * first.V.col(2);
  px.U.col(2) = to_px * first.U.col(2);
  if (Status s = check_epipoles(px, size); !s) return s.error();

  UncalibratedRectification out;
  out.vertical = std::abs(first.V(1, 2)) > std::abs(first.V(0, 2));
  const Frame frame = frame_of(size, out.vertical);
  const Mat3 back = frame.from_px.inverse();
  Svd3 svd = svd3(back.transpose() * F * back);
  const Mat3 F2 = svd.U.leftCols<2>() * svd.s.head<2>().asDiagonal() * svd.V.leftCols<2>().transpose();
  auto best = least_distorted(Family(F2 / svd.s[0], svd, frame.half));
  if (!best) {
    return Error{
        ErrorCode::kDegenerate,
        "every epipolar line or its partner crosses an image: the epipoles are too near to the images "
        "for homographies to match the rows; a polar rectification is needed",
        ""};
  }
  const bool fitted = options.rows == RowFreedom::kLeastDisparity;
  if (fitted) {
    std::vector<Vec2> a, b;
    for (std::size_t i = 0; i < px1.size(); ++i) {
      a.push_back(apply(frame.from_px, px1[i]));
      b.push_back(apply(frame.from_px, px2[i]));
    }
    if (Status s = fit_columns(best->H[0], best->H[1], a, b); !s) return s.error();
  }
  centre(best->H, fitted);
  const Vec3 middle = upright.from_px.inverse() * Vec3::UnitZ();
  for (int i = 0; i < 2; ++i) {
    out.H[i] = back * best->H[i] * frame.from_px;
    out.H[i] /= out.H[i].row(2).dot(middle);
  }
  measure(out, px1, px2, size);
  return out;
}

}  // namespace plumbline

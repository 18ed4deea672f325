// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/zhang.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

// Below this ratio of the last determined singular value to the first, the views leave K open.
constexpr double kMinRatio = 1e-5;
// Below this foreshortening (1 - cos tilt; 2 to 3 degrees of tilt) a board counts as parallel to the image:
// with corners good to 0.1 px the noise of a homography is as large.
constexpr double kMinForeshortening = 1e-3;

// Pixels to an image whose middle is 0 and where unit_px is 1.
Mat3 image_normalisation(ImageSize size, double unit_px) {
  Mat3 N;
  N << 1, 0, -0.5 * (size.width - 1), 0, 1, -0.5 * (size.height - 1), 0, 0, unit_px;
  return N / unit_px;
}

// [h1 h2] of a view in the normalised image, of unit size.
Eigen::Matrix<double, 3, 2> unit_columns(const Mat3& H_px_board, const Mat3& N) {
  const Eigen::Matrix<double, 3, 2> h = N * H_px_board.leftCols<2>();
  return h / h.norm();
}

using Row5 = Eigen::Matrix<double, 1, 5>;

// Coefficients of (B11, B22, B13, B23, B33) in u' B v, the conic of a camera without skew.
Row5 conic_row(const Vec3& u, const Vec3& v) {
  return {u.x() * v.x(), u.y() * v.y(), u.x() * v.z() + u.z() * v.x(), u.y() * v.z() + u.z() * v.y(),
          u.z() * v.z()};
}

bool all_finite(std::span<const Mat3> H) {
  return std::all_of(H.begin(), H.end(),
                     [](const Mat3& h) { return h.allFinite() && h.leftCols<2>().norm() > 0; });
}

Error degenerate(std::string text) {
  return {ErrorCode::kDegenerate, std::move(text), "intrinsics from homographies"};
}

Error not_finite() {
  return {ErrorCode::kInvalidData,
          "a homography is zero or holds a number that is not finite; leave that view out",
          "intrinsics from homographies"};
}

}  // namespace

Result<Mat3> zhang_k(std::span<const Mat3> H_px_board, ImageSize size) {
  PLUMBLINE_CHECK(H_px_board.size() >= 2, "zhang_k needs 2 or more homographies");
  PLUMBLINE_CHECK(size.width > 0 && size.height > 0, "zhang_k needs the size of the image");
  if (!all_finite(H_px_board)) return not_finite();
  const auto focal_px = zhang_focal(H_px_board, size);
  if (!focal_px) return focal_px.error();
  // With the focal length as the unit, the singular values speak of the tilt of the boards and not of the
  // zoom.
  const Mat3 N = image_normalisation(size, *focal_px);
  MatX V(2 * static_cast<Eigen::Index>(H_px_board.size()), 5);
  for (std::size_t i = 0; i < H_px_board.size(); ++i) {
    const auto h = unit_columns(H_px_board[i], N);
    const Eigen::Index row = 2 * static_cast<Eigen::Index>(i);
    // With the factor 2 the pair of equations turns as a vector when the board turns in its plane, so that
    // the solution does not depend on which way its axes point.
    V.row(row) = 2 * conic_row(h.col(0), h.col(1));
    V.row(row + 1) = conic_row(h.col(0), h.col(0)) - conic_row(h.col(1), h.col(1));
  }
  const NullVector null = null_vector(V);
  const double ratio = null.singular_values[3] / null.singular_values[0];
  if (!(ratio >= kMinRatio)) {
    return degenerate(fmt::format(
        "{} views do not constrain K: the boards are parallel to one another (singular value ratio {:.2g}, "
        "at least "
        "{:.0e} is needed); add views of the board tilted by 20 to 45 degrees about different axes",
        H_px_board.size(), ratio, kMinRatio));
  }
  const VecX B = null.v[0] < 0 ? VecX(-null.v) : null.v;
  const double cx = -B[2] / B[0], cy = -B[3] / B[1], scale = B[4] - B[2] * B[2] / B[0] - B[3] * B[3] / B[1];
  if (!(B[0] > 0 && B[1] > 0 && scale > 0)) {
    return degenerate(
        fmt::format("the conic of {} views is not positive definite (singular value ratio {:.2g}): noise or "
                    "lens distortion is "
                    "larger than the perspective of the boards; add views tilted by 20 to 45 degrees",
                    H_px_board.size(), ratio));
  }
  Mat3 K;
  K << std::sqrt(scale / B[0]), 0, cx, 0, std::sqrt(scale / B[1]), cy, 0, 0, 1;
  return Mat3(N.inverse() * K);
}

Result<double> zhang_focal(std::span<const Mat3> H_px_board, ImageSize size) {
  PLUMBLINE_CHECK(!H_px_board.empty(), "zhang_focal needs a homography");
  PLUMBLINE_CHECK(size.width > 0 && size.height > 0, "zhang_focal needs the size of the image");
  if (!all_finite(H_px_board)) return not_finite();
  const double unit_px = 0.5 * std::max(size.width, size.height);
  const Mat3 N = image_normalisation(size, unit_px);
  // Each view gives  across + f^2 along = 0  twice. The perspective part `along` is the product of small,
  // well measured numbers and carries less noise than `across`, so `across` is regressed on it.
  double along_across = 0, along_along = 0, across_across = 0;
  for (const Mat3& H : H_px_board) {
    const auto h = unit_columns(H, N);
    const Vec3 u = h.col(0), v = h.col(1);
    const Vec2 across(2 * u.head<2>().dot(v.head<2>()),
                      u.head<2>().squaredNorm() - v.head<2>().squaredNorm());
    const Vec2 along(2 * u.z() * v.z(), u.z() * u.z() - v.z() * v.z());
    along_across += along.dot(across);
    along_along += along.squaredNorm();
    across_across += across.squaredNorm();
  }
  const double foreshortening = std::sqrt(across_across / static_cast<double>(H_px_board.size()));
  if (!(foreshortening >= kMinForeshortening)) {
    return degenerate(
        fmt::format("{} views do not constrain K: all boards are parallel to the image (foreshortening "
                    "{:.2g}, at least {:.0e} is "
                    "needed); add views of the board tilted by 20 to 45 degrees about different axes",
                    H_px_board.size(), foreshortening, kMinForeshortening));
  }
  const double f2 = -along_across / along_along;
  if (!(f2 > 0) || !std::isfinite(f2)) {
    return degenerate(fmt::format(
        "{} views give no focal length (f^2 is {:.2g} half images squared): noise or lens distortion is "
        "larger than "
        "the perspective of the boards; add views tilted by 20 to 45 degrees, closer to the camera",
        H_px_board.size(), f2));
  }
  return std::sqrt(f2) * unit_px;
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/zhang.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

using Mat32 = Eigen::Matrix<double, 3, 2>;
using Row5 = Eigen::Matrix<double, 1, 5>;
using Vec5 = Eigen::Matrix<double, 5, 1>;

// Columns h1, h2 of a homography are good to about this fraction of their length at best: corners to 0.05 px
// on a board that spans 300 px. Views that would not hold K under it are refused even when they are free of
// noise.
constexpr double kColumnNoise = 1e-4;
// With more than this the residuals speak of lens distortion rather than of noise.
constexpr double kMaxColumnNoise = 2e-3;
// The vanishing lines of the boards must differ by this many times the noise of a homography's columns. The
// line is the worst determined part of a homography, and fitting a conic to lines that are noise gives a K
// that is wrong and looks certain.
constexpr double kLinesOverNoise = 10;
// The fallback with one focal length believes in square pixels and a centred axis to this fraction.
constexpr double kSquare = 0.01;
// Largest uncertainty of K that is passed on, as a fraction of the focal length.
constexpr double kMaxUncertainty = 0.5;
// Below this ratio of the last determined singular value to the first, the uncertainty itself cannot be
// computed.
constexpr double kMinRatio = 1e-7;

constexpr const char* kAdvice = "add views of the board tilted by 20 to 45 degrees about different axes";

// Pixels to an image whose middle is 0 and where half the larger side is 1.
Mat3 image_normalisation(ImageSize size) {
  const double unit_px = 0.5 * std::max(size.width, size.height);
  Mat3 N;
  N << 1, 0, -0.5 * (size.width - 1), 0, 1, -0.5 * (size.height - 1), 0, 0, unit_px;
  return N / unit_px;
}

// [h1 h2] of each view in the normalised image, of unit size.
std::vector<Mat32> unit_columns(std::span<const Mat3> H_px_board, const Mat3& N) {
  std::vector<Mat32> views;
  for (const Mat3& H : H_px_board) {
    const Mat32 h = N * H.leftCols<2>();
    views.push_back(h / h.norm());
  }
  return views;
}

// Coefficients of (B11, B22, B13, B23, B33) in u' B v, the conic of a camera without skew.
Row5 conic_row(const Vec3& u, const Vec3& v) {
  return {u.x() * v.x(), u.y() * v.y(), u.x() * v.z() + u.z() * v.x(), u.y() * v.z() + u.z() * v.y(),
          u.z() * v.z()};
}

Mat3 conic(const Vec5& B) {
  Mat3 C;
  C << B[0], 0, B[2], 0, B[1], B[3], B[2], B[3], B[4];
  return C;
}

bool usable(std::span<const Mat3> H) {
  return std::all_of(H.begin(), H.end(),
                     [](const Mat3& h) { return h.allFinite() && h.leftCols<2>().norm() > 0; });
}

Error degenerate(std::string text) {
  return {ErrorCode::kDegenerate, std::move(text), "intrinsics from homographies"};
}

Error not_usable() {
  return {ErrorCode::kInvalidData,
          "a homography is zero or holds a number that is not finite; leave that view out",
          "intrinsics from homographies"};
}

// What a camera without skew is, as a function of its conic, with gradients.
struct ConicCamera {
  double fx2, fy2, cx, cy;
  Eigen::Matrix<double, 4, 5> J;  // d(log fx, log fy, cx / fx, cy / fy) / dB
};

std::optional<ConicCamera> conic_camera(const Vec5& B) {
  const double scale = B[4] - B[2] * B[2] / B[0] - B[3] * B[3] / B[1];
  if (!(B[0] > 0 && B[1] > 0 && scale > 0)) return std::nullopt;
  ConicCamera c{scale / B[0], scale / B[1], -B[2] / B[0], -B[3] / B[1], {}};
  const Row5 d_scale(c.cx * c.cx, c.cy * c.cy, 2 * c.cx, 2 * c.cy, 1);
  c.J.row(0) = 0.5 * (d_scale / scale - Row5::Unit(0) / B[0]);
  c.J.row(1) = 0.5 * (d_scale / scale - Row5::Unit(1) / B[1]);
  c.J.row(2) = -(Row5::Unit(2) + c.cx * Row5::Unit(0)) / (B[0] * std::sqrt(c.fx2));
  c.J.row(3) = -(Row5::Unit(3) + c.cy * Row5::Unit(1)) / (B[1] * std::sqrt(c.fy2));
  return c;
}

// Standard deviations of the rows of V B under unit noise of the columns: the residual u' C v moves by
// du' C v + u' C dv.
VecX row_noise(const std::vector<Mat32>& views, const Mat3& C) {
  VecX e(2 * static_cast<Eigen::Index>(views.size()));
  for (std::size_t i = 0; i < views.size(); ++i) {
    const double s = 2 * (C * views[i]).norm();
    e.segment<2>(2 * static_cast<Eigen::Index>(i)).setConstant(s);
  }
  return e;
}

// What the residuals say about the noise of the columns, not below what corners allow.
double column_noise(const VecX& residuals, const VecX& e, Eigen::Index n_parameters) {
  const Eigen::Index freedom = residuals.size() - n_parameters;
  if (freedom <= 0) return kColumnNoise;
  return std::max(kColumnNoise, residuals.cwiseQuotient(e).norm() / std::sqrt(static_cast<double>(freedom)));
}

// The largest standard deviation among log fx, log fy, cx / fx, cy / fy, to first order in the noise of the
// columns. Hartley & Zisserman 2004, section 5.2.
double uncertainty(const MatX& V, const ConicCamera& camera, const VecX& e) {
  const SymEigen eigen = sym_eigen(V.transpose() * V);
  // Pseudo-inverse of V'V on the complement of B.
  MatX inverse = MatX::Zero(5, 5);
  for (int k = 1; k < 5; ++k)
    inverse += eigen.vectors.col(k) * eigen.vectors.col(k).transpose() / eigen.values[k];
  return (camera.J * inverse * V.transpose() * e.asDiagonal()).rowwise().norm().maxCoeff();
}

// RMS distance of the boards' vanishing lines from their mean: zero for parallel boards.
double vanishing_line_spread(const std::vector<Mat32>& views) {
  MatX l(3, static_cast<Eigen::Index>(views.size()));
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Vec3 line = views[i].col(0).cross(views[i].col(1)).normalized();
    l.col(static_cast<Eigen::Index>(i)) = line.z() < 0 ? Vec3(-line) : line;
  }
  const MatX apart = l.colwise() - VecX(l.rowwise().mean());
  return apart.norm() / std::sqrt(static_cast<double>(views.size()));
}

}  // namespace

Result<Mat3> zhang_k(std::span<const Mat3> H_px_board, ImageSize size) {
  PLUMBLINE_CHECK(H_px_board.size() >= 2, "zhang_k needs 2 or more homographies");
  PLUMBLINE_CHECK(size.width > 0 && size.height > 0, "zhang_k needs the size of the image");
  if (!usable(H_px_board)) return not_usable();
  const Mat3 N = image_normalisation(size);
  const std::vector<Mat32> views = unit_columns(H_px_board, N);
  MatX V(2 * static_cast<Eigen::Index>(views.size()), 5);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Vec3 u = views[i].col(0), v = views[i].col(1);
    // With the factor 2 the pair of equations turns as a vector when the board turns in its plane, so that
    // the solution does not depend on which way its axes point.
    V.row(2 * static_cast<Eigen::Index>(i)) = 2 * conic_row(u, v);
    V.row(2 * static_cast<Eigen::Index>(i) + 1) = conic_row(u, u) - conic_row(v, v);
  }
  const NullVector null = null_vector(V);
  const double ratio = null.singular_values[3] / null.singular_values[0];
  if (!(ratio >= kMinRatio)) {
    return degenerate(
        fmt::format("{} views do not constrain K: the boards are parallel to one another or to the image "
                    "(singular value ratio {:.2g}, at least {:.0e} is needed); {}",
                    views.size(), ratio, kMinRatio, kAdvice));
  }
  const Vec5 B = null.v[0] < 0 ? VecX(-null.v) : null.v;
  const auto camera = conic_camera(B);
  if (!camera) {
    return degenerate(
        fmt::format("the conic of {} views is not positive definite (singular value ratio {:.2g}): the "
                    "boards are parallel to one another or to the image, or lens distortion is larger than "
                    "their perspective; {}",
                    views.size(), ratio, kAdvice));
  }
  const VecX e = row_noise(views, conic(B));
  const double noise = column_noise(V * B, e, 4), spread = vanishing_line_spread(views);
  const double least = kLinesOverNoise * std::min(noise, kMaxColumnNoise);
  if (!(spread >= least)) {
    return degenerate(
        fmt::format("{} views do not constrain K: the boards are parallel to one another or to the image "
                    "(their vanishing lines differ by {:.2g}, at least {:.2g} is needed); {}",
                    views.size(), spread, least, kAdvice));
  }
  const double sigma = noise * uncertainty(V, *camera, e);
  if (!(sigma <= kMaxUncertainty)) {
    return degenerate(
        fmt::format("{} views do not constrain K: its uncertainty is {:.0f} % of the focal length, at most "
                    "{:.0f} % is useful (singular value ratio {:.2g}); the boards are nearly parallel to "
                    "one another or to the image; {}",
                    views.size(), 100 * sigma, 100 * kMaxUncertainty, ratio, kAdvice));
  }
  Mat3 K;
  K << std::sqrt(camera->fx2), 0, camera->cx, 0, std::sqrt(camera->fy2), camera->cy, 0, 0, 1;
  return Mat3(N.inverse() * K);
}

Result<double> zhang_focal(std::span<const Mat3> H_px_board, ImageSize size) {
  PLUMBLINE_CHECK(!H_px_board.empty(), "zhang_focal needs a homography");
  PLUMBLINE_CHECK(size.width > 0 && size.height > 0, "zhang_focal needs the size of the image");
  if (!usable(H_px_board)) return not_usable();
  const Mat3 N = image_normalisation(size);
  const std::vector<Mat32> views = unit_columns(H_px_board, N);
  // Each view gives  across + f^2 along = 0  twice. The perspective part `along` is the product of small,
  // well measured numbers and carries less noise than `across`, so `across` is regressed on it.
  const Eigen::Index rows = 2 * static_cast<Eigen::Index>(views.size());
  VecX across(rows), along(rows);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Vec3 u = views[i].col(0), v = views[i].col(1);
    const Eigen::Index row = 2 * static_cast<Eigen::Index>(i);
    across.segment<2>(row) << 2 * u.head<2>().dot(v.head<2>()),
        u.head<2>().squaredNorm() - v.head<2>().squaredNorm();
    along.segment<2>(row) << 2 * u.z() * v.z(), u.z() * u.z() - v.z() * v.z();
  }
  const double f2 = -along.dot(across) / along.squaredNorm();
  if (!(f2 > 0) || !std::isfinite(f2)) {
    return degenerate(
        fmt::format("{} views give no focal length (f^2 is {:.2g} half images squared): the boards are "
                    "parallel to the image, or lens distortion is larger than their perspective; {}",
                    views.size(), f2, kAdvice));
  }
  const VecX e = row_noise(views, Vec3(1, 1, f2).asDiagonal());
  const double noise = column_noise(across + f2 * along, e, 1);
  const double sigma =
      0.5 * (noise * along.cwiseProduct(e).norm() + kSquare * along.lpNorm<1>()) / (f2 * along.squaredNorm());
  if (!(sigma <= kMaxUncertainty)) {
    return degenerate(
        fmt::format("{} views do not determine a focal length: its uncertainty is {:.0f} %, at most "
                    "{:.0f} % is useful; the boards are nearly parallel to the image; {}",
                    views.size(), 100 * sigma, 100 * kMaxUncertainty, kAdvice));
  }
  return std::sqrt(f2) / N(0, 0);
}

}  // namespace plumbline

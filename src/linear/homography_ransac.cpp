// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "linear/consensus.hpp"
#include "linear/degeneracy.hpp"
#include "plumbline/linear/homography.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "homography by consensus";
constexpr int kSample = 4;
// Area of the smallest of a sample's four triangles over the square of its extent; rounding has the say
// below.
constexpr double kFlatTriangle = 1e-9;

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

// [p1 p2 p3] diag(weight) takes the corners of the projective plane's reference triangle to p1, p2, p3 and
// its unit point to the origin, where the sample's fourth point has been moved.
struct Triangle {
  std::array<Vec2, 3> p;
  Vec3 weight;
  double area;
};

std::optional<Triangle> triangle(const std::array<Vec2, kSample>& q) {
  Triangle t{{q[0] - q[3], q[1] - q[3], q[2] - q[3]}, {}, 0};
  t.weight = {cross(t.p[1], t.p[2]), cross(t.p[2], t.p[0]), cross(t.p[0], t.p[1])};
  t.area = t.weight.sum();
  const double extent = t.p[0].squaredNorm() + t.p[1].squaredNorm() + t.p[2].squaredNorm();
  const double smallest = std::min(t.weight.cwiseAbs().minCoeff(), std::abs(t.area));
  if (!(smallest > kFlatTriangle * extent)) return std::nullopt;
  return t;
}

// The points as four arrays, which the compiler takes two at a time.
struct Points {
  Eigen::ArrayXd ax, ay, bx, by;
};

void transfer_errors(const Mat3& H, const Points& p, int first, std::span<double> e2) {
  const Eigen::Index n = static_cast<Eigen::Index>(e2.size());
  const auto ax = p.ax.segment(first, n), ay = p.ay.segment(first, n);
  constexpr Eigen::Index kBlock = 128;
  Eigen::Array<double, Eigen::Dynamic, 1, 0, kBlock, 1> w, x, y;
  for (Eigen::Index at = 0; at < n; at += kBlock) {
    const Eigen::Index m = std::min(kBlock, n - at);
    const auto u = ax.segment(at, m), v = ay.segment(at, m);
    w = H(2, 0) * u + H(2, 1) * v + H(2, 2);
    x = (H(0, 0) * u + H(0, 1) * v + H(0, 2)) / w - p.bx.segment(first + at, m);
    y = (H(1, 0) * u + H(1, 1) * v + H(1, 2)) / w - p.by.segment(first + at, m);
    Eigen::Map<Eigen::ArrayXd>(e2.data() + at, m) =
        (w > 0).select(x.square() + y.square(), std::numeric_limits<double>::infinity());
  }
}

Points as_points(std::span<const Vec2> a, std::span<const Vec2> b) {
  const auto n = static_cast<Eigen::Index>(a.size());
  Points points{Eigen::ArrayXd(n), Eigen::ArrayXd(n), Eigen::ArrayXd(n), Eigen::ArrayXd(n)};
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vec2 &p = a[static_cast<std::size_t>(i)], &q = b[static_cast<std::size_t>(i)];
    points.ax[i] = p.x(), points.ay[i] = p.y(), points.bx[i] = q.x(), points.by[i] = q.y();
  }
  return points;
}

Result<Mat3> fit(std::span<const Vec2> a, std::span<const Vec2> b, std::span<const int> members) {
  std::vector<Vec2> pa, pb;
  for (const int i : members) {
    pa.push_back(a[static_cast<std::size_t>(i)]);
    pb.push_back(b[static_cast<std::size_t>(i)]);
  }
  return homography(pa, pb);
}

// A point unrelated to H falls into the circle of the farthest inlier with the circle's share of a square
// that holds the points: 6 times their squared RMS distance from the centroid.
std::optional<Error> refuse_chance(const Found<Mat3>& found, const Points& points) {
  const int n = static_cast<int>(points.ax.size());
  if (n == kSample) return std::nullopt;
  std::vector<double> e2(static_cast<std::size_t>(n));
  transfer_errors(found.model, points, 0, e2);
  double farthest = 0;
  for (const int i : detail::inlier_indices(found.consensus))
    farthest = std::max(farthest, e2[static_cast<std::size_t>(i)]);
  const double spread =
      (points.bx - points.bx.mean()).square().mean() + (points.by - points.by.mean()).square().mean();
  const double share = std::min(1.0, std::numbers::pi * farthest / (6 * spread));
  const int needed = kSample + detail::needed_beyond_chance(n - kSample, share, found.consensus.n_hypotheses);
  if (found.consensus.n_inliers >= needed) return std::nullopt;
  return Error{
      ErrorCode::kDegenerate,
      fmt::format(
          "no homography has more inliers than chance gives: {} of {} correspondences, at least {} are "
          "needed after {} samples; the points do not correspond, or are not those of one plane",
          found.consensus.n_inliers, n, needed, found.consensus.n_hypotheses),
      kWhere};
}

}  // namespace

std::optional<Mat3> homography_from_four(const std::array<Vec2, 4>& a, const std::array<Vec2, 4>& b) {
  const auto ta = triangle(a), tb = triangle(b);
  if (!ta || !tb) return std::nullopt;
  // H = [b1 b2 b3] diag(weight b / weight a) [a1 a2 a3]^-1; the ratios are w at the corners, w at the fourth
  // point is 1 after division by the areas.
  const Vec3 ratio = tb->weight.cwiseQuotient(ta->weight) * (ta->area / tb->area);
  if (!(ratio.minCoeff() > 0)) return std::nullopt;
  Mat3 H = Mat3::Zero();
  for (int i = 0; i < 3; ++i) {
    const Vec2 &p = ta->p[static_cast<std::size_t>((i + 1) % 3)],
               &q = ta->p[static_cast<std::size_t>((i + 2) % 3)];
    const Vec3 row(p.y() - q.y(), q.x() - p.x(), ta->weight[i]);  // p x q, a row of the adjugate
    H += ratio[i] * tb->p[static_cast<std::size_t>(i)].homogeneous() * row.transpose();
  }
  H.col(2) -= H.leftCols<2>() * a[3];
  H.topRows<2>() += b[3] * H.row(2);
  const double scale = (ta->area < 0 ? -1 : 1) / H.norm();
  return Mat3(scale * H);
}

Result<Found<Mat3>> homography_ransac(std::span<const Vec2> a, std::span<const Vec2> b,
                                      const RansacOptions& options) {
  PLUMBLINE_CHECK(a.size() == b.size() && a.size() >= 4,
                  "homography_ransac needs as many points in a as in b, 4 or more");
  const Points points = as_points(a, b);
  if (!points.ax.allFinite() || !points.ay.allFinite() || !points.bx.allFinite() || !points.by.allFinite()) {
    return Error{ErrorCode::kInvalidData, "a coordinate is not a finite number; remove that point", kWhere};
  }
  auto found = detail::find_consensus<Mat3>(
      static_cast<int>(a.size()), kSample, options,
      [&](std::span<const int> s, std::vector<Mat3>& out) {
        std::array<Vec2, kSample> pa, pb;
        for (std::size_t k = 0; k < kSample; ++k) {
          pa[k] = a[static_cast<std::size_t>(s[k])];
          pb[k] = b[static_cast<std::size_t>(s[k])];
        }
        if (const auto H = homography_from_four(pa, pb)) out.push_back(*H);
      },
      [&](const Mat3& H, int first, std::span<double> e2) { transfer_errors(H, points, first, e2); },
      [&](const Mat3&, std::span<const int> inliers) -> std::optional<Mat3> {
        if (inliers.size() < kSample) return std::nullopt;
        const auto H = fit(a, b, inliers);
        return H ? std::optional<Mat3>(*H) : std::nullopt;
      });
  if (!found) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("no four of the {} correspondences that were drawn have a homography that keeps them "
                    "on one side of its horizon: the points lie on a line, or do not correspond",
                    a.size()),
        kWhere};
  }
  if (const auto e = refuse_chance(*found, points)) return *e;
  // Whether the inliers determine H, with homography()'s own reasons.
  if (const auto H = fit(a, b, detail::inlier_indices(found->consensus)); !H) return H.error();
  return std::move(*found);
}

}  // namespace plumbline

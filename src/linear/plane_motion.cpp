// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/plane_motion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "motions of a plane";
// The singular values of a metric homography with translation t differ by about |t| / d.
constexpr double kRotation = 1e-9;
// A difference of squared singular values below this is rounding; its square root would turn it into a
// difference of 1e-8 between two answers that are one.
constexpr double kSame = 1e-13;

Mat3 frame(const Vec3& a, const Vec3& b) { return (Mat3() << a, b, a.cross(b)).finished(); }

}  // namespace

Result<std::vector<PlaneMotion>> plane_motions(const Mat3& H, const Mat3& K1, const Mat3& K2) {
  if (!H.allFinite() || !K1.allFinite() || !K2.allFinite()) {
    return Error{ErrorCode::kInvalidData, "H, K1 or K2 holds a number that is not finite", kWhere};
  }
  Mat3 A = K2.inverse() * H * K1;
  Svd3 d = svd3(A);
  if (!(d.s[2] > 1e-12 * d.s[0])) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("the homography is singular (singular value ratio {:.2g}, at least 1e-12 is "
                             "needed): a camera lies in the plane",
                             d.s[0] > 0 ? d.s[2] / d.s[0] : 0.0),
                 kWhere};
  }
  // R + (t/d) n' has the middle singular value 1, and its determinant is the ratio of the cameras' distances
  // from the plane, above 0 when they are on the same side.
  const double scale = std::copysign(1 / d.s[1], A.determinant());
  A *= scale;
  d.s /= d.s[1];
  if (d.s[0] - d.s[2] < kRotation) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the homography is that of a pure rotation (its singular values differ by {:.2g}, "
                    "at least {:.0e} is needed), which shows no plane; use rotation_from_homography, "
                    "or move the camera",
                    d.s[0] - d.s[2], kRotation),
        kWhere};
  }
  const double s1 = d.s[0] * d.s[0], s3 = d.s[2] * d.s[2];
  const double above = s1 - 1 > kSame ? s1 - 1 : 0.0, below = 1 - s3 > kSame ? 1 - s3 : 0.0;
  const Vec3 v2 = d.V.col(1);
  std::vector<PlaneMotion> motions;
  // The two directions across v2 whose length A keeps; with v2 they span the two candidates for the plane.
  for (const double sign : {1.0, -1.0}) {
    const Vec3 u =
        (std::sqrt(below) * d.V.col(0) + sign * std::sqrt(above) * d.V.col(2)) / std::sqrt(above + below);
    const Mat3 R = nearest_rotation(frame(A * v2, A * u) * frame(v2, u).transpose());
    const Vec3 n = v2.cross(u), t = (A - R) * n;
    motions.push_back({R, t, n});
    motions.push_back({R, -t, -n});
    if (above == 0 || below == 0) break;
  }
  return motions;
}

std::vector<PlaneMotion> visible_plane_motions(std::span<const PlaneMotion> motions, const Mat3& K1,
                                               std::span<const Vec2> px1) {
  PLUMBLINE_CHECK(!px1.empty(), "visible_plane_motions needs the pixels of points of the plane");
  const Mat3 K1_inverse = K1.inverse();
  std::vector<PlaneMotion> visible;
  for (const PlaneMotion& m : motions) {
    const bool all = std::all_of(px1.begin(), px1.end(), [&](const Vec2& px) {
      const Vec3 ray = K1_inverse * px.homogeneous();
      const double along = m.normal_1.dot(ray);  // the point is ray d / along
      return along > 0 && m.R.row(2).dot(ray) + m.t_over_d.z() * along > 0;
    });
    if (all) visible.push_back(m);
  }
  return visible;
}

}  // namespace plumbline

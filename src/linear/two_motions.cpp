// SPDX-License-Identifier: Apache-2.0
#include "linear/two_motions.hpp"

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline::detail {

std::array<Mat3, 2> two_motions_of_plane(const Mat3& H) {
  const Svd3 d = svd3(H);
  const Mat3 M = (H.determinant() < 0 ? -1 : 1) / d.s[1] * H;  // the middle singular value of R + t n' is 1
  const double s1 = d.s[0] / d.s[1], s3 = d.s[2] / d.s[1];
  const Vec3 v1 = d.V.col(0), v2 = d.V.col(1), v3 = d.V.col(2);
  // u: the direction in the plane across v2 whose length M keeps, one of two.
  const double along = std::sqrt(std::max(0.0, 1 - s3 * s3)), across = std::sqrt(std::max(0.0, s1 * s1 - 1));
  std::array<Mat3, 2> out;
  for (const int k : {0, 1}) {
    const Vec3 u = (along * v1 + (k == 0 ? across : -across) * v3).normalized();
    Mat3 U, W;
    U << v2, u, v2.cross(u);
    W << M * v2, M * u, (M * v2).cross(M * u);
    const Mat3 R = nearest_rotation(W * U.transpose());
    const Vec3 t = (M - R) * v2.cross(u);
    out[static_cast<std::size_t>(k)] = skew(t.normalized()) * R;
  }
  return out;
}

}  // namespace plumbline::detail

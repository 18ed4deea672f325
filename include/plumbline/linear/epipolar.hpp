// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <utility>

#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"

/// What follows from a fundamental or an essential matrix, and where one comes from when the cameras are
/// known. Camera 1 is the reference of the two views: x_2 = R x_1 + t with T_2_1 = {R, t}, and
/// [px2; 1]' F [px1; 1] = 0,  ray_2' E ray_1 = 0,  E = [t]_x R,  F = K2^-T E K1^-1.
/// Source: Hartley & Zisserman (2004), chapter 9.
namespace plumbline {

/// The images of each camera's centre in the other view, unit homogeneous 3-vectors (last entry 0: at
/// infinity). F e1 = 0 and e2' F = 0: the right and the left null vector of F.
struct Epipoles {
  Vec3 e1;  ///< the centre of camera 2 in image 1, up to sign
  Vec3 e2;  ///< the centre of camera 1 in image 2, up to sign
};
Epipoles epipoles(const Mat3& F);

/// The line in image 2 on which the partner of px1 lies, [a b c] with a^2 + b^2 = 1, so that
/// line.dot([px2; 1]) is the signed distance of px2 from it [px]. The zero vector where px1 is the epipole
/// and every line goes through it; [0 0 1] for the line at infinity.
Vec3 epipolar_line_2(const Mat3& F, const Vec2& px1);

/// The line in image 1 on which the partner of px2 lies, as above.
Vec3 epipolar_line_1(const Mat3& F, const Vec2& px2);

/// The distance [px] in the space of the four coordinates of a pair to the nearest pair that fulfils F, to
/// first order (Sampson 1982; H&Z eq. 11.9), >= 0. With noise of sigma in each coordinate its root mean
/// square is sigma. 0 at both epipoles.
double sampson_distance(const Mat3& F, const Vec2& px1, const Vec2& px2);

/// sqrt((d1^2 + d2^2) / 2) of the distances of px1 and px2 from their epipolar lines [px] (H&Z eq. 11.10,
/// which is the sum of squares). With noise of sigma, equal in both images, about sqrt(2) sigma.
double symmetric_epipolar_distance(const Mat3& F, const Vec2& px1, const Vec2& px2);

/// F = K2^-T E K1^-1, |F| = 1.
Mat3 fundamental_from_essential(const Mat3& E, const Mat3& K1, const Mat3& K2);

/// The essential matrix nearest to K2' F K1: two singular values set to 1 and one to 0, so |E| = sqrt(2). The
/// sign is that of F.
Mat3 essential_from_fundamental(const Mat3& F, const Mat3& K1, const Mat3& K2);

/// E = [t]_x R of T_2_1 as it is: |E| = sqrt(2) |t|.
Mat3 essential_from_pose(const SE3& T_2_1);

/// F of two camera matrices of any scale, |F| = 1, by the determinants of two rows of each (H&Z eq. 17.3);
/// [px2; 1]' F [px1; 1] = 0. The zero matrix when both cameras have the same centre, to 1e-12 of its size.
Mat3 fundamental_from_cameras(const Mat34& P1, const Mat34& P2);

/// A pair of cameras with this F (H&Z result 9.14): P1 = [I | 0], P2 = [[e2]_x F | e2]. Every other pair
/// differs from it by a projective transform of space.
std::pair<Mat34, Mat34> canonical_cameras(const Mat3& F);

}  // namespace plumbline

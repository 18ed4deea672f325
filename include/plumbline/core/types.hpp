// SPDX-License-Identifier: Apache-2.0
#pragma once
/// The one header that includes Eigen: fixed-size aliases used in every signature of the library.
/// Nobody else includes Eigen directly, so that a missing <Eigen/Dense> cannot become a link error.
#include <Eigen/Dense>

namespace plumbline {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;
using Vec4 = Eigen::Vector4d;
using Vec6 = Eigen::Matrix<double, 6, 1>;
using VecX = Eigen::VectorXd;
using Mat2 = Eigen::Matrix2d;
using Mat3 = Eigen::Matrix3d;
using Mat4 = Eigen::Matrix4d;
using Mat6 = Eigen::Matrix<double, 6, 6>;
using Mat23 = Eigen::Matrix<double, 2, 3>;
using Mat26 = Eigen::Matrix<double, 2, 6>;
using Mat34 = Eigen::Matrix<double, 3, 4>;
using MatX = Eigen::MatrixXd;

/// Width and height of an image [px]. The image covers [-0.5, width - 0.5] x [-0.5, height - 0.5]:
/// pixel (0, 0) is the CENTRE of the top-left pixel.
struct ImageSize {
  int width = 0;
  int height = 0;
  bool operator==(const ImageSize&) const = default;
};

}  // namespace plumbline

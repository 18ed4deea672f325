// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/camera_matrix.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;
using RowMat34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
using RowMat3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

struct Scene {
  Mat3 K;
  SE3 T_cam_world;
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;
  Mat34 P() const { return K * T_cam_world.matrix34(); }
};

Scene random_scene(Rng& rng, int n, double sigma = 0) {
  Scene s;
  s.K = random_k(rng, {640, 480});
  const Mat3 R = random_rotation(rng);
  // Points in a box of 0.5 m around the world's origin, somewhere before the camera.
  const Vec3 middle_cam = rng.uniform(1.0, 2.0) * Vec3(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 1);
  s.T_cam_world = {R, middle_cam};
  for (int i = 0; i < n; ++i) {
    s.p_world.push_back(random_vec3(rng, -0.25, 0.25));
    const Vec2 px = pinhole(s.K, s.T_cam_world * s.p_world.back());
    const double dx = rng.normal(sigma);
    s.px.emplace_back(px + Vec2(dx, rng.normal(sigma)));
  }
  return s;
}

double reprojection_rms(const Mat34& P, const Scene& s) {
  double sum = 0;
  for (std::size_t i = 0; i < s.px.size(); ++i) {
    sum += ((P * s.p_world[i].homogeneous()).hnormalized() - s.px[i]).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(s.px.size()));
}

TEST(CameraMatrix, ExactWithoutNoiseDownToKRTAndTheCentre) {
  Rng rng(1);
  for (int i = 0; i < 300; ++i) {
    const Scene s = random_scene(rng, 12 + rng.index(60));
    const auto P = camera_matrix(s.p_world, s.px);
    ASSERT_TRUE(P) << P.error().text();
    EXPECT_NEAR(P->row(2).head<3>().norm(), 1, 1e-14);
    EXPECT_LT((*P - s.P()).norm() / s.P().norm(), 1e-9) << "problem " << i;
    const auto parts = decompose_camera_matrix(*P);
    ASSERT_TRUE(parts) << parts.error().text();
    EXPECT_LT((parts->K - s.K).norm() / s.K.norm(), 1e-9);
    EXPECT_LT((parts->R - s.T_cam_world.R()).norm(), 1e-9);
    EXPECT_LT((parts->t - s.T_cam_world.t()).norm(), 1e-9);
    EXPECT_LT((parts->centre - s.T_cam_world.centre()).norm(), 1e-9);
  }
}

TEST(CameraMatrix, SixPointsAreEnough) {
  Rng rng(2);
  for (int i = 0; i < 200; ++i) {
    const Scene s = random_scene(rng, 6);
    const auto P = camera_matrix(s.p_world, s.px);
    ASSERT_TRUE(P) << P.error().text();
    // Six random points may lie badly (condition 1e5 and more); what they determine is the pixels themselves.
    EXPECT_LT(reprojection_rms(*P, s), 1e-7) << "problem " << i;
  }
}

TEST(CameraMatrix, DoesNotDependOnUnitsOrOriginOfTheWorld) {
  Rng rng(3);
  for (int i = 0; i < 50; ++i) {
    const Scene s = random_scene(rng, 30, 0.3);
    std::vector<Vec3> moved;
    for (const Vec3& p : s.p_world) moved.push_back(1000 * p + Vec3(3000, -2000, 500));
    Mat4 T = Mat4::Identity();
    T.topLeftCorner<3, 3>() *= 1000;
    T.topRightCorner<3, 1>() = Vec3(3000, -2000, 500);
    const Mat34 a = camera_matrix(s.p_world, s.px).value(), b = camera_matrix(moved, s.px).value();
    EXPECT_LT(projective_distance(Mat34(b * T), a), 1e-9);
  }
}

TEST(CameraMatrix, NoiseCostsWhatTheoryAllowsAndScales) {
  // An efficient estimator of 11 parameters leaves sigma sqrt(2 (1 - 11 / 2n)); DLT is near it.
  Rng rng(4);
  const int n = 60;
  const double expected = std::sqrt(2 * (1 - 11.0 / (2 * n)));
  double last = 0;
  for (const double sigma : {0.01, 0.1, 1.0}) {
    double squared = 0, focal_error = 0;
    for (int i = 0; i < 300; ++i) {
      const Scene s = random_scene(rng, n, sigma);
      const Mat34 P = camera_matrix(s.p_world, s.px).value();
      squared += std::pow(reprojection_rms(P, s) / sigma, 2) / 300;
      focal_error += std::abs(decompose_camera_matrix(P).value().K(0, 0) / s.K(0, 0) - 1) / 300;
    }
    // 300 problems of 109 degrees of freedom: the standard deviation of this mean is 0.0054; DLT weighs by
    // depth, which costs it about 0.01.
    EXPECT_NEAR(std::sqrt(squared), expected, 0.03) << "sigma " << sigma;
    EXPECT_LT(focal_error, 0.02 * sigma) << "per pixel of noise";
    if (last > 0) {
      EXPECT_NEAR(focal_error / last, 10, 2) << "ten times the noise gives ten times the error";
    }
    last = focal_error;
  }
}

TEST(CameraMatrix, RefusesCoplanarPointsAndSaysWhatToDo) {
  Rng rng(5);
  for (const double sigma : {0.0, 0.5}) {
    for (int i = 0; i < 50; ++i) {
      Scene s = random_scene(rng, 0);
      const Mat3 R = random_rotation(rng);  // any plane, not only z = 0
      for (const Vec3& p : on_plane(grid(9, 6, 0.03))) {
        s.p_world.push_back(R * p + Vec3(0.1, 0.2, 0.3));
        const double dx = rng.normal(sigma);
        s.px.emplace_back(pinhole(s.K, s.T_cam_world * s.p_world.back()) + Vec2(dx, rng.normal(sigma)));
      }
      const auto P = camera_matrix(s.p_world, s.px);
      ASSERT_FALSE(P);
      EXPECT_EQ(P.error().code, ErrorCode::kDegenerate);
      EXPECT_THAT(P.error().text(), HasSubstr("the 54 points are coplanar (thickness over extent"));
      EXPECT_THAT(P.error().text(), HasSubstr("homographies of several flat views"));
      EXPECT_THAT(P.error().text(), HasSubstr("kDegenerate"));
    }
  }
}

TEST(CameraMatrix, RefusesAPlaneWithOnePointOffItAlsoWithNoise) {
  // With noise the last singular value but one is not small: only the leverage of the lone point tells.
  Rng rng(6);
  for (const double sigma : {0.0, 0.5}) {
    Scene s = random_scene(rng, 20, sigma);
    for (std::size_t i = 1; i < s.p_world.size(); ++i) {
      s.p_world[i].z() = 0;
      const double dx = rng.normal(sigma);
      s.px[i] = pinhole(s.K, s.T_cam_world * s.p_world[i]) + Vec2(dx, rng.normal(sigma));
    }
    const auto P = camera_matrix(s.p_world, s.px);
    ASSERT_FALSE(P) << "sigma " << sigma;
    EXPECT_EQ(P.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(P.error().message, HasSubstr("all but one of the 20 points are coplanar"));
  }
}

TEST(CameraMatrix, RefusesPointsOnALineAPlaneThroughTheCameraAndATwistedCubicThroughTheCamera) {
  Rng rng(7);
  std::vector<Vec3> line;
  for (int i = 0; i < 8; ++i) line.emplace_back(0.1 * i, 0.2 * i, 1 + 0.3 * i);
  std::vector<Vec2> px;
  for (const Vec3& p : line) px.push_back(p.hnormalized());
  EXPECT_EQ(camera_matrix(line, px).error().code, ErrorCode::kDegenerate);
  // A plane and a line through the camera centre, which is the origin here (Hartley & Zisserman
  // 2004, 22.1.2).
  std::vector<Vec3> mixed;
  for (int i = 0; i < 12; ++i) {
    const double x = rng.uniform(-1, 1), y = rng.uniform(-1, 1);
    mixed.push_back(i < 8 ? Vec3(x, y, 3 + 0.5 * x) : Vec3(0.3, -0.2, 1) * (1 + i));
  }
  // The cubic (t, t^2, t^3) shifted so that it runs through the camera centre at t = 0.
  std::vector<Vec3> cubic;
  for (int i = 0; i < 12; ++i) {
    const double t = 0.5 + 0.1 * i;
    cubic.emplace_back(t * t, t * t * t, t);
  }
  for (const auto& points : {mixed, cubic}) {
    px.clear();
    for (const Vec3& p : points) px.push_back(Vec2(500, 500).cwiseProduct(p.hnormalized()) + Vec2(320, 240));
    const auto P = camera_matrix(points, px);
    ASSERT_FALSE(P);
    EXPECT_EQ(P.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(P.error().message, HasSubstr("more than one camera matrix fits"));
  }
}

TEST(CameraMatrix, CallerBugsThrowAndNanIsInvalidData) {
  Rng rng(8);
  Scene s = random_scene(rng, 10);
  EXPECT_THROW((void)camera_matrix(std::span(s.p_world).first(5), std::span(s.px).first(5)),
               std::invalid_argument);
  EXPECT_THROW((void)camera_matrix(s.p_world, std::span(s.px).first(9)), std::invalid_argument);
  s.p_world[3].x() = std::nan("");
  EXPECT_EQ(camera_matrix(s.p_world, s.px).error().code, ErrorCode::kInvalidData);
}

TEST(CameraMatrixToRays, ExactAllAroundTheCamera) {
  Rng rng(9);
  for (int i = 0; i < 300; ++i) {
    const SE3 T(random_rotation(rng), rng.uniform(0, 0.5) * random_direction(rng));
    std::vector<Vec3> points, rays;
    for (int k = 0; k < 20; ++k) {
      points.push_back(random_vec3(rng, -1, 1));
      rays.push_back((T * points.back()).normalized());
    }
    const auto P = camera_matrix_to_rays(points, rays);
    ASSERT_TRUE(P) << P.error().text();
    EXPECT_LT((*P - T.matrix34()).norm(), 1e-9) << "problem " << i;
  }
}

TEST(CameraMatrixToRays, RefusesCoplanarPoints) {
  Rng rng(10);
  const auto points = on_plane(grid(5, 4, 0.1));
  std::vector<Vec3> rays;
  for (const Vec3& p : points) rays.push_back((p + Vec3(0, 0, 1)).normalized());
  const auto P = camera_matrix_to_rays(points, rays);
  ASSERT_FALSE(P);
  EXPECT_THAT(P.error().message, HasSubstr("coplanar"));
}

TEST(DecomposeCameraMatrix, AnyScaleAndSignGiveTheSameParts) {
  Rng rng(11);
  for (int i = 0; i < 200; ++i) {
    const Scene s = random_scene(rng, 0);
    for (const double scale : {1.0, -1.0, 1e-6, -1e6, 3.7, -0.01}) {
      const auto parts = decompose_camera_matrix(scale * s.P());
      ASSERT_TRUE(parts) << parts.error().text();
      EXPECT_LT((parts->K - s.K).norm() / s.K.norm(), 1e-12);
      EXPECT_EQ(parts->K(2, 2), 1);
      EXPECT_EQ(parts->K(1, 0), 0);
      EXPECT_EQ(parts->K(2, 0), 0);
      EXPECT_EQ(parts->K(2, 1), 0);
      EXPECT_LT((parts->R - s.T_cam_world.R()).norm(), 1e-12);
      EXPECT_NEAR(parts->R.determinant(), 1, 1e-14);
      EXPECT_LT((parts->t - s.T_cam_world.t()).norm(), 1e-12);
      EXPECT_LT((parts->T_cam_world() * parts->centre).norm(), 1e-11);
    }
  }
}

TEST(DecomposeCameraMatrix, SkewAndNegativeDepthAreKept) {
  Rng rng(12);
  Scene s = random_scene(rng, 0);
  s.K(0, 1) = 17.5;
  s.T_cam_world = {s.T_cam_world.R(), -s.T_cam_world.t()};  // what lies before it is behind it now
  const auto parts = decompose_camera_matrix(s.P()).value();
  EXPECT_NEAR(parts.K(0, 1), 17.5, 1e-9);
  EXPECT_LT((parts.t - s.T_cam_world.t()).norm(), 1e-12);
}

TEST(DecomposeCameraMatrix, AgreesWithOpenCV) {
  Rng rng(13);
  for (int i = 0; i < 200; ++i) {
    const RowMat34 P = rng.uniform(0.1, 10) * random_scene(rng, 0).P();
    cv::Mat K, R, C;
    cv::decomposeProjectionMatrix(cv::Mat(3, 4, CV_64F, const_cast<double*>(P.data())), K, R, C);
    const auto parts = decompose_camera_matrix(P).value();
    const Mat3 Kcv = RowMat3(K.ptr<double>()) / K.at<double>(2, 2);
    EXPECT_LT((parts.K - Kcv).norm() / Kcv.norm(), 1e-11);
    EXPECT_LT((parts.R - RowMat3(R.ptr<double>())).norm(), 1e-11);
    EXPECT_LT((parts.centre - Vec4(C.ptr<double>()).hnormalized()).norm(), 1e-10);
  }
}

TEST(DecomposeCameraMatrix, RefusesACameraAtInfinity) {
  Mat34 affine;
  affine << 500, 0, 0, 320, 0, 500, 0, 240, 0, 0, 0, 1;
  const auto parts = decompose_camera_matrix(affine);
  ASSERT_FALSE(parts);
  EXPECT_EQ(parts.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(parts.error().message, HasSubstr("at infinity"));
  // ... whose centre is a direction: the rows' common null vector, with w = 0.
  const Vec4 C = camera_centre(affine);
  EXPECT_NEAR(C.w(), 0, 1e-15);
  EXPECT_NEAR(std::abs(C.z()), 1, 1e-15);
}

TEST(CameraCentre, NullVectorAndClosedFormAgree) {
  Rng rng(14);
  for (int i = 0; i < 300; ++i) {
    const Mat34 P = (i % 2 ? -1 : 1) * rng.uniform(0.1, 10) * random_scene(rng, 0).P();
    const Vec4 C = camera_centre(P);
    EXPECT_NEAR(C.norm(), 1, 1e-14);
    EXPECT_GE(C.w(), 0);
    const Vec3 closed = -P.leftCols<3>().inverse() * P.col(3);
    EXPECT_LT((C.hnormalized() - closed).norm(), 1e-11 * (1 + closed.norm()));
    EXPECT_LT((P * C).norm(), 1e-12 * P.norm());
  }
}

TEST(Rq, MultipliesBackWithAPositiveDiagonal) {
  Rng rng(15);
  for (int i = 0; i < 300; ++i) {
    Mat3 M;
    for (double& m : M.reshaped()) m = rng.normal();
    const auto rq = rq_decompose(M);
    ASSERT_TRUE(rq) << rq.error().text();
    EXPECT_LT((rq->upper * rq->orthogonal - M).norm(), 1e-13 * M.norm());
    EXPECT_LT((rq->orthogonal * rq->orthogonal.transpose() - Mat3::Identity()).norm(), 1e-14);
    EXPECT_GT(rq->upper.diagonal().minCoeff(), 0);
    EXPECT_EQ(rq->upper(1, 0), 0);
    EXPECT_EQ(rq->upper(2, 0), 0);
    EXPECT_EQ(rq->upper(2, 1), 0);
    EXPECT_NEAR(rq->orthogonal.determinant(), M.determinant() > 0 ? 1 : -1, 1e-13);
  }
}

TEST(Rq, AgreesWithOpenCV) {
  Rng rng(16);
  int compared = 0;
  for (int i = 0; i < 300; ++i) {
    RowMat3 M;
    for (double& m : M.reshaped()) m = rng.normal();
    if (M.determinant() < 0) M = -M;  // OpenCV returns rotations only
    cv::Mat K, R;
    cv::RQDecomp3x3(cv::Mat(3, 3, CV_64F, M.data()), K, R);
    const auto rq = rq_decompose(M).value();
    // OpenCV makes two diagonal entries positive and leaves the sign of the third to det M.
    EXPECT_LT((rq.upper - RowMat3(K.ptr<double>())).norm(), 1e-11 * M.norm());
    EXPECT_LT((rq.orthogonal - RowMat3(R.ptr<double>())).norm(), 1e-11);
    ++compared;
  }
  EXPECT_EQ(compared, 300);
}

TEST(Rq, RefusesASingularMatrix) {
  Mat3 M;
  M << 1, 2, 3, 4, 5, 6, 7, 8, 9;
  const auto rq = rq_decompose(M);
  ASSERT_FALSE(rq);
  EXPECT_EQ(rq.error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(rq_decompose(Mat3::Zero()).error().code, ErrorCode::kDegenerate);
  // A long telephoto is not singular, although its singular values are seven decades apart.
  const Mat3 K = Vec3(1e7, 1e7, 1).asDiagonal();
  EXPECT_TRUE(rq_decompose(K));
}

}  // namespace
}  // namespace plumbline::test

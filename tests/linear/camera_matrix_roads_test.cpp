// SPDX-License-Identifier: Apache-2.0
// The three roads from P to K and R, the two to the centre, and the configurations that hide P: on many
// problems.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/geometry/image_formation.hpp"
#include "plumbline/linear/camera_matrix.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Mat34 random_camera_matrix(Rng& rng) {
  Mat3 K = random_k(rng, {640, 480});
  K(0, 1) = rng.uniform(-50, 50);
  const double scale = std::pow(10, rng.uniform(-6, 6)) * (rng.uniform() < 0.5 ? -1 : 1);
  return scale * compose_camera_matrix(K, SE3(random_rotation(rng), random_vec3(rng, -2, 2)));
}

void expect_same(const CameraMatrixParts& a, const CameraMatrixParts& b, double tolerance) {
  EXPECT_LT((a.K - b.K).norm() / a.K.norm(), tolerance);
  EXPECT_LT((a.R - b.R).norm(), tolerance);
  EXPECT_LT((a.t - b.t).norm(), tolerance * (1 + a.t.norm()));
  EXPECT_LT((a.centre - b.centre).norm(), tolerance * (1 + a.centre.norm()));
}

TEST(CameraMatrixRoads, AllThreeAgreeTo1e10OnAnyScaleSignAndSkew) {
  Rng rng(1);
  for (int i = 0; i < 10000; ++i) {
    const Mat34 P = random_camera_matrix(rng);
    const auto rq = decompose_camera_matrix(P), qr = decompose_camera_matrix_qr(P),
               cholesky = decompose_camera_matrix_cholesky(P);
    ASSERT_TRUE(rq && qr && cholesky);
    expect_same(*rq, *qr, 1e-10);
    expect_same(*rq, *cholesky, 1e-10);
    for (const auto& parts : {*rq, *qr, *cholesky}) {
      EXPECT_GT(parts.K.diagonal().minCoeff(), 0);
      EXPECT_EQ(parts.K(2, 2), 1);
      EXPECT_EQ(parts.K(1, 0), 0);
      EXPECT_NEAR(parts.R.determinant(), 1, 1e-12);
      EXPECT_LT((parts.R * parts.R.transpose() - Mat3::Identity()).norm(), 1e-12);
      const Mat34 back = compose_camera_matrix(parts.K, parts.T_cam_world());
      EXPECT_LT(projective_distance(back, P), 1e-11);
    }
  }
}

TEST(CameraMatrixRoads, AlsoOnMatricesThatNoCameraTook) {
  // Entries of unit normal: skew as large as the focal length, centre anywhere.
  Rng rng(2);
  int compared = 0;
  for (int i = 0; i < 3000; ++i) {
    Mat34 P;
    for (double& p : P.reshaped()) p = rng.normal();
    const Mat3 unit = P.leftCols<3>().rowwise().normalized();
    if (std::abs(unit.determinant()) < 0.01) continue;  // the squaring of Cholesky's road loses 1e4 of 1e16
    expect_same(decompose_camera_matrix(P).value(), decompose_camera_matrix_qr(P).value(), 1e-10);
    expect_same(decompose_camera_matrix(P).value(), decompose_camera_matrix_cholesky(P).value(), 1e-10);
    ++compared;
  }
  EXPECT_GT(compared, 2500);
}

TEST(CameraMatrixRoads, OpenCvDecomposesTheSame) {
  Rng rng(3);
  for (int i = 0; i < 100; ++i) {
    Eigen::Matrix<double, 3, 4, Eigen::RowMajor> P = random_camera_matrix(rng);
    // OpenCV's K has a negative entry for the other sign, and its RQ adds 2e-16 to squares: not for small P.
    P /= std::copysign(P.row(2).head<3>().norm(), P.leftCols<3>().determinant());
    cv::Mat K, R, C;
    cv::decomposeProjectionMatrix(cv::Mat(3, 4, CV_64F, P.data()), K, R, C);
    using Row = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    const Mat3 K_cv = Row(K.ptr<double>()) / K.at<double>(2, 2), R_cv = Row(R.ptr<double>());
    for (const auto& parts :
         {decompose_camera_matrix_qr(P).value(), decompose_camera_matrix_cholesky(P).value()}) {
      EXPECT_LT((parts.K - K_cv).norm() / K_cv.norm(), 1e-11);
      EXPECT_LT((parts.R - R_cv).norm(), 1e-11);
    }
  }
}

TEST(CameraMatrixRoads, AllRefuseACameraAtInfinity) {
  Mat34 affine;
  affine << 500, 0, 0, 320, 0, 500, 0, 240, 0, 0, 0, 1;
  EXPECT_EQ(decompose_camera_matrix_qr(affine).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(decompose_camera_matrix_cholesky(affine).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(camera_centre_by_inverse(affine).error().code, ErrorCode::kDegenerate);
  // Rows that differ by 1e-8: RQ and QR read it, M M' does not hold it.
  Mat34 narrow;
  narrow << 1e-8, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 1;
  EXPECT_TRUE(decompose_camera_matrix(narrow));
  EXPECT_TRUE(decompose_camera_matrix_qr(narrow));
  const auto cholesky = decompose_camera_matrix_cholesky(narrow);
  ASSERT_FALSE(cholesky);
  EXPECT_THAT(cholesky.error().text(), HasSubstr("decompose by RQ"));
}

TEST(CameraCentre, NullVectorAndInverseAgree) {
  Rng rng(4);
  for (int i = 0; i < 3000; ++i) {
    const Mat34 P = random_camera_matrix(rng);
    const Vec3 inverse = camera_centre_by_inverse(P).value(), null = camera_centre(P).hnormalized();
    EXPECT_LT((inverse - null).norm(), 1e-11 * (1 + null.norm()));
    EXPECT_LT((P * null.homogeneous()).norm(), 1e-12 * P.norm() * (1 + null.norm()));
  }
}

struct Seen {
  std::vector<Vec3> p;
  std::vector<Vec2> px;
  Mat34 P;
};

Seen look_at(Rng& rng, const std::vector<Vec3>& p_cam, double sigma) {
  const Mat3 K = random_k(rng, {640, 480});
  const SE3 T(random_rotation(rng), random_vec3(rng, -1, 1));
  Seen s{{}, {}, compose_camera_matrix(K, T)};
  for (const Vec3& p : p_cam) {
    s.p.push_back(T.inverse() * p);
    const double dx = rng.normal(sigma);
    s.px.push_back(pinhole(K, p) + Vec2(dx, rng.normal(sigma)));
  }
  return s;
}

TEST(CameraMatrix, TenThousandProblemsWithoutNoise) {
  Rng rng(5);
  int good = 0, wrong = 0;
  for (int i = 0; i < 10000; ++i) {
    std::vector<Vec3> p_cam;
    const Vec3 middle = rng.uniform(1, 2) * Vec3(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 1);
    for (int k = 0; k < 12; ++k) p_cam.push_back(middle + random_vec3(rng, -0.4, 0.4));
    const Seen s = look_at(rng, p_cam, 0);
    const auto P = camera_matrix(s.p, s.px);
    if (!P) continue;
    const double error = projective_distance(*P, s.P);
    good += error < 1e-9;
    wrong += error > 1e-6;
  }
  EXPECT_GE(good, 9900);
  EXPECT_EQ(wrong, 0);
}

// The cubic (t^2, t^3, t) runs through the camera centre, the origin, at t = 0; any collineation that keeps
// the origin makes another.
std::vector<Vec3> twisted_cubic(Rng& rng, int n) {
  const Mat3 A = random_rotation(rng);
  const double bend = rng.uniform(0.5, 1);
  std::vector<Vec3> points;
  for (int i = 0; i < n; ++i) {
    const double t = 0.5 + 1.5 * i / n;
    points.emplace_back(Vec3(0, 0, 1) * t + 0.3 * bend * (A * Vec3(t * t, t * t * t, 0)));
  }
  return points;
}

TEST(CameraMatrix, RefusesATwistedCubicThroughTheCamera) {
  Rng rng(6);
  for (int i = 0; i < 200; ++i) {
    const Seen s = look_at(rng, twisted_cubic(rng, 20), 0);
    const auto P = camera_matrix(s.p, s.px);
    ASSERT_FALSE(P);
    EXPECT_EQ(P.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(P.error().message, HasSubstr("twisted cubic through the camera"));
  }
}

TEST(CameraMatrix, TwistedCubicsThroughTheCameraAreRefusedAlsoWithNoise) {
  // With noise the second solution fits about as well as the first: that is what is asked for.
  Rng rng(7);
  int refused = 0, believed = 0;
  for (int i = 0; i < 200; ++i) {
    const Seen cubic = look_at(rng, twisted_cubic(rng, 30), 0.5);
    const auto P = camera_matrix(cubic.p, cubic.px);
    refused += !P && P.error().code == ErrorCode::kDegenerate;
    std::vector<Vec3> elsewhere;
    for (int k = 0; k < 30; ++k) elsewhere.push_back(Vec3(0, 0, 1.5) + random_vec3(rng, -0.5, 0.5));
    const Seen good = look_at(rng, elsewhere, 0.5);
    believed += camera_matrix(good.p, good.px).has_value();
  }
  // Both error sums are noise: the second one is over three times the first in a tenth of the cases, most of
  // them those where the second camera sees some points at little depth.
  EXPECT_GE(refused, 170);
  EXPECT_EQ(believed, 200);
}

}  // namespace
}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/hand_eye.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

constexpr double kDeg = std::numbers::pi / 180;

SE3 random_pose(Rng& rng, double turn_rad, double far_m) {
  return {so3_exp(turn_rad * random_direction(rng)), far_m * random_direction(rng)};
}

struct Problem {
  SE3 X, Y;
  std::vector<SE3> A, B;
};

// Poses of a rig before two boards: A given, B = X^-1 A Y.
Problem problem_of(std::vector<SE3> A, const SE3& X, const SE3& Y) {
  Problem p{X, Y, std::move(A), {}};
  for (const SE3& T : p.A) p.B.push_back(X.inverse() * T * Y);
  return p;
}

Problem random_problem(Rng& rng) {
  std::vector<SE3> A;
  const int n = 3 + static_cast<int>(rng.uniform(0, 12));
  const double turn = rng.uniform(0.2, std::numbers::pi);
  for (int f = 0; f < n; ++f) A.push_back(random_pose(rng, rng.uniform(0, turn), rng.uniform(0.2, 3)));
  return problem_of(std::move(A), random_pose(rng, rng.uniform(0, std::numbers::pi), rng.uniform(0, 2)),
                    random_pose(rng, rng.uniform(0, std::numbers::pi), rng.uniform(0, 5)));
}

void add_noise(std::vector<SE3>& poses, double rad, double m, Rng& rng) {
  for (SE3& T : poses) {
    Vec6 d;
    for (int i = 0; i < 6; ++i) d[i] = rng.normal(i < 3 ? rad : m);
    T = box_plus(T, d);
  }
}

TEST(HandEye, IsExactWithoutNoise) {
  Rng rng(1);
  int n_tried = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    const Problem p = random_problem(rng);
    const auto found = hand_eye(p.A, p.B);
    // The error of rounding grows with 1 / tan(spread)^2 at worst; these are well posed.
    if (turn_spread(p.A).axes_deg < 5) continue;
    ASSERT_TRUE(found) << trial << ": " << found.error().text();
    ++n_tried;
    EXPECT_LT(box_minus(found->T_cam1_cam2, p.X).norm(), 1e-9) << trial;
    EXPECT_LT(box_minus(found->T_board1_board2, p.Y).norm(), 1e-9) << trial;
    EXPECT_LT(found->rms_rad + found->rms_m, 1e-9);
  }
  EXPECT_GT(n_tried, 4000);
}

TEST(HandEye, HalfTurnsDoNotHarm) {
  // A half turn's axis has no sign: it gives no vote, and the others decide.
  Rng rng(2);
  for (int trial = 0; trial < 200; ++trial) {
    const SE3 start = random_pose(rng, 1, 1);
    std::vector<SE3> A{start};
    for (const double angle : {std::numbers::pi, std::numbers::pi - 1e-9, 0.7, 1.1})
      A.push_back(SE3(so3_exp(angle * random_direction(rng)), random_direction(rng)) * start);
    const Problem p = problem_of(A, random_pose(rng, 2, 1), random_pose(rng, 2, 1));
    const auto found = hand_eye(p.A, p.B);
    ASSERT_TRUE(found) << found.error().text();
    EXPECT_LT(box_minus(found->T_cam1_cam2, p.X).norm(), 1e-8);
  }
}

cv::Mat rotation_cv(const SE3& T) {
  cv::Mat R(3, 3, CV_64F);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) R.at<double>(r, c) = T.R()(r, c);
  }
  return R;
}
cv::Mat translation_cv(const SE3& T) { return (cv::Mat_<double>(3, 1) << T.t().x(), T.t().y(), T.t().z()); }

SE3 by_opencv(const Problem& p) {
  std::vector<cv::Mat> R1, t1, R2, t2;
  for (std::size_t f = 0; f < p.A.size(); ++f) {
    R1.push_back(rotation_cv(p.A[f]));
    t1.push_back(translation_cv(p.A[f]));
    R2.push_back(rotation_cv(p.B[f]));
    t2.push_back(translation_cv(p.B[f]));
  }
  cv::Mat R_Y, t_Y, R_X, t_X;
  cv::calibrateRobotWorldHandEye(R1, t1, R2, t2, R_Y, t_Y, R_X, t_X);
  Mat3 R;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) R(r, c) = R_X.at<double>(r, c);
  }
  return {R, Vec3(t_X.at<double>(0), t_X.at<double>(1), t_X.at<double>(2))};
}

TEST(HandEye, HasTheErrorsOfOpenCvOrLess) {
  // OpenCV's method (Shah 2013) solves the same equations by Kronecker products.
  Rng rng(3);
  double ours_rad = 0, theirs_rad = 0, ours_m = 0, theirs_m = 0;
  for (int trial = 0; trial < 300; ++trial) {
    Problem p = random_problem(rng);
    while (p.A.size() < 8 || turn_spread(p.A).axes_deg < 15) p = random_problem(rng);
    add_noise(p.A, 0.1 * kDeg, 0.001, rng);
    add_noise(p.B, 0.1 * kDeg, 0.001, rng);
    const auto found = hand_eye(p.A, p.B);
    ASSERT_TRUE(found) << found.error().text();
    const Vec6 ours = box_minus(found->T_cam1_cam2, p.X), theirs = box_minus(by_opencv(p), p.X);
    ours_rad += ours.head<3>().squaredNorm();
    theirs_rad += theirs.head<3>().squaredNorm();
    ours_m += ours.tail<3>().squaredNorm();
    theirs_m += theirs.tail<3>().squaredNorm();
  }
  // Both are linear and weight the frames a little differently: neither may be clearly worse.
  EXPECT_LT(std::sqrt(ours_rad), 1.1 * std::sqrt(theirs_rad));
  EXPECT_LT(std::sqrt(ours_m), 1.1 * std::sqrt(theirs_m));
}

TEST(HandEye, NamesTheAxisOfPlanarMotion) {
  Rng rng(4);
  for (const double noise_deg : {0.0, 0.05}) {
    const Vec3 axis = Vec3(0.1, -0.95, 0.2).normalized();
    std::vector<SE3> A;
    for (int f = 0; f < 15; ++f)
      A.push_back({so3_exp(rng.uniform(-0.6, 0.6) * axis), Vec3(rng.normal(1), 0, 2 + rng.normal(0.3))});
    Problem p = problem_of(A, random_pose(rng, 1, 0.3), random_pose(rng, 1, 2));
    add_noise(p.A, noise_deg * kDeg, 0, rng);
    add_noise(p.B, noise_deg * kDeg, 0, rng);
    const auto found = hand_eye(p.A, p.B);
    ASSERT_FALSE(found);
    EXPECT_EQ(found.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(found.error().message, HasSubstr("about one axis"));
    EXPECT_THAT(found.error().message, HasSubstr("15 frames lie within"));
    const TurnSpread turns = turn_spread(p.A);
    EXPECT_LT(turns.axis_cam1.cross(axis).norm(), 0.01);
    EXPECT_LT(turns.axes_deg, 1);
    double largest = 0;
    for (const SE3& a : p.A) {
      for (const SE3& b : p.A) largest = std::max(largest, rotation_angle(a.R() * b.R().transpose()));
    }
    EXPECT_NEAR(turns.largest_turn_deg, largest / kDeg, 1e-9);
  }
}

TEST(HandEye, TheUndeterminedDirectionIsTheNamedOne) {
  // Second derivation of what it says: under turns about one axis, moving X along it (and Y so as to follow)
  // leaves the equations as they were.
  Rng rng(5);
  const Vec3 axis = random_direction(rng);
  std::vector<SE3> A;
  for (int f = 0; f < 6; ++f) A.push_back({so3_exp(rng.uniform(-1, 1) * axis), random_direction(rng)});
  const Problem p = problem_of(A, random_pose(rng, 1, 1), random_pose(rng, 1, 1));
  const Vec3 named = turn_spread(p.A).axis_cam1;
  const SE3 X(p.X.R(), p.X.t() + 0.3 * named), Y(p.Y.R(), p.Y.t() + 0.3 * named);
  for (std::size_t f = 0; f < p.A.size(); ++f) EXPECT_LT(box_minus(p.A[f] * Y, X * p.B[f]).norm(), 1e-12);
}

TEST(HandEye, RefusesFewFramesAndSmallTurns) {
  Rng rng(6);
  Problem p = random_problem(rng);
  p.A.resize(2);
  p.B.resize(2);
  EXPECT_THAT(hand_eye(p.A, p.B).error().message, HasSubstr("2 frames, at least 3"));
  std::vector<SE3> still;
  for (int f = 0; f < 10; ++f) still.push_back(random_pose(rng, 1e-3, 1));
  p = problem_of(still, SE3(), SE3());
  EXPECT_THAT(hand_eye(p.A, p.B).error().message, HasSubstr("the largest turn between two of 10 frames is"));
  p.A[1].qt[5] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(hand_eye(p.A, p.B).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(hand_eye(p.A, p.B).error().where, "frame 1");
  p.A.pop_back();
  EXPECT_THROW((void)hand_eye(p.A, p.B), std::invalid_argument);
  EXPECT_EQ(turn_spread({}).n_frames, 0);
}

TEST(HandEye, SpreadOfTwoAxesIsTheirAngle) {
  // Three frames I, exp(a), exp(b) with |a| = |b|: turns about a, b and nearly their difference. About two
  // perpendicular axes alike the spread is that of equal eigenvalues or of the difference's axis.
  std::vector<SE3> right{{Mat3::Identity(), Vec3::Zero()},
                         {so3_exp(Vec3(0.01, 0, 0)), Vec3::Zero()},
                         {so3_exp(Vec3(0, 0.01, 0)), Vec3::Zero()}};
  // Scatter of (1, 0), (0, 1) and (1, -1): eigenvalues 3 and 1.
  EXPECT_NEAR(turn_spread(right).axes_deg, std::atan(std::sqrt(1.0 / 3)) / kDeg, 0.1);
}

}  // namespace
}  // namespace plumbline::test

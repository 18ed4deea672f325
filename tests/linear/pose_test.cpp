// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/pose.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/linear/homography.hpp"
#include "support/lens_samples.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

constexpr ImageSize kSize{640, 480};

Lens lens_of(std::string_view name, std::vector<double> k) { return make_lens(name, k).value(); }

// One of each lens with distortion as real ones have it.
std::vector<Lens> lenses() {
  std::vector<Lens> all;
  for (std::string_view name : fixed_lens_names()) {
    const double f = is_central_perspective(make_lens(name, kSize, 1).value()) ? 520 : 200;
    all.push_back(lens_like_glass(name, {f, 1.02 * f, 315, 243}));
  }
  return all;
}

// Pixels of those points that the lens sees, in both lists; optionally with noise.
struct Seen {
  std::vector<Vec3> p_board;
  std::vector<Vec2> px;
};
Seen see(const Lens& lens, const SE3& T_cam_board, const std::vector<Vec3>& points, Rng* rng = nullptr,
         double sigma = 0) {
  Seen s;
  for (const Vec3& p : points) {
    const auto px = project(lens, T_cam_board * p);
    if (!px) continue;
    s.p_board.push_back(p);
    s.px.push_back(*px);
    if (rng) {
      s.px.back().x() += rng->normal(sigma);
      s.px.back().y() += rng->normal(sigma);
    }
  }
  return s;
}

double pose_error(const SE3& a, const SE3& b) { return box_minus(a, b).norm(); }

double rms_px(const Lens& lens, const SE3& T, const Seen& s) {
  double sum = 0;
  for (std::size_t i = 0; i < s.px.size(); ++i)
    sum += (project(lens, T * s.p_board[i]).value() - s.px[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(s.px.size()));
}

TEST(PoseFromHomography, ExactAndKeepsTheSideTheRaysAreOn) {
  Rng rng(1);
  for (int i = 0; i < 200; ++i) {
    const SE3 T(random_rotation(rng), random_direction(rng));  // also behind the camera
    Mat3 H;
    H << T.R().col(0), T.R().col(1), T.t();
    const auto pose = pose_from_homography(rng.uniform(0.1, 10) * H);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(pose_error(*pose, T), 1e-12);
  }
}

TEST(PoseFromHomography, TakesTheNearestRotation) {
  // Columns that are not quite orthonormal: second-order distance from any small turn of the answer.
  Rng rng(2);
  for (int i = 0; i < 50; ++i) {
    Mat3 H = random_rotation(rng);
    for (double& h : H.reshaped()) h += rng.normal(0.01);
    const Mat3 R = pose_from_homography(H).value().R();
    const auto distance = [&](const Mat3& Q) {
      const double scale = 0.5 * (Q.col(0).dot(H.col(0)) + Q.col(1).dot(H.col(1)));
      return (H.leftCols<2>() - scale * Q.leftCols<2>()).norm();
    };
    for (int k = 0; k < 3; ++k) {
      for (const double turn : {-1e-3, 1e-3})
        EXPECT_GT(distance(so3_exp(turn * Vec3::Unit(k)) * R), distance(R));
    }
  }
}

TEST(PoseFromHomography, RefusesASingularHomography) {
  Mat3 H = Mat3::Identity();
  H.col(1) = 2 * H.col(0);
  const auto pose = pose_from_homography(H);
  ASSERT_FALSE(pose);
  EXPECT_EQ(pose.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(pose.error().message, HasSubstr("edge-on"));
  EXPECT_FALSE(pose_from_homography(Mat3::Zero()));
  EXPECT_FALSE(pose_from_homography(Mat3::Constant(std::nan(""))));
}

class PoseOfEveryLens : public ::testing::TestWithParam<int> {
 protected:
  Lens lens = lenses()[static_cast<std::size_t>(GetParam())];
};

TEST_P(PoseOfEveryLens, OfABoardIsExactWithoutNoise) {
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    const SE3 T = random_board_pose(rng, rng.uniform(0.4, 1.0), rng.uniform(0, 1.0));
    const Seen s = see(lens, T, on_plane(grid(3 + rng.index(7), 2 + rng.index(5), 0.03)));
    const auto pose = pose_from_points(lens, s.p_board, s.px);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(pose_error(*pose, T), 1e-9) << lens_name(lens) << " problem " << i;
  }
}

TEST_P(PoseOfEveryLens, OfASolidTargetIsExactWithoutNoise) {
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    const SE3 T(random_rotation(rng),
                rng.uniform(0.6, 1.5) * Vec3(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 1));
    const Seen s = see(lens, T, box(0.25));
    const auto pose = pose_from_points(lens, s.p_board, s.px);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(pose_error(*pose, T), 1e-9) << lens_name(lens) << " problem " << i;
  }
}

TEST_P(PoseOfEveryLens, OfOneFaceOfASolidTargetTakesThePlanarRoad) {
  Rng rng(5);
  for (int i = 0; i < 100; ++i) {
    const SE3 T = random_board_pose(rng, 0.7, rng.uniform(0.1, 0.9));
    // A face that is neither at z = 0 nor along the target's axes, in the target's own frame.
    const SE3 T_target_face(random_rotation(rng), random_vec3(rng, -0.3, 0.3));
    std::vector<Vec3> face;
    for (const Vec3& p : on_plane(grid(5, 4, 0.04))) face.push_back(T_target_face * p);
    const SE3 T_cam_target = T * T_target_face.inverse();
    const Seen s = see(lens, T_cam_target, face);
    const auto pose = pose_from_points(lens, s.p_board, s.px);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(pose_error(*pose, T_cam_target), 1e-9) << "problem " << i;
    // One corner of another face more: a DLT alone could not use it.
    Seen more = see(lens, T_cam_target, {T_target_face * Vec3(0.02, 0.01, 0.03)});
    more.p_board.insert(more.p_board.end(), s.p_board.begin(), s.p_board.end());
    more.px.insert(more.px.end(), s.px.begin(), s.px.end());
    const auto with_one = pose_from_points(lens, more.p_board, more.px);
    ASSERT_TRUE(with_one) << with_one.error().text();
    EXPECT_LT(pose_error(*with_one, T_cam_target), 1e-9) << "problem " << i;
  }
}

TEST_P(PoseOfEveryLens, OfABowedBoardIsExactToo) {
  Rng rng(6);
  for (const double bow_m : {1e-5, 1e-4, 1e-3, 5e-3}) {
    std::vector<Vec3> points;
    for (const Vec2& p : grid(9, 6, 0.03))
      points.emplace_back(p.x(), p.y(), bow_m * (1 - p.squaredNorm() / 0.02));
    for (int i = 0; i < 20; ++i) {
      const SE3 T = random_board_pose(rng, rng.uniform(0.4, 0.8), rng.uniform(0.1, 0.9));
      const Seen s = see(lens, T, points, &rng, 0.0);
      const auto pose = pose_from_points(lens, s.p_board, s.px);
      ASSERT_TRUE(pose) << pose.error().text();
      EXPECT_LT(pose_error(*pose, T), 1e-9) << "bow " << bow_m << " problem " << i;
    }
  }
}

TEST_P(PoseOfEveryLens, WithNoiseLeavesWhatTheoryAllows) {
  // 6 parameters from 2n residuals leave sigma sqrt(2 (1 - 6 / 2n)). The angular error weighs the rim
  // differently from pixels, which costs up to a few per cent.
  Rng rng(7);
  const double expected = std::sqrt(2 * (1 - 6.0 / 108));
  double squared = 0;
  for (int i = 0; i < 100; ++i) {
    const SE3 T = random_board_pose(rng, rng.uniform(0.4, 0.8), rng.uniform(0.2, 0.9));
    const Seen s = see(lens, T, on_plane(grid(9, 6, 0.03)), &rng, 0.2);
    squared += std::pow(rms_px(lens, pose_from_points(lens, s.p_board, s.px).value(), s) / 0.2, 2) / 100;
  }
  EXPECT_NEAR(std::sqrt(squared), expected, 0.05) << lens_name(lens);
}

INSTANTIATE_TEST_SUITE_P(Lens, PoseOfEveryLens,
                         ::testing::Range(0, static_cast<int>(fixed_lens_names().size())),
                         [](const auto& info) {
                           return std::string(lens_name(lenses()[static_cast<std::size_t>(info.param)]));
                         });

TEST(PoseFromPoints, SeesBehindItselfAt190Degrees) {
  // A fisheye of more than 190 degrees: boards whose centre is up to 95 degrees off the axis, with corners
  // behind.
  const Lens lens = lens_of("kb4", {180, 181, 319, 241, -0.012, 0.004, -0.0015, 2e-4});
  Rng rng(8);
  int behind = 0;
  for (int i = 0; i < 300; ++i) {
    const double theta = rng.uniform(0, 95) * std::numbers::pi / 180, phi = rng.uniform(0, 6.283);
    const Vec3 sight(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
    // The board faces the camera along its line of sight, tilted by up to 50 degrees.
    const Mat3 facing = Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), sight).toRotationMatrix();
    const SE3 T(facing * random_board_pose(rng, 1, rng.uniform(0, 0.87)).R(), rng.uniform(0.2, 0.6) * sight);
    const Seen s = see(lens, T, on_plane(grid(9, 6, 0.03)));
    for (const Vec3& p : s.p_board) behind += (T * p).z() < 0;
    const auto pose = pose_from_points(lens, s.p_board, s.px);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(pose_error(*pose, T), 1e-9) << "theta " << theta << " problem " << i;
  }
  EXPECT_GT(behind, 1000) << "corners behind the camera were among them";
}

TEST(PoseFromPoints, AgreesWithSolvePnP) {
  const Lens lens = lens_of("opencv5", {520, 530, 315, 243, -0.28, 0.1, 1e-3, -5e-4, -0.01});
  const cv::Mat K = (cv::Mat_<double>(3, 3) << 520, 0, 315, 0, 530, 243, 0, 0, 1);
  const std::vector<double> distortion{-0.28, 0.1, 1e-3, -5e-4, -0.01};
  Rng rng(9);
  for (const auto& points : {on_plane(grid(9, 6, 0.03)), box(0.25)}) {
    double worst_exact = 0;
    for (int i = 0; i < 50; ++i) {
      const SE3 T = random_board_pose(rng, rng.uniform(0.5, 0.9), rng.uniform(0.2, 0.8));
      for (const double sigma : {0.0, 0.2}) {
        const Seen s = see(lens, T, points, &rng, sigma);
        std::vector<cv::Point3d> object;
        std::vector<cv::Point2d> image;
        for (std::size_t k = 0; k < s.px.size(); ++k) {
          object.emplace_back(s.p_board[k].x(), s.p_board[k].y(), s.p_board[k].z());
          image.emplace_back(s.px[k].x(), s.px[k].y());
        }
        cv::Mat r, t;
        ASSERT_TRUE(cv::solvePnP(object, image, K, distortion, r, t, false, cv::SOLVEPNP_ITERATIVE));
        const SE3 T_cv(so3_exp(Vec3(r.ptr<double>())), Vec3(t.ptr<double>()));
        const SE3 ours = pose_from_points(lens, s.p_board, s.px).value();
        if (sigma == 0) {
          worst_exact = std::max(worst_exact, pose_error(ours, T_cv));
        } else {
          // solvePnP minimises pixels, we minimise angles: both must explain the pixels equally well.
          EXPECT_LT(rms_px(lens, ours, s), 1.05 * rms_px(lens, T_cv, s)) << "problem " << i;
        }
      }
    }
    // OpenCV stops its iteration at a step of 1.2e-7.
    EXPECT_LT(worst_exact, 1e-5);
  }
}

TEST(PoseFromPoints, ExplainsASmallFarBoardNoWorseThanTheTruth) {
  // From afar the two poses that mirror the board's normal at the line of sight look nearly alike: landing in
  // the worse one would show here.
  const Lens lens = lens_of("pinhole", {600, 600, 320, 240});
  Rng rng(10);
  for (int i = 0; i < 300; ++i) {
    const SE3 T = random_board_pose(rng, rng.uniform(2, 4), rng.uniform(0.1, 0.9));
    const Seen s = see(lens, T, on_plane(grid(4, 4, 0.04)), &rng, 0.3);
    const auto pose = pose_from_points(lens, s.p_board, s.px);
    ASSERT_TRUE(pose) << pose.error().text();
    EXPECT_LT(rms_px(lens, *pose, s), 1.001 * rms_px(lens, T, s)) << "problem " << i;
  }
}

TEST(PoseFromPoints, LeavesPixelsOutsideTheDomainOut) {
  const Lens lens = lens_of("kb4", {180, 181, 319, 241, -0.012, 0.004, -0.0015, 2e-4});
  const SE3 T(so3_exp(Vec3(0.2, -0.3, 0.1)), Vec3(0.02, 0.01, 0.5));
  Seen s = see(lens, T, on_plane(grid(5, 4, 0.04)));
  s.px[3] = Vec2(1e5, -2e5);  // no ray of this lens
  s.px[7] = Vec2(std::nan(""), 0);
  const auto pose = pose_from_points(lens, s.p_board, s.px);
  ASSERT_TRUE(pose) << pose.error().text();
  EXPECT_LT(pose_error(*pose, T), 1e-9);
  for (Vec2& px : std::span(s.px).subspan(3)) px = Vec2(1e5, -2e5);
  const auto too_few = pose_from_points(lens, s.p_board, s.px);
  ASSERT_FALSE(too_few);
  EXPECT_EQ(too_few.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(too_few.error().message, HasSubstr("3 of 20 pixels have a ray in lens kb4"));
}

TEST(PoseFromPoints, RefusesWhatDoesNotDetermineAPose) {
  const Lens lens = lens_of("pinhole", {600, 600, 320, 240});
  const SE3 T(so3_exp(Vec3(0.2, -0.3, 0.1)), Vec3(0.02, 0.01, 0.8));
  std::vector<Vec3> line, few = box(0.2);
  for (int i = 0; i < 7; ++i) line.emplace_back(0.02 * i, 0.01 * i, 0);
  few.resize(5);
  struct Case {
    std::vector<Vec3> points;
    SE3 T;
    const char* message;
  };
  const Case cases[] = {
      {{}, T, "0 of 0 pixels"},
      {on_plane({{0, 0}, {0.1, 0}, {0, 0.1}}), T, "3 of 3 pixels"},
      {line, T, "the 7 points seen lie on a line"},
      {std::vector<Vec3>(6, Vec3(0.01, 0.02, 0)), T, "on a line"},
      {few, T, "5 points that are not in a plane"},
      {on_plane({{0, 0}, {0.1, 0}, {0.2, 0}, {0, 0.1}}), T, "all but one of the 4 points"},
      {on_plane(grid(4, 3, 0.05)), SE3(so3_exp(Vec3(std::numbers::pi / 2, 0, 0)), Vec3(0, 0, 1)), "edge-on"},
  };
  for (const Case& c : cases) {
    const Seen s = see(lens, c.T, c.points);
    const auto pose = pose_from_points(lens, s.p_board, s.px);
    ASSERT_FALSE(pose) << c.message;
    EXPECT_EQ(pose.error().code, ErrorCode::kDegenerate);
    EXPECT_THAT(pose.error().message, HasSubstr(c.message));
  }
  const std::vector<Vec2> one(1, Vec2::Zero());
  EXPECT_THROW((void)pose_from_points(lens, line, one), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test

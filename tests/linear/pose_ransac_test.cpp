// SPDX-License-Identifier: Apache-2.0
// pose_ransac() of linear/pose.hpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "linear/scenes.hpp"
#include "plumbline/linear/pose.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Lens lens_of(std::string_view name, std::vector<double> k) { return make_lens(name, k).value(); }

std::vector<Lens> lenses() {
  return {lens_of("pinhole", {520, 530, 315, 243}),
          lens_of("opencv5", {520, 530, 315, 243, -0.28, 0.1, 1e-3, -5e-4, -0.01}),
          lens_of("opencv8", {520, 530, 315, 243, 0.2, -0.1, 1e-3, -5e-4, 0.02, 0.5, -0.05, 0.03}),
          lens_of("kb4", {180, 181, 319, 241, -0.012, 0.004, -0.0015, 2e-4})};
}

struct Scene {
  SE3 T_cam_world;
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;
  std::vector<bool> correct;
};

// n points 2 to 6 m away within 30 degrees of the axis; every `wrong_each`-th pixel is anywhere in the image.
Scene random_scene(const Lens& lens, Rng& rng, int n, int wrong_each, double sigma_px) {
  Scene s{SE3(random_rotation(rng), random_vec3(rng, -5, 5)), {}, {}, {}};
  while (static_cast<int>(s.px.size()) < n) {
    const Vec3 p_cam = rng.uniform(2, 6) * Vec3(rng.uniform(-0.5, 0.5), rng.uniform(-0.4, 0.4), 1);
    auto px = project(lens, p_cam);
    if (!px) continue;
    const bool correct = wrong_each == 0 || static_cast<int>(s.px.size()) % wrong_each != 0;
    *px += sigma_px * Vec2(rng.normal(), rng.normal());
    if (!correct) *px = Vec2(rng.uniform(0, 640), rng.uniform(0, 480));
    s.p_world.push_back(s.T_cam_world.inverse() * p_cam);
    s.px.push_back(*px);
    s.correct.push_back(correct);
  }
  return s;
}

TEST(PoseRansac, FindsThePoseAmongWrongCorrespondencesForEveryLens) {
  Rng rng(1);
  for (const Lens& lens : lenses()) {
    for (int i = 0; i < 30; ++i) {
      const Scene s = random_scene(lens, rng, 60, 2, 0.3);
      const auto found = pose_ransac(lens, s.p_world, s.px, {.inlier_px = 2, .seed = std::uint64_t(i)});
      ASSERT_TRUE(found) << found.error().text();
      // 30 points, sigma 0.3 px of some 500 px (kb4: 180) at 4 m: 0.4 mm / sqrt(30) across, ten times that
      // along the axis, and as much again for the correlation with the turn; five of its sigmas.
      EXPECT_LT((found->model.centre() - s.T_cam_world.centre()).norm(), 0.05) << lens_name(lens);
      int missed = 0, taken = 0;
      for (std::size_t k = 0; k < s.px.size(); ++k) {
        missed += s.correct[k] && !found->consensus.inlier[k];
        taken += !s.correct[k] && found->consensus.inlier[k];
      }
      EXPECT_EQ(missed, 0) << lens_name(lens);  // 2 px are 6.7 sigmas
      EXPECT_LE(taken, 1) << lens_name(lens);   // a wrong pixel that happens to be right: 4e-5 each
      EXPECT_LT(found->consensus.rms_px, 0.3 * 1.41 * 1.3);
    }
  }
}

TEST(PoseRansac, KeepsItsInlierRule) {
  Rng rng(2);
  const Lens lens = lenses()[1];
  const Scene s = random_scene(lens, rng, 50, 3, 0.8);
  const auto found = pose_ransac(lens, s.p_world, s.px, {.inlier_px = 1.5}).value();
  double sum = 0;
  int n = 0;
  for (std::size_t k = 0; k < s.px.size(); ++k) {
    const auto px = project(lens, found.model * s.p_world[k]);
    const double error = px ? (*px - s.px[k]).norm() : 1e9;
    EXPECT_EQ(found.consensus.inlier[k], error <= 1.5);
    if (error <= 1.5) sum += error * error, ++n;
  }
  EXPECT_EQ(found.consensus.n_inliers, n);
  EXPECT_NEAR(found.consensus.rms_px, std::sqrt(sum / n), 1e-9);
}

TEST(PoseRansac, DoesNotDependOnTheNumberOfThreads) {
  Rng rng(3);
  const Lens lens = lenses()[3];
  const Scene s = random_scene(lens, rng, 200, 2, 0.5);
  std::optional<Found<SE3>> first;
  for (const int threads : {1, 2, 8}) {
    const auto found = pose_ransac(lens, s.p_world, s.px, {.seed = 7, .n_threads = threads}).value();
    if (!first) first = found;
    EXPECT_EQ(found.model, first->model);
    EXPECT_EQ(found.consensus.inlier, first->consensus.inlier);
    EXPECT_EQ(found.consensus.n_hypotheses, first->consensus.n_hypotheses);
  }
}

TEST(PoseRansac, LeavesOutWhatHasNoImage) {
  Rng rng(4);
  const Lens lens = lenses()[0];
  Scene s = random_scene(lens, rng, 20, 0, 0.1);
  s.p_world[3] = s.T_cam_world.inverse() * Vec3(0.1, 0.2, -3);  // behind the camera
  s.px[5] = Vec2(std::nan(""), 0);
  s.p_world[7].z() = std::nan("");
  const auto found = pose_ransac(lens, s.p_world, s.px, {}).value();
  EXPECT_EQ(found.consensus.n_inliers, 17);
  ASSERT_EQ(found.consensus.inlier.size(), 20u);
  for (const std::size_t k : {3, 5, 7}) EXPECT_FALSE(found.consensus.inlier[k]);
}

TEST(PoseRansac, AgreesWithSolvePnPRansac) {
  Rng rng(5);
  const Lens lens = lenses()[1];
  const cv::Mat K = (cv::Mat_<double>(3, 3) << 520, 0, 315, 0, 530, 243, 0, 0, 1);
  const std::vector<double> distortion{-0.28, 0.1, 1e-3, -5e-4, -0.01};
  for (int i = 0; i < 10; ++i) {
    const Scene s = random_scene(lens, rng, 60, 3, 0.3);
    std::vector<cv::Point3d> object;
    std::vector<cv::Point2d> image;
    for (std::size_t k = 0; k < s.px.size(); ++k) {
      object.emplace_back(s.p_world[k].x(), s.p_world[k].y(), s.p_world[k].z());
      image.emplace_back(s.px[k].x(), s.px[k].y());
    }
    cv::Mat r, t;
    std::vector<int> inliers;
    ASSERT_TRUE(cv::solvePnPRansac(object, image, K, distortion, r, t, false, 1000, 2.0f, 0.9999, inliers));
    const auto found = pose_ransac(lens, s.p_world, s.px, {}).value();
    std::vector<int> ours;
    for (std::size_t k = 0; k < s.px.size(); ++k) {
      if (found.consensus.inlier[k]) ours.push_back(static_cast<int>(k));
    }
    EXPECT_EQ(ours, inliers) << "problem " << i;
    const SE3 theirs(so3_exp(Vec3(r.ptr<double>())), Vec3(t.ptr<double>()));
    // Both are least squares over the same pixels; OpenCV stops at a step of 1e-7 and counts floats.
    EXPECT_LT(box_minus(found.model, theirs).norm(), 1e-4) << "problem " << i;
  }
}

TEST(PoseRansac, RefusesWhatDoesNotDetermineAPose) {
  Rng rng(6);
  const Lens lens = lenses()[0];
  const auto message = [&](const std::vector<Vec3>& p, const std::vector<Vec2>& px,
                           RansacOptions options = {}) {
    const auto found = pose_ransac(lens, p, px, options);
    EXPECT_FALSE(found);
    if (found) return std::string();
    EXPECT_EQ(found.error().code, ErrorCode::kDegenerate);
    return found.error().message;
  };
  const Scene s = random_scene(lens, rng, 30, 0, 0.3);
  EXPECT_THAT(message({}, {}), HasSubstr("0 of 0"));
  EXPECT_THAT(message({s.p_world.begin(), s.p_world.begin() + 3}, {s.px.begin(), s.px.begin() + 3}),
              HasSubstr("3 of 3"));
  std::vector<Vec3> line;
  std::vector<Vec2> line_px;
  for (int i = 0; i < 12; ++i) {
    line.push_back(s.T_cam_world.inverse() * Vec3(0.1 * i - 0.5, 0.05 * i, 3));
    line_px.push_back(*project(lens, s.T_cam_world * line.back()));
  }
  EXPECT_THAT(message(line, line_px), HasSubstr("12 points lie on a line"));
  // The line's points and a wrong one beside it: samples with it agree with a handful at best.
  std::vector<Vec3> more = line;
  std::vector<Vec2> more_px = line_px;
  more.push_back(s.p_world[0]);
  more_px.push_back(s.px[0] + Vec2(200, -150));
  EXPECT_THAT(message(more, more_px), HasSubstr("by chance"));
  // Nothing but wrong correspondences: a handful always agree with some pose.
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    Scene wrong = random_scene(lens, rng, 100, 1, 0);
    EXPECT_THAT(message(wrong.p_world, wrong.px, {.max_hypotheses = 2000, .seed = seed}),
                ::testing::AnyOf(HasSubstr("by chance"), HasSubstr("no pose brings 4")));
  }
  EXPECT_THROW((void)pose_ransac(lens, s.p_world, s.px, {.inlier_px = 0}), std::invalid_argument);
  EXPECT_THROW((void)pose_ransac(lens, s.p_world, line_px, {}), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test

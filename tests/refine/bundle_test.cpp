// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/bundle.hpp"

#include <gmock/gmock.h>

#include "bundle_scenes.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

void expect_degenerate(const Reconstruction& scene, const BundleOptions& options, const std::string& words) {
  const auto bundle = adjust_bundle(scene, options);
  ASSERT_FALSE(bundle) << words;
  EXPECT_EQ(bundle.error().code, ErrorCode::kDegenerate) << bundle.error().text();
  EXPECT_THAT(bundle.error().text(), HasSubstr(words));
}

TEST(Bundle, ExactWithoutNoise) {
  for (std::string_view lens : fixed_lens_names()) {
    const Reconstruction truth = make_scene({.lenses = {std::string(lens)}, .seen = 0.5});
    Rng rng(3);
    const Reconstruction start = perturbed(truth, 0.01, 0.03, rng, {0});
    const auto bundle = adjust_bundle(start);
    ASSERT_TRUE(bundle) << lens << ": " << bundle.error().text();
    EXPECT_TRUE(bundle->left_out.empty());
    EXPECT_EQ(bundle->n_used, static_cast<int>(truth.sightings.size()));
    // The default gauge: view 0 is held at the truth, and the distance of the farthest view as it was at the
    // start, so that the answer is the truth in another size.
    const Vec3 centre = truth.views[0].T_cam_world.centre();
    int farthest = 0;
    for (int v = 1; v < 20; ++v) {
      const auto distance = [&](int i) { return (start.views[i].T_cam_world.centre() - centre).norm(); };
      if (distance(v) > distance(farthest)) farthest = v;
    }
    const double scale = (start.views[farthest].T_cam_world.centre() - centre).norm() /
                         (truth.views[farthest].T_cam_world.centre() - centre).norm();
    EXPECT_LT(worst_distance(bundle->scene, scaled(truth, scale, centre)), 1e-9) << lens;
    EXPECT_LT(bundle->rms_px, 1e-9) << lens;
    EXPECT_EQ(bundle->scene.views[0].T_cam_world, start.views[0].T_cam_world);
    EXPECT_THAT(bundle->gauge, HasSubstr("view 0 (img0.jpg) is held"));
    EXPECT_THAT(bundle->gauge, HasSubstr("view " + std::to_string(farthest)));
  }
}

// Small scenes of every kind: nearly all come back, and what does not is seen by its residuals.
TEST(Bundle, RandomScenesAreExactAndNoneIsWrongSilently) {
  constexpr int kScenes = 10000;
  const auto lenses = fixed_lens_names();
  Rng rng(14);
  int n_exact = 0, n_silent = 0;
  for (int i = 0; i < kScenes; ++i) {
    const std::string lens(lenses[static_cast<std::size_t>(i) % lenses.size()]);
    const Reconstruction truth = make_scene({.n_views = 3 + i % 3,
                                             .n_points = 12 + i % 9,
                                             .lenses = {lens},
                                             .seed = 100 + static_cast<std::uint64_t>(i)});
    const Reconstruction start = perturbed(truth, 0.01, 0.03, rng, {0, 1});
    const auto bundle = adjust_bundle(start, {.hold_views = {0, 1}});
    if (!bundle) continue;
    const bool exact = worst_distance(bundle->scene, truth) < 1e-9;
    n_exact += exact;
    n_silent += !exact && bundle->rms_px < 1e-6;
  }
  EXPECT_GE(n_exact, kScenes * 99 / 100);
  EXPECT_EQ(n_silent, 0);
}

TEST(Bundle, ExactWithoutNoiseWithLensesFree) {
  const Reconstruction truth = make_scene({.lenses = {"opencv5", "kb4"}});
  Rng rng(4);
  Reconstruction start = perturbed(truth, 0.005, 0.01, rng, {0, 7});
  for (Camera& camera : start.cameras) {
    params(camera.lens)[0] *= 1.01;
    params(camera.lens)[1] *= 0.99;
    params(camera.lens)[2] += 5;
    params(camera.lens)[4] += 0.01;
  }
  BundleOptions options{.hold_views = {0, 7}, .free_intrinsics = {"all"}};
  const auto bundle = adjust_bundle(start, options);
  ASSERT_TRUE(bundle) << bundle.error().text();
  EXPECT_LT(worst_distance(bundle->scene, truth), 1e-7);  // a flat valley of distortion and depth
  for (std::size_t c = 0; c < 2; ++c) {
    for (int i = 0; i < 4; ++i)
      EXPECT_NEAR(params(bundle->scene.cameras[c].lens)[i], params(truth.cameras[c].lens)[i], 1e-5)
          << c << " " << i;
  }
  // One camera's parameters only, by name.
  start = truth;
  params(start.cameras[1].lens)[0] += 3;
  options.free_intrinsics = {"camera2 fx"};
  const auto one = adjust_bundle(start, options);
  ASSERT_TRUE(one) << one.error().text();
  EXPECT_EQ(params(one->scene.cameras[0].lens)[0], params(truth.cameras[0].lens)[0]);
  EXPECT_NEAR(params(one->scene.cameras[1].lens)[0], params(truth.cameras[1].lens)[0], 1e-8);
  EXPECT_EQ(params(one->scene.cameras[1].lens)[1], params(truth.cameras[1].lens)[1]);
  EXPECT_EQ(one->intrinsics_names, std::vector<std::string>{"camera2 fx"});
}

TEST(Bundle, TiedFocalLengthsMoveTogether) {
  const Reconstruction truth = make_scene({.lenses = {"opencv4"}});
  Reconstruction start = truth;
  params(start.cameras[0].lens)[0] *= 1.02;
  params(start.cameras[0].lens)[1] *= 1.02;
  const auto bundle = adjust_bundle(
      start,
      {.hold_views = {0, 1}, .free_intrinsics = {"fx"}, .tie_focal = true, .covariance_of_intrinsics = true});
  ASSERT_TRUE(bundle) << bundle.error().text();
  const auto k = params(bundle->scene.cameras[0].lens);
  EXPECT_NEAR(k[0], params(truth.cameras[0].lens)[0], 1e-8);
  EXPECT_NEAR(k[1] / k[0], 1.003, 1e-14);
  EXPECT_EQ(bundle->intrinsics_covariance.rows(), 1);
}

TEST(Bundle, ScaleBarsGiveMetres) {
  const Reconstruction truth = make_scene({.n_views = 6, .n_points = 40, .lenses = {"opencv5"}});
  Rng rng(5);
  const Vec3 centre = truth.views[0].T_cam_world.centre();
  // A start in other units, as structure from motion leaves it.
  const Reconstruction start = scaled(perturbed(truth, 0.01, 0.02, rng, {0}), 37.0, centre);
  BundleOptions options;
  for (const auto& [a, b] : {std::pair{0, 1}, std::pair{2, 3}})
    options.scale_bars.push_back({a, b, (truth.p_world[a] - truth.p_world[b]).norm(), 1e-4});
  const auto bundle = adjust_bundle(start, options);
  ASSERT_TRUE(bundle) << bundle.error().text();
  // The held first view was moved by nothing but the change of units about its centre: it is the truth's.
  EXPECT_LT(worst_distance(bundle->scene, truth), 1e-9);
  EXPECT_LT(std::abs(bundle->bar_residual_m[0]) + std::abs(bundle->bar_residual_m[1]), 1e-9);
  EXPECT_THAT(bundle->gauge, HasSubstr("2 scale bars give the scale"));
}

TEST(Bundle, HeldPointsAloneAreAPoseOfEachView) {
  const Reconstruction truth = make_scene({.n_views = 5, .n_points = 12});
  Rng rng(6);
  Reconstruction start = perturbed(truth, 0.02, 0.05, rng);
  start.p_world = truth.p_world;
  BundleOptions options;
  for (int p = 0; p < 12; ++p) options.hold_points.push_back(p);
  const auto poses = adjust_bundle(start, options);
  ASSERT_TRUE(poses) << poses.error().text();
  EXPECT_LT(worst_distance(poses->scene, truth), 1e-10);
  // And held views alone a triangulation.
  start = perturbed(truth, 0, 0.05, rng, {0, 1, 2, 3, 4});
  const auto points = adjust_bundle(start, {.hold_views = {0, 1, 2, 3, 4}, .covariance_of_points = {3}});
  ASSERT_TRUE(points) << points.error().text();
  EXPECT_LT(worst_distance(points->scene, truth), 1e-10);
  EXPECT_GT(points->point_covariance[0].trace(), 0);
}

TEST(Bundle, EverySolverReachesTheSameOptimumAndTheSameBytesAgain) {
  Reconstruction scene = make_scene({.n_points = 100, .lenses = {"opencv5", "opencv8"}, .seen = 0.6});
  Rng rng(7);
  add_noise(scene, 0.5, rng);
  scene = perturbed(scene, 0.005, 0.01, rng);
  std::vector<double> costs;
  for (BundleSolver solver : {BundleSolver::kAuto, BundleSolver::kDenseSchur, BundleSolver::kSparseSchur,
                              BundleSolver::kIterativeSchur}) {
    const BundleOptions options{.solver = solver};
    const auto first = adjust_bundle(scene, options), second = adjust_bundle(scene, options);
    ASSERT_TRUE(first && second);
    for (std::size_t v = 0; v < scene.views.size(); ++v)
      EXPECT_EQ(first->scene.views[v].T_cam_world, second->scene.views[v].T_cam_world);
    EXPECT_EQ(first->scene.p_world, second->scene.p_world);
    EXPECT_EQ(first->cost, second->cost);
    costs.push_back(first->cost);
  }
  // The stopping rule is 1e-13 of the cost; conjugate gradients stop each step early and so a little off.
  for (double cost : costs) EXPECT_NEAR(cost, costs[0], 1e-9 * costs[0]);
}

TEST(Bundle, SightingsBehindTheCameraAreNeverZeroResiduals) {
  const Reconstruction truth = make_scene({.n_views = 8, .n_points = 50});
  Reconstruction scene = truth;
  // A wrong match: point 50 is seen well by three views, and said to be seen by view 3 behind which it lies.
  const SE3& T_cam_world = scene.views[3].T_cam_world;
  scene.p_world.push_back(T_cam_world.inverse() * Vec3(0.1, 0.1, -3));
  const Vec3 p = scene.p_world.back();
  int seen = 0;
  for (int v = 0; v < 8; ++v) {
    const auto px = project(scene.cameras[0].lens, scene.views[v].T_cam_world * p);
    if (px && v != 3) scene.sightings.push_back({v, 50, *px, 1}), ++seen;
  }
  const std::size_t wrong = scene.sightings.size();
  scene.sightings.push_back({3, 50, {320, 240}, 1});
  const auto bundle = adjust_bundle(scene, {.hold_views = {0, 1}});
  ASSERT_TRUE(bundle) << bundle.error().text();
  EXPECT_EQ(bundle->fits[wrong].use, SightingFit::Use::kNoProjection);
  EXPECT_EQ(bundle->left_out.empty(), seen >= 2);
  EXPECT_LT(bundle->rms_px, 1e-9);

  // A point that starts behind one view comes back once the others have put it where it is.
  Reconstruction start = truth;
  start.p_world[7] = start.views[2].T_cam_world.inverse() * Vec3(0, 0, -0.5);
  const auto back = adjust_bundle(start, {.hold_views = {0, 1}});
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->n_used, static_cast<int>(truth.sightings.size()));
  EXPECT_LT(worst_distance(back->scene, truth), 1e-9);
}

TEST(Bundle, TooLittleDataIsLeftOutByName) {
  Reconstruction scene = make_scene({.n_views = 6, .n_points = 30});
  // Point 4 keeps one sighting, point 5 none, view 5 two.
  std::erase_if(scene.sightings, [](const Sighting& s) {
    return (s.point == 4 && s.view != 2) || s.point == 5 || (s.view == 5 && s.point > 1);
  });
  Rng rng(8);
  const Reconstruction start = perturbed(scene, 0.005, 0.01, rng, {0, 1});
  const auto bundle = adjust_bundle(start, {.hold_views = {0, 1}});
  ASSERT_TRUE(bundle) << bundle.error().text();
  std::vector<std::string> said;
  for (const LeftOut& out : bundle->left_out)
    said.push_back((out.what == LeftOut::What::kView ? "view " : "point ") + std::to_string(out.index) +
                   ": " + out.reason);
  EXPECT_THAT(said, ::testing::UnorderedElementsAre("point 4: it is seen in 1 view, 2 are needed",
                                                    "point 5: it is seen in 0 views, 2 are needed",
                                                    "view 5: it sees 2 usable points, 3 are needed"));
  EXPECT_EQ(bundle->scene.views[5].T_cam_world, start.views[5].T_cam_world);
  EXPECT_EQ(bundle->scene.p_world[4], start.p_world[4]);
  EXPECT_LT((bundle->scene.p_world[10] - scene.p_world[10]).norm(), 1e-9);
  int n_left = 0;
  for (const SightingFit& fit : bundle->fits) n_left += fit.use == SightingFit::Use::kLeftOut;
  EXPECT_EQ(n_left, 3);
  expect_degenerate(start, {.covariance_of_points = {4}}, "point 4: it is left out");

  Reconstruction parallel = scene;  // both views of point 6 stand in one place
  parallel.views.push_back(parallel.views[1]);
  std::erase_if(parallel.sightings, [](const Sighting& s) { return s.point == 6 && s.view != 1; });
  for (int p = 6; p < 12; ++p) parallel.sightings.push_back({6, p, *predict(parallel, {6, p, {}, 1}), 1});
  const auto flat = adjust_bundle(parallel);
  ASSERT_TRUE(flat) << flat.error().text();
  ASSERT_FALSE(flat->left_out.empty());
  EXPECT_THAT(flat->left_out[2].reason, HasSubstr("parallel"));
}

TEST(Bundle, GaugesThatLeaveFreedomAreNamed) {
  Reconstruction scene = make_scene({.n_views = 4, .n_points = 20});
  scene.p_world[2] = 0.5 * (scene.p_world[0] + scene.p_world[1]);
  for (Sighting& s : scene.sightings) s.px = *predict(scene, s);
  expect_degenerate(scene, {.hold_points = {0}}, "free in 4 of 7");
  expect_degenerate(scene, {.hold_points = {0, 1}}, "free in 1 of 7");
  expect_degenerate(scene, {.hold_points = {0, 1, 2}}, "free in 1 of 7");
  expect_degenerate(scene, {.hold_views = {2}}, "free in 1 of 7");
  const double length = (scene.p_world[5] - scene.p_world[6]).norm();
  expect_degenerate(scene, {.hold_points = {0}, .scale_bars = {{5, 6, length, 1e-3}}}, "free in 3 of 7");
  for (const BundleOptions& enough :
       {BundleOptions{.hold_points = {0, 1, 3}}, BundleOptions{.hold_views = {2}, .hold_points = {0}},
        BundleOptions{.hold_views = {2, 1}},
        BundleOptions{.hold_views = {2}, .scale_bars = {{5, 6, length, 1e-3}}}})
    EXPECT_TRUE(adjust_bundle(scene, enough));

  // Two scenes in one file.
  Reconstruction two = scene;
  for (int v = 0; v < 4; ++v) two.views.push_back(scene.views[v]);
  for (const Vec3& p : scene.p_world) two.p_world.push_back(p);
  for (const Sighting& s : scene.sightings) two.sightings.push_back({s.view + 4, s.point + 20, s.px, 1});
  expect_degenerate(two, {},
                    "falls into 2 groups without common free points; the one of view 4 (img0.jpg) (4 views, "
                    "20 points) is free in 7 of 7");
  EXPECT_TRUE(adjust_bundle(two, {.hold_views = {0, 1, 4, 5}}));
  // A held view that both see fixes all but the size of the second.
  for (int p = 20; p < 40; ++p) two.sightings.push_back({0, p, *predict(two, {0, p, {}, 1}), 1});
  expect_degenerate(two, {}, "is free in 1 of 7");

  Reconstruction turning = scene;  // a camera that only turns
  for (ReconstructionView& view : turning.views)
    view.T_cam_world = SE3(view.T_cam_world.R(), -view.T_cam_world.R() * Vec3(0, 0, -5));
  std::erase_if(turning.sightings, [&](Sighting& s) { return !predict(turning, s); });
  const auto bundle = adjust_bundle(turning);
  ASSERT_FALSE(bundle);
  EXPECT_EQ(bundle.error().code, ErrorCode::kDegenerate);
}

TEST(Bundle, PartsThatHangTogetherByTwoPointsAreNamed) {
  // 4 + 4 views whose clouds share two points: the second can turn about the line through them.
  Reconstruction scene = make_scene({.n_views = 8, .n_points = 40});
  std::erase_if(scene.sightings,
                [](const Sighting& s) { return s.point > 1 && (s.view < 4) != (s.point < 20); });
  expect_degenerate(scene, {}, "do not determine it");
  scene = make_scene({.n_views = 8, .n_points = 40});
  std::erase_if(scene.sightings,
                [](const Sighting& s) { return s.point > 2 && (s.view < 4) != (s.point < 20); });
  EXPECT_TRUE(adjust_bundle(scene));
}

TEST(Bundle, OptionsThatMakeNoSenseAreNamed) {
  const Reconstruction scene = make_scene({.n_views = 4, .n_points = 20});
  const auto refuse = [&](const Reconstruction& s, const BundleOptions& options, const std::string& words) {
    const auto bundle = adjust_bundle(s, options);
    ASSERT_FALSE(bundle) << words;
    EXPECT_EQ(bundle.error().code, ErrorCode::kInvalidData);
    EXPECT_THAT(bundle.error().text(), HasSubstr(words));
  };
  refuse(scene, {.hold_views = {4}}, "there is no view 4; there are 4");
  refuse(scene, {.hold_points = {-1}}, "there is no point -1");
  refuse(scene, {.scale_bars = {{1, 1, 1, 1}}}, "two different points of 20");
  refuse(scene, {.scale_bars = {{1, 2, -1, 1}}}, "length -1");
  refuse(scene, {.free_intrinsics = {"k7"}}, "there are fx, fy, cx, cy, k1");
  refuse(scene, {.loss_scale = 0}, "loss scale 0");
  refuse(scene, {.max_iterations = 0}, "0 iterations");
  Reconstruction bad = scene;
  bad.sightings[3].view = 9;
  refuse(bad, {}, "sighting 3: view index 9 of 4");
  bad = scene;
  bad.p_world[3].x() = std::nan("");
  refuse(bad, {}, "point 3");
  bad = scene;
  bad.sightings.clear();
  expect_degenerate(bad, {}, "no sighting can be used");
}

TEST(Bundle, RobustLossBearsWrongMatches) {
  const Reconstruction truth = make_scene({.n_views = 10, .n_points = 80, .seen = 0.7});
  Rng rng(9);
  Reconstruction scene = truth;
  add_noise(scene, 0.3, rng);
  for (std::size_t i = 0; i < scene.sightings.size(); i += 20) scene.sightings[i].px += Vec2(25, -40);
  const auto plain = adjust_bundle(scene, {.hold_views = {0, 1}});
  const auto huber = adjust_bundle(scene, {.hold_views = {0, 1}, .loss = Loss::kHuber, .loss_scale = 1.5});
  const auto cauchy = adjust_bundle(scene, {.hold_views = {0, 1}, .loss = Loss::kCauchy, .loss_scale = 1.5});
  ASSERT_TRUE(plain && huber && cauchy);
  const double worst_plain = worst_distance(plain->scene, truth);
  // 5 % of wrong matches of 47 px against noise of 0.3 px: a bounded influence is at least five times better.
  EXPECT_LT(worst_distance(huber->scene, truth), worst_plain / 5);
  EXPECT_LT(worst_distance(cauchy->scene, truth), worst_plain / 10);
}

}  // namespace
}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
// Wrong corners: found by their neighbours, marked by their residuals, and without effect on the result.
#include "refine/outliers.hpp"

#include "plumbline/assess/compare.hpp"
#include "refine/refine_support.hpp"
#include "refine/suspects.hpp"

namespace plumbline::test {
namespace {

const Chessboard kBoard{.columns = 11, .rows = 8, .square_m = 0.03};

enum class Fault { kUniform, kNear, kSwapped, kShifted };

// 5 % of the corners; each lens has its own random numbers, and the others keep their noise.
Dataset spoil(const Dataset& clean, Fault fault, std::uint64_t seed,
              std::set<std::pair<int, int>>* wrong = {}) {
  Dataset data = clean;
  Rng rng(seed + 77);
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    auto& corners = data.views[v].corners;
    const int n = static_cast<int>(corners.size());
    const auto note = [&](int i) {
      if (wrong) wrong->insert({static_cast<int>(v), i});
    };
    if (fault == Fault::kShifted) {
      if (v < seed || n < 88 || (wrong && !wrong->empty()))
        continue;  // the first row is that of the last, the others are right: the board may stand so
      for (int i = 0; i < n; ++i) corners[i].px = clean.views[v].corners[(i + n - 11) % n].px;
      for (int i = 0; i < 11; ++i) note(i);
      continue;
    }
    for (int k = 0; k < (n + 10) / 20; k += fault == Fault::kSwapped ? 2 : 1) {
      const int i = rng.index(n - 1);
      const double off = rng.uniform(5, 20), around = rng.uniform(0, 2 * std::numbers::pi);
      note(i);
      if (fault == Fault::kUniform) {
        corners[i].px = Vec2(rng.uniform(0, 639), rng.uniform(0, 479));
      } else if (fault == Fault::kNear) {
        corners[i].px = clean.views[v].corners[i].px + off * Vec2(std::cos(around), std::sin(around));
      } else {
        note(i + 1);
        corners[i].px = clean.views[v].corners[i + 1].px;
        corners[i + 1].px = clean.views[v].corners[i].px;
      }
    }
  }
  return data;
}

Scene scene_of(const std::string& lens, double fov_deg, std::uint64_t seed) {
  Scene scene{.fov_deg = fov_deg, .target = kBoard, .seed = seed};
  Lens made = *make_lens(lens, scene.size, focal_px(scene.size, fov_deg, lens == "kb4"));
  params(made)[4] = lens == "kb4" ? -0.02 : -0.08;
  scene.lenses = {made};
  return scene;
}

TEST(Suspects, AreTheWrongCornersAndNoOthersUnderAnyLens) {
  for (const auto& [lens, fov] :
       {std::pair{"opencv5", 60.0}, {"opencv8", 90.0}, {"kb4", 100.0}, {"kb4", 180.0}}) {
    const Simulation sim = simulate(scene_of(lens, fov, 4));
    const Dataset clean = with_noise(sim.truth.data, 0.3, 5);
    for (const View& view : clean.views) {
      const auto flags = detail::suspect_corners(clean.targets[0], view);
      EXPECT_EQ(std::count(flags.begin(), flags.end(), true), 0) << lens << " " << fov << " " << view.image;
    }
    for (const Fault fault : {Fault::kUniform, Fault::kSwapped}) {
      std::set<std::pair<int, int>> wrong;
      const Dataset data = spoil(clean, fault, 6, &wrong);
      int n_wrong = 0, n_found = 0, n_good_lost = 0;
      for (std::size_t v = 0; v < data.views.size(); ++v) {
        const auto flags = detail::suspect_corners(data.targets[0], data.views[v]);
        for (std::size_t i = 0; i < flags.size(); ++i) {
          // One that landed near its place does no harm.
          const double off = (data.views[v].corners[i].px - clean.views[v].corners[i].px).norm();
          n_wrong += off > 6;
          n_found += off > 6 && flags[i];
          n_good_lost += off == 0 && flags[i];
        }
      }
      EXPECT_GE(n_found, 0.97 * n_wrong) << lens << " " << fov;
      EXPECT_LE(n_good_lost, 0.05 * n_wrong) << lens << " " << fov;
    }
  }
}

TEST(Suspects, AreNotSoughtWhereNeighboursSayNothing) {
  Simulation sim = simulate(scene_of("opencv5", 60, 4));
  View view = sim.truth.data.views[0];
  Rng rng(3);
  for (Corner& c : view.corners) c.px = Vec2(rng.uniform(0, 639), rng.uniform(0, 479));
  const auto all_wrong = detail::suspect_corners(sim.truth.data.targets[0], view);
  EXPECT_EQ(std::count(all_wrong.begin(), all_wrong.end(), true), 0);
  view.corners.resize(8);
  EXPECT_EQ(detail::suspect_corners(sim.truth.data.targets[0], view), std::vector<bool>(8, false));
  // Two rows only: no polynomial of second degree across them.
  view = sim.truth.data.views[0];
  view.corners.resize(22);
  view.corners[5].px.x() += 100;
  EXPECT_NO_THROW(detail::suspect_corners(sim.truth.data.targets[0], view));
}

TEST(Outliers, TheRuleLosesAsManyGoodCornersAsItSays) {
  // By simulation of two Gaussian coordinates, a second way to the closed form.
  Rng rng(1);
  for (const double k : {1.5, 2.0, 3.0}) {
    double sum = 0;
    int n_kept = 0;
    const int n = 400000;
    for (int i = 0; i < n; ++i) {
      const Vec2 r(rng.normal(), rng.normal());
      if (r.norm() > k) continue;
      sum += r.squaredNorm();
      ++n_kept;
    }
    EXPECT_NEAR(n_kept / double(n), 1 - std::exp(-k * k / 2), 0.003);
    EXPECT_NEAR(sum / (2 * n_kept), detail::truncated_variance(k), 0.005);
  }
  EXPECT_NEAR(detail::truncated_variance(5), 1, 1e-4);
  EXPECT_EQ(detail::truncated_variance(40), 1);
}

// With a bound of 2 sigmas an eighth of the good corners is left out; the covariance is none the smaller for
// the residuals that are missing, but larger for the corners that are.
TEST(Outliers, TheCovarianceKnowsThatTheTailsAreCutOff) {
  Calibration start = simulate(scene_of("pinhole", 60, 3)).truth;
  params(start.rig.cameras[0].lens)[3] = 239.5;
  start.data = with_noise(start.data, 0.3, 9);
  RefineOptions options;
  options.mark_outliers = false;
  const auto all = refine(start, options);
  options.mark_outliers = true;
  options.outlier_sigma = 2;
  const auto cut = refine(start, options);
  ASSERT_TRUE(all && cut);
  const double lost = static_cast<double>(cut->stats.n_outliers) / all->stats.n_corners;
  EXPECT_NEAR(lost, std::exp(-2.0), 0.03);
  EXPECT_NEAR(std::sqrt((*cut->covariance)(0, 0) / (*all->covariance)(0, 0)), std::sqrt(1 / (1 - lost)),
              0.06);
}

// Counting the rows from one too far is consistent within the view, and contradicts the other camera's.
TEST(Outliers, AViewThatCountsFromAnotherRowIsDropped) {
  Scene scene{.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .target = kBoard, .seed = 5};
  const Simulation sim = simulate(scene);
  Dataset data = with_noise(sim.truth.data, 0.2, 6);
  const auto view = std::find_if(data.views.begin(), data.views.end(),
                                 [](const View& v) { return v.cam == 1 && v.corners.size() == 88; });
  ASSERT_NE(view, data.views.end());
  view->corners.resize(77);
  for (Corner& c : view->corners) c.point += 11;
  RefineOptions options;
  const auto cal = calibrate(data, options);
  ASSERT_TRUE(cal) << cal.error().text();
  // Which of the two is wrong the images do not say.
  int n_dropped = 0;
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    n_dropped += !cal->view_reason[v].empty();
    EXPECT_TRUE(cal->view_reason[v].empty() || data.views[v].frame == view->frame) << cal->view_reason[v];
  }
  EXPECT_EQ(n_dropped, 1);
  EXPECT_NEAR(cal->stats.rms_xy_px, 0.2, 0.01);
  EXPECT_LT(box_minus(cal->rig.T_cam_rig[1], sim.truth.rig.T_cam_rig[1]).norm(), 2e-3);
}

// With wrong corners the result is that of the right ones alone, to the solver's last digits: all of the
// former and none of the latter are marked. So they cost what their absence costs, 1 / sqrt(0.95);
// bench/outliers measures that over 100 seeds.
TEST(Outliers, WrongCornersChangeNothingButTheirNumber) {
  for (const auto& [lens, fov] : {std::pair{"opencv5", 60.0}, {"kb4", 100.0}, {"kb4", 180.0}}) {
    const Simulation sim = simulate(scene_of(lens, fov, 2));
    const Dataset clean = with_noise(sim.truth.data, 0.2, 12);
    RefineOptions options;
    options.lenses = {lens};
    for (const Fault fault : {Fault::kUniform, Fault::kNear, Fault::kSwapped, Fault::kShifted}) {
      std::set<std::pair<int, int>> wrong;
      const Dataset data = spoil(clean, fault, 2, &wrong);
      options.mark_outliers = true;
      const auto cal = calibrate(data, options);
      ASSERT_TRUE(cal) << cal.error().text();
      Calibration right = *cal;
      for (const auto& [v, i] : wrong) {
        right.data.views[v].corners[i].point = -1;
        if (!cal->fits[v].empty()) EXPECT_TRUE(cal->fits[v][i].outlier) << lens << " " << v << " " << i;
      }
      for (View& view : right.data.views)
        std::erase_if(view.corners, [](const Corner& c) { return c.point < 0; });
      EXPECT_EQ(cal->stats.n_outliers, static_cast<int>(wrong.size()))
          << lens << " " << static_cast<int>(fault);
      options.mark_outliers = false;
      const auto oracle = refine(right, options);
      ASSERT_TRUE(oracle) << oracle.error().text();
      EXPECT_NEAR(cal->stats.rms_px, oracle->stats.rms_px, 1e-9) << lens << " " << static_cast<int>(fault);
      const auto diff = compare_cameras(oracle->rig.cameras[0], cal->rig.cameras[0]);
      EXPECT_LT(diff->max, 1e-4) << lens << " " << static_cast<int>(fault);
    }
  }
}

}  // namespace
}  // namespace plumbline::test

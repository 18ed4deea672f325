// SPDX-License-Identifier: Apache-2.0
#include "plumbline/refine/refine.hpp"

#include "refine/seed.hpp"
#include "refine_support.hpp"

namespace plumbline::test {
namespace {

constexpr double kDeg = 180 / std::numbers::pi;

RefineOptions options_for(std::string_view lens) {
  RefineOptions options;
  options.lenses = {std::string(lens)};
  return options;
}

std::string text_of(const Result<Calibration>& r) { return r ? "" : r.error().text(); }

TEST(Calibrate, DataWithoutNoiseGiveTheTruthBack) {
  for (std::string_view name : fixed_lens_names()) {
    // A sphere's shape shows at its rim only: over 60 degrees it is as good as undetermined.
    const bool wide = !is_central_perspective(example_lens(name)) && name != "kb4";
    for (int n_cams : {1, 2, 3}) {
      const Simulation sim =
          simulate({.lenses = std::vector<Lens>(n_cams, example_lens(name, wide ? 280 : 550)),
                    .fov_deg = wide ? 110.0 : 60.0});
      const auto cal = calibrate(sim.truth.data, options_for(name));
      ASSERT_TRUE(cal) << name << " " << text_of(cal);
      EXPECT_LT(cal->stats.rms_px, 1e-7) << name << " x" << n_cams << " " << cal->stats.termination;
      EXPECT_LT(worst_lens_error_px(sim, *cal), 1e-6)
          << name << " x" << n_cams << " " << cal->stats.termination;
      EXPECT_TRUE(cal->stats.converged) << name << " x" << n_cams << " " << cal->stats.termination;
      EXPECT_EQ(cal->stats.n_outliers, 0) << name;
      for (int cam = 1; cam < n_cams; ++cam) {
        EXPECT_LT(box_minus(cal->rig.T_cam_rig[cam], sim.truth.rig.T_cam_rig[cam]).norm(), 1e-8) << name;
      }
    }
  }
}

TEST(Calibrate, FindsTheFocalLengthForAnyFieldOfView) {
  for (double fov : {20.0, 30.0, 45.0, 60.0, 80.0, 100.0, 120.0, 140.0, 160.0, 180.0, 190.0}) {
    const bool fisheye = fov > 100;
    Scene scene{.fov_deg = fov, .seed = 11};
    const double f = focal_px(scene.size, fov, fisheye);
    Lens lens = *make_lens(fisheye ? "kb4" : "opencv5", scene.size, f);
    // barrel distortion that moves the edge of the image by a few per cent
    params(lens)[4] = fisheye ? -0.02 : -0.08 * std::pow(2 * f / scene.size.width, 2);
    scene.lenses = {lens};
    const Simulation sim = simulate(scene);
    const Dataset data = with_noise(sim.truth.data, 0.1, 3);
    const auto cal = calibrate(data, options_for(lens_name(lens)));
    ASSERT_TRUE(cal) << fov << " " << text_of(cal);
    EXPECT_NEAR(params(cal->rig.cameras[0].lens)[0], f, 0.02 * f) << fov;
    EXPECT_NEAR(cal->stats.rms_xy_px, 0.1, 0.01) << fov;
  }
}

// The pixels of an equidistant fisheye, seen as the rational lens, which can bend that far. On the way there
// a perspective lens meets the edge of its domain: seed 2 at 135 degrees ends at 0.30 px from a perspective
// start alone.
TEST(Calibrate, APerspectiveLensWithStrongBarrelDistortion) {
  for (double fov : {110.0, 135.0}) {
    Scene scene{.fov_deg = fov, .seed = 2};
    scene.lenses = {*make_lens("kb4", scene.size, focal_px(scene.size, fov, true))};
    const Dataset data = with_noise(simulate(scene).truth.data, 0.1, 3);
    const auto cal = calibrate(data, options_for("opencv8"));
    ASSERT_TRUE(cal) << fov << " " << text_of(cal);
    EXPECT_NEAR(cal->stats.rms_xy_px, 0.1, 0.01) << fov;
    EXPECT_LE(cal->stats.n_outliers, 2) << fov;
  }
}

// mrcal's opencv8 answer for the lens of its "overpass" photographs, whose image is 150 degrees wide.
Simulation very_wide_rational(std::uint64_t seed) {
  Scene scene{.size = {6016, 4016},
              .fov_deg = 190,
              .n_frames = 40,
              .target = Chessboard{.columns = 10, .rows = 10, .square_m = 0.077},
              .seed = seed,
              .widest_tan = std::tan(75 / kDeg)};
  scene.lenses = {*make_lens("opencv8", std::vector<double>{2073.87, 2077.45, 3004.7, 1997.4, 0.4792, 0.0267,
                                                            0, 0, 0.0001, 0.7667, 0.0963, 0.0014})};
  return simulate(scene);
}

TEST(Calibrate, ARationalLensThatSees75DegreesOffItsAxis) {
  for (std::uint64_t seed : {1, 2}) {
    const Simulation sim = very_wide_rational(seed);
    double widest = 0;
    for (const auto& view : sim.p_cam) {
      for (const Vec3& p : view) widest = std::max(widest, std::atan2(p.head<2>().norm(), p.z()));
    }
    ASSERT_GT(widest * kDeg, 73);
    for (const char* name : {"opencv8", "opencv12"}) {
      const auto cal = calibrate(with_noise(sim.truth.data, 0.1, 3), options_for(name));
      ASSERT_TRUE(cal) << seed << " " << name << " " << text_of(cal);
      EXPECT_NEAR(params(cal->rig.cameras[0].lens)[0], 2073.87, 1) << seed << " " << name;
      EXPECT_NEAR(cal->stats.rms_xy_px, 0.1, 0.01) << seed << " " << name;
      EXPECT_LE(cal->stats.n_outliers, 2) << seed << " " << name;
      EXPECT_LT(worst_lens_error_px(sim, *cal), 0.5) << seed << " " << name;
      EXPECT_TRUE(cal->stats.weak.empty() ||
                  cal->stats.weak[0].consequence.find("cannot describe") == std::string::npos);
    }
  }
}

// The fisheye of the same photographs: their corners alone tell the two lenses apart by under a pixel.
TEST(Seed, ConvertsAFisheyeToTheRationalLensOverItsRays) {
  const Lens fisheye = *make_lens("kb4", std::vector<double>{2073.89, 2078.01, 3002.64, 1996.11, 0.039325,
                                                             0.0068293, 0.0024338, -0.0010136});
  std::vector<double> theta;
  for (double deg = 0; deg <= 75; deg += 0.05) theta.push_back(deg / kDeg);
  const auto lens = detail::perspective_like(fisheye, "opencv8", {6016, 4016}, theta, {});
  ASSERT_TRUE(lens);
  for (double angle : theta) {
    const Vec3 p(0.6 * std::sin(angle), 0.8 * std::sin(angle), std::cos(angle));
    const auto wanted = project(fisheye, p), px = project_by_opencv(*lens, p);
    EXPECT_LT((*wanted - *px).norm(), 0.5) << angle * kDeg;
    EXPECT_TRUE(project(*lens, p)) << angle * kDeg;  // in the domain
  }
}

TEST(Calibrate, SaysThatAPolynomialLensCannotDescribeAVeryWideOne) {
  const Simulation sim = very_wide_rational(1);
  for (const char* name : {"opencv4", "opencv5"}) {
    const auto cal = calibrate(with_noise(sim.truth.data, 0.1, 3), options_for(name));
    ASSERT_TRUE(cal) << name << " " << text_of(cal);
    ASSERT_FALSE(cal->stats.weak.empty()) << name;
    EXPECT_EQ(cal->stats.weak[0].parameters, "cam0 fx");
    EXPECT_NE(cal->stats.weak[0].consequence.find(std::string("lens ") + name + " cannot describe"),
              std::string::npos)
        << cal->stats.weak[0].consequence;
    EXPECT_GT(cal->stats.weak[0].sigma, 0);
  }
}

// Chi-squared of the error against the predicted covariance, over independent noise: nine parameters, so its
// mean over n trials is 9 +- sqrt(18 / n).
TEST(Refine, ErrorsAreWithinThePredictedCovariance) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5")}, .n_frames = 15, .seed = 5});
  RefineOptions options = options_for("opencv5");
  options.mark_outliers = false;
  const int n_trials = 60;
  double sum = 0, sum_noise = 0;
  for (int trial = 0; trial < n_trials; ++trial) {
    Calibration start = sim.truth;
    start.data = with_noise(sim.truth.data, 0.3, 100 + trial);
    const auto cal = refine(start, options);
    ASSERT_TRUE(cal) << text_of(cal);
    const MatX precision = cal->covariance->inverse();
    VecX error(9);
    for (int i = 0; i < 9; ++i)
      error[i] = params(cal->rig.cameras[0].lens)[i] - params(sim.truth.rig.cameras[0].lens)[i];
    sum += error.dot(precision * error);
    sum_noise += cal->stats.rms_xy_px;
  }
  EXPECT_NEAR(sum / n_trials, 9, 3 * std::sqrt(18.0 / n_trials));
  EXPECT_NEAR(sum_noise / n_trials, 0.3,
              0.01);  // less a little: the poses absorb 99 of 1500 degrees of freedom
}

TEST(Refine, StereoErrorsAreWithinThePredictedCovariance) {
  const Simulation sim =
      simulate({.lenses = {example_lens("pinhole"), example_lens("pinhole")}, .n_frames = 10, .seed = 5});
  RefineOptions options = options_for("pinhole");
  options.mark_outliers = false;
  const int n_trials = 40, n = 14;
  double sum = 0;
  for (int trial = 0; trial < n_trials; ++trial) {
    Calibration start = sim.truth;
    start.data = with_noise(sim.truth.data, 0.2, 500 + trial);
    const auto cal = refine(start, options);
    ASSERT_TRUE(cal) << text_of(cal);
    VecX error(n);
    for (int i = 0; i < 4; ++i) {
      error[i] = params(cal->rig.cameras[0].lens)[i] - params(sim.truth.rig.cameras[0].lens)[i];
      error[4 + i] = params(cal->rig.cameras[1].lens)[i] - params(sim.truth.rig.cameras[1].lens)[i];
    }
    error.tail<6>() = box_minus(cal->rig.T_cam_rig[1], sim.truth.rig.T_cam_rig[1]);
    sum += error.dot(cal->covariance->inverse() * error);
  }
  EXPECT_NEAR(sum / n_trials, n, 3 * std::sqrt(2.0 * n / n_trials));
}

TEST(Calibrate, MarksGrossErrorsAndIsNotBentByThem) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5")}, .seed = 8});
  const Dataset clean = with_noise(sim.truth.data, 0.1, 21);
  Dataset dirty = clean;
  Rng rng(4);
  std::set<std::pair<int, int>> bad;
  for (int i = 0; i < 30; ++i) {
    const int v = rng.index(static_cast<int>(dirty.views.size()));
    const int k = rng.index(static_cast<int>(dirty.views[v].corners.size()));
    if (!bad.insert({v, k}).second) continue;
    dirty.views[v].corners[k].px += Vec2(rng.uniform(3, 15), rng.uniform(3, 15));
  }
  const auto cal = calibrate(dirty, options_for("opencv5"));
  ASSERT_TRUE(cal) << text_of(cal);
  std::set<std::pair<int, int>> marked;
  for (std::size_t v = 0; v < cal->fits.size(); ++v) {
    for (std::size_t k = 0; k < cal->fits[v].size(); ++k) {
      if (cal->fits[v][k].outlier) marked.insert({static_cast<int>(v), static_cast<int>(k)});
    }
  }
  EXPECT_EQ(marked, bad);
  EXPECT_EQ(cal->stats.n_outliers, static_cast<int>(bad.size()));
  const auto untouched = calibrate(clean, options_for("opencv5"));
  ASSERT_TRUE(untouched);
  const double error_px = worst_lens_error_px(sim, *untouched);  // what the noise alone does
  EXPECT_LT(worst_lens_error_px(sim, *cal), 1.2 * error_px);
  // and the bad corners do harm where they are kept
  RefineOptions keep = options_for("opencv5");
  keep.mark_outliers = false;
  const auto bent = calibrate(dirty, keep);
  ASSERT_TRUE(bent);
  EXPECT_GT(worst_lens_error_px(sim, *bent), 3 * error_px);
  EXPECT_EQ(bent->stats.n_outliers, 0);
  // a robust loss helps without marks
  keep.loss = Loss::kCauchy;
  keep.loss_scale_px = 0.3;
  const auto robust = calibrate(dirty, keep);
  ASSERT_TRUE(robust);
  EXPECT_LT(worst_lens_error_px(sim, *robust), 1.5 * error_px);
}

TEST(Calibrate, DropsAViewThatShowsSomethingElse) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5")}, .seed = 8});
  Dataset data = with_noise(sim.truth.data, 0.1, 21);
  Rng rng(4);
  for (Corner& c : data.views[3].corners) c.px = Vec2(rng.uniform(0, 639), rng.uniform(0, 479));
  const auto cal = calibrate(data, options_for("opencv5"));
  ASSERT_TRUE(cal) << text_of(cal);
  EXPECT_FALSE(cal->view_reason[3].empty());
  EXPECT_TRUE(cal->fits[3].empty());
  EXPECT_FALSE(cal->T_rig_board[data.views[3].frame].has_value());
  EXPECT_NEAR(cal->stats.rms_xy_px, 0.1, 0.01);
}

TEST(Calibrate, FixedParametersStay) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .seed = 9});
  RefineOptions options = options_for("opencv5");
  options.fixed = {"k3", "cam0 cx", "cam1 r_x"};
  Calibration start = sim.truth;
  start.data = with_noise(sim.truth.data, 0.2, 1);
  const auto cal = refine(start, options);
  ASSERT_TRUE(cal) << text_of(cal);
  const auto &a = cal->rig, &b = sim.truth.rig;
  EXPECT_EQ(params(a.cameras[0].lens)[8], params(b.cameras[0].lens)[8]);
  EXPECT_EQ(params(a.cameras[1].lens)[8], params(b.cameras[1].lens)[8]);
  EXPECT_EQ(params(a.cameras[0].lens)[2], params(b.cameras[0].lens)[2]);
  EXPECT_NE(params(a.cameras[1].lens)[2], params(b.cameras[1].lens)[2]);
  EXPECT_NEAR(so3_log(a.T_cam_rig[1].R()).x(), so3_log(b.T_cam_rig[1].R()).x(), 1e-12);
  EXPECT_GT(std::abs(so3_log(a.T_cam_rig[1].R()).y() - so3_log(b.T_cam_rig[1].R()).y()), 1e-9);
  EXPECT_EQ((*cal->covariance)(2, 2), 0.0);
  EXPECT_GT((*cal->covariance)(3, 3), 0.0);
  options.fixed = {"cam0 k9"};
  const auto bad = refine(start, options);
  ASSERT_FALSE(bad);
  EXPECT_EQ(bad.error().code, ErrorCode::kInvalidData);
  EXPECT_NE(bad.error().message.find("cam1 t_z"), std::string::npos) << bad.error().message;
}

TEST(Calibrate, TheSameBytesTwiceAndForAnyThreadCount) {
  const Simulation sim =
      simulate({.lenses = {example_lens("opencv8"), example_lens("opencv8")}, .n_frames = 12});
  const Dataset data = with_noise(sim.truth.data, 0.2, 1);
  RefineOptions options = options_for("opencv8");
  options.n_threads = 1;
  const auto a = calibrate(data, options);
  options.n_threads = 2;
  const auto b = calibrate(data, options);
  ASSERT_TRUE(a && b);
  for (int cam : {0, 1}) {
    EXPECT_EQ(a->rig.T_cam_rig[cam].qt, b->rig.T_cam_rig[cam].qt);
    for (int i = 0; i < 12; ++i)
      EXPECT_EQ(params(a->rig.cameras[cam].lens)[i], params(b->rig.cameras[cam].lens)[i]);
  }
  EXPECT_EQ(*a->covariance, *b->covariance);
  EXPECT_EQ(a->stats.rms_px, b->stats.rms_px);
}

TEST(Calibrate, RenumbersABoardThatAnotherCameraSawTurnedAround) {
  // half-turn symmetric, and square: four ways to number it
  for (const auto& [columns, rows] : {std::pair{8, 6}, std::pair{7, 7}}) {
    const Scene scene{.lenses = {example_lens("opencv5"), example_lens("opencv5")},
                      .n_frames = 12,
                      .target = Chessboard{.columns = columns, .rows = rows, .square_m = 0.025}};
    const Simulation sim = simulate(scene);
    Dataset data = with_noise(sim.truth.data, 0.1, 2);
    std::vector<int> turned;
    const int n = columns * rows;
    for (std::size_t v = 0; v < data.views.size(); ++v) {
      if (data.views[v].cam != 1 || data.views[v].frame % 3 != 1) continue;
      turned.push_back(static_cast<int>(v));
      for (Corner& c : data.views[v].corners) {
        // a quarter turn of the square board for every second view, a half turn otherwise
        const int row = c.point / columns, column = c.point % columns;
        c.point = columns == rows && data.views[v].frame % 2 ? column * columns + (rows - 1 - row)
                                                             : n - 1 - c.point;
      }
      std::sort(data.views[v].corners.begin(), data.views[v].corners.end(),
                [](const Corner& a, const Corner& b) { return a.point < b.point; });
    }
    ASSERT_GE(turned.size(), 3u);
    const auto cal = calibrate(data, options_for("opencv5"));
    ASSERT_TRUE(cal) << text_of(cal);
    EXPECT_NEAR(cal->stats.rms_xy_px, 0.1, 0.01);
    EXPECT_EQ(cal->stats.n_outliers, 0);
    EXPECT_LT(box_minus(cal->rig.T_cam_rig[1], sim.truth.rig.T_cam_rig[1]).norm(), 2e-3);
    for (int v : turned) {
      EXPECT_EQ(cal->data.views[v].corners.front().point, sim.truth.data.views[v].corners.front().point);
      EXPECT_NE(cal->data.detector.find(data.views[v].image), std::string::npos) << cal->data.detector;
    }
  }
}

TEST(Calibrate, DltSeedsFromOneImageOfPointsInSpace) {
  Points3d cube;
  for (int i = 0; i < 5; ++i) {
    for (int k = 0; k < 5; ++k) {
      cube.points_m.emplace_back(0.05 * i, 0.05 * k, 0);
      cube.points_m.emplace_back(0, 0.05 * i, 0.05 * (k + 1));
      cube.points_m.emplace_back(0.05 * (i + 1), 0, 0.05 * (k + 1));
    }
  }
  Scene scene{.lenses = {example_lens("opencv4", 700)}, .n_frames = 1, .target = cube};
  Simulation sim = simulate(scene);
  // look into the corner from outside
  for (const Start start : {Start::kDlt, Start::kAuto}) {
    RefineOptions options = options_for("opencv4");
    options.start = start;
    const auto cal = calibrate(sim.truth.data, options);
    ASSERT_TRUE(cal) << text_of(cal);
    EXPECT_LT(worst_lens_error_px(sim, *cal), 1e-6);
    EXPECT_LT(box_minus(*cal->T_rig_board[0], *sim.truth.T_rig_board[0]).norm(), 1e-8);
  }
}

TEST(Calibrate, DltRefusesATargetInOnePlane) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5")}});
  RefineOptions options = options_for("opencv5");
  options.start = Start::kDlt;
  const auto cal = calibrate(sim.truth.data, options);
  ASSERT_FALSE(cal);
  EXPECT_EQ(cal.error().code, ErrorCode::kDegenerate);
}

TEST(Calibrate, RefusesViewsThatDoNotDetermineTheLens) {
  // all boards parallel to the image, with and without noise
  const Simulation flat = simulate({.lenses = {example_lens("opencv5")}, .fov_deg = 60, .max_tilt_deg = 0});
  Simulation head_on = flat;
  for (std::size_t v = 0; v < head_on.truth.data.views.size(); ++v) {
    const SE3 T(Mat3::Identity(),
                Vec3(-0.1 + 0.003 * static_cast<double>(v), -0.06, 0.3 + 0.01 * static_cast<double>(v)));
    for (Corner& c : head_on.truth.data.views[v].corners) {
      c.px = *project_by_opencv(head_on.truth.rig.cameras[0].lens,
                                T * head_on.truth.data.targets[0].points[c.point]);
    }
  }
  for (double noise : {0.0, 0.2}) {
    const auto cal = calibrate(with_noise(head_on.truth.data, noise, 6), options_for("opencv5"));
    ASSERT_FALSE(cal) << "noise " << noise << " fx " << params(cal->rig.cameras[0].lens)[0];
    EXPECT_EQ(cal.error().code, ErrorCode::kDegenerate) << cal.error().text();
    EXPECT_NE(cal.error().where.find("cam0"), std::string::npos) << cal.error().text();
    EXPECT_NE(cal.error().message.find("tilted"), std::string::npos) << cal.error().text();
  }
}

TEST(Calibrate, NamesBoardsThatAreNearlyTheSame) {
  // thirty frames of a board that hardly moves: 1.5 s of a video
  Scene scene{.lenses = {example_lens("opencv5")}, .n_frames = 40, .seed = 2};
  Simulation sim = simulate(scene);
  Rng rng(3);
  const SE3 T0 = *sim.truth.T_rig_board[0];
  Dataset data = sim.truth.data;
  data.views.clear();
  for (int f = 0; f < 30; ++f) {
    const SE3 T = box_plus(T0, (Vec6() << 0.02 * rng.normal(), 0.02 * rng.normal(), 0.02 * rng.normal(),
                                0.01 * rng.normal(), 0.01 * rng.normal(), 0.01 * rng.normal())
                                   .finished());
    View view{0, f, std::to_string(f) + ".png", {}, ""};
    for (int id = 0; id < 54; ++id) {
      view.corners.push_back({id, *project_by_opencv(scene.lenses[0], T * data.targets[0].points[id]), 1.0});
    }
    data.views.push_back(view);
  }
  const auto cal = calibrate(with_noise(data, 0.2, 6), options_for("opencv5"));
  if (cal) {
    ASSERT_FALSE(cal->stats.weak.empty());
    EXPECT_NE(cal->stats.weak[0].parameters.find("cam0 f"), std::string::npos)
        << cal->stats.weak[0].parameters;
  } else {
    EXPECT_EQ(cal.error().code, ErrorCode::kDegenerate);
  }
}

TEST(Calibrate, RefusesBadInput) {
  const Simulation sim =
      simulate({.lenses = {example_lens("opencv5"), example_lens("opencv5")}, .n_frames = 8});
  const auto code = [](const Dataset& data, const RefineOptions& options) {
    const auto cal = calibrate(data, options);
    return cal ? std::string("accepted")
               : std::string(to_string(cal.error().code)) + " " + cal.error().text();
  };
  const RefineOptions options = options_for("opencv5");
  using ::testing::HasSubstr;
  using ::testing::StartsWith;
  Dataset data = sim.truth.data;
  std::erase_if(data.views, [](const View& v) { return v.cam == 1 && v.frame > 1; });
  EXPECT_THAT(code(data, options),
              ::testing::AllOf(StartsWith("kDegenerate"), HasSubstr("cam1"), HasSubstr("at least 3")));

  data = sim.truth.data;  // the cameras never see the board at once
  std::erase_if(data.views, [](const View& v) { return v.frame % 2 != v.cam; });
  EXPECT_THAT(code(data, options), ::testing::AllOf(StartsWith("kDegenerate"), HasSubstr("cam0 and cam1")));

  data = sim.truth.data;
  data.views[0].corners[0].px.x() = std::nan("");
  EXPECT_THAT(code(data, options), StartsWith("kInvalidData"));

  RefineOptions wrong = options;
  wrong.lenses = {"opencv5", "opencv5", "opencv5"};
  EXPECT_THAT(code(sim.truth.data, wrong), StartsWith("kInvalidData"));
  wrong = options_for("opencv6");
  EXPECT_THAT(code(sim.truth.data, wrong), StartsWith("kUnsupported"));
  wrong = options;
  wrong.loss_scale_px = 0;
  EXPECT_THAT(code(sim.truth.data, wrong), StartsWith("kInvalidData"));
}

TEST(Calibrate, SaysWhyAViewWasNotUsed) {
  const Simulation sim = simulate({.lenses = {example_lens("opencv5")}, .n_frames = 8});
  Dataset data = sim.truth.data;
  data.views[1].corners.resize(3);
  data.views[2].corners.clear();
  data.views[2].reason = "no board found";
  const auto cal = calibrate(data, options_for("opencv5"));
  ASSERT_TRUE(cal) << text_of(cal);
  EXPECT_EQ(cal->view_reason[0], "");
  EXPECT_NE(cal->view_reason[1].find("3 corners"), std::string::npos);
  EXPECT_EQ(cal->view_reason[2], "no board found");
  EXPECT_TRUE(cal->fits[1].empty());
  EXPECT_EQ(cal->fits[0].size(), data.views[0].corners.size());
}

TEST(Refine, AStartWithCornersOutsideTheDomainIsRefused) {
  Simulation sim = simulate({.lenses = {example_lens("opencv5")}, .n_frames = 8});
  Calibration start = sim.truth;
  const SE3 T = *start.T_rig_board[4];
  start.T_rig_board[4] = SE3(T.R(), Vec3(0, 0, -T.t().z()));
  RefineOptions options = options_for("opencv5");
  options.mark_outliers = false;
  const auto cal = refine(start, options);
  ASSERT_FALSE(cal);
  EXPECT_EQ(cal.error().code, ErrorCode::kNotConverged);
  EXPECT_NE(cal.error().where.find("4.png"), std::string::npos) << cal.error().text();
}

TEST(Refine, WeightsBySigmaWhenAsked) {
  const Simulation sim = simulate({.lenses = {example_lens("pinhole")}, .seed = 8});
  Calibration start = sim.truth;
  Rng rng(12);
  for (View& view : start.data.views) {
    for (Corner& c : view.corners) {
      c.sigma_px = rng.uniform() < 0.5 ? 0.05 : 1.0;
      c.px += Vec2(rng.normal(c.sigma_px), rng.normal(c.sigma_px));
    }
  }
  RefineOptions options = options_for("pinhole");
  options.mark_outliers = false;
  const auto plain = refine(start, options);
  options.use_sigma = true;
  const auto weighted = refine(start, options);
  ASSERT_TRUE(plain && weighted);
  EXPECT_LT(worst_lens_error_px(sim, *weighted), 0.3 * worst_lens_error_px(sim, *plain));
  EXPECT_LT((*weighted->covariance)(0, 0), 0.1 * (*plain->covariance)(0, 0));
}

}  // namespace
}  // namespace plumbline::test

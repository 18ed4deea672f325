// SPDX-License-Identifier: Apache-2.0
// Held, tied and known parameters. OpenCV is the referee where it has a flag for the same thing; a prior is
// checked against the fusion of two Gaussians.
#include "refine/constraints.hpp"

#include <gmock/gmock.h>

#include "refine/refine_support.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

// OpenCV takes float points: a board and pixels that a float holds exactly, seen whole by all cameras.
Calibration float_problem(int n_cams, std::uint64_t seed = 3, int n_frames = 12) {
  Simulation sim = simulate({.lenses = std::vector<Lens>(n_cams, example_lens("opencv5")),
                             .n_frames = n_frames,
                             .target = Chessboard{.columns = 9, .rows = 6, .square_m = 0.03125},
                             .seed = seed});
  Calibration cal = sim.truth;
  cal.data = with_noise(cal.data, 0.2, seed + 1);
  for (View& view : cal.data.views) {
    std::erase_if(view.corners, [&](const Corner& c) {
      int n = 0;
      for (const View& other : sim.truth.data.views) {
        n += other.frame == view.frame && std::any_of(other.corners.begin(), other.corners.end(),
                                                      [&](const Corner& o) { return o.point == c.point; });
      }
      return n < n_cams;
    });
    for (Corner& c : view.corners) c.px = Vec2(static_cast<float>(c.px.x()), static_cast<float>(c.px.y()));
  }
  for (std::size_t f = 0; f < cal.T_rig_board.size(); ++f) {
    const auto n = std::count_if(cal.data.views.begin(), cal.data.views.end(), [&](const View& view) {
      return view.frame == static_cast<int>(f) && view.corners.size() >= 12;
    });
    if (n == n_cams) continue;
    std::erase_if(cal.data.views, [&](const View& view) { return view.frame == static_cast<int>(f); });
    cal.T_rig_board[f].reset();
  }
  return cal;
}

struct Points {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> px;
};
Points points_of(const Calibration& cal, int cam) {
  Points points;
  for (const View& view : cal.data.views) {
    if (view.cam != cam) continue;
    points.board.emplace_back();
    points.px.emplace_back();
    for (const Corner& c : view.corners) {
      const int column = c.point % 9, row = c.point / 9;
      points.board.back().emplace_back(0.03125F * column, 0.03125F * row, 0.F);
      points.px.back().emplace_back(static_cast<float>(c.px.x()), static_cast<float>(c.px.y()));
    }
  }
  return points;
}

const cv::TermCriteria kTight(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 500, 1e-15);

cv::Mat K_of(const Lens& lens) {
  const Mat3 K = camera_matrix_k(lens);
  return (cv::Mat_<double>(3, 3) << K(0, 0), 0, K(0, 2), 0, K(1, 1), K(1, 2), 0, 0, 1);
}
cv::Mat D_of(const Lens& lens) {
  const auto k = params(lens);
  return cv::Mat(std::vector<double>(k.begin() + 4, k.end()), true).reshape(1, 1);
}

struct MonoCase {
  const char* name;
  int flags;
  std::vector<std::string> fixed, ties;
};

class Referee : public ::testing::TestWithParam<MonoCase> {};

// Both stop far below 1e-6 of the parameters. OpenCV sums its RMS of float residuals: 4e-7 of it.
TEST_P(Referee, OpenCvFindsTheSameOptimum) {
  const MonoCase& c = GetParam();
  Calibration start = float_problem(1);
  auto k = params(start.rig.cameras[0].lens);
  k[0] = k[1] = 560;  // also what FIX_FOCAL_LENGTH holds
  k[2] = 325, k[3] = 239;
  RefineOptions options;
  options.mark_outliers = false;
  options.fixed = c.fixed;
  options.ties = c.ties;
  const Points points = points_of(start, 0);
  cv::Mat K = K_of(start.rig.cameras[0].lens), D = cv::Mat::zeros(1, 5, CV_64F);
  std::vector<cv::Mat> r, t;
  const double rms = cv::calibrateCamera(points.board, points.px, {640, 480}, K, D, r, t,
                                         c.flags | cv::CALIB_USE_INTRINSIC_GUESS, kTight);
  for (const Solver solver : {Solver::kBlocks, Solver::kCeres}) {
    options.solver = solver;
    const auto cal = refine(start, options);
    ASSERT_TRUE(cal) << cal.error().text();
    EXPECT_NEAR(cal->stats.rms_px, rms, 1e-6 * rms);
    const auto ours = params(cal->rig.cameras[0].lens);
    EXPECT_NEAR(ours[0], K.at<double>(0, 0), 1e-6 * ours[0]);
    EXPECT_NEAR(ours[1], K.at<double>(1, 1), 1e-6 * ours[1]);
    EXPECT_NEAR(ours[2], K.at<double>(0, 2), 1e-6 * ours[0]);
    EXPECT_NEAR(ours[3], K.at<double>(1, 2), 1e-6 * ours[0]);
    for (int i = 0; i < 5; ++i) EXPECT_NEAR(ours[4 + i], D.at<double>(i), 1e-5) << i;
    // The covariance has the rank that is left: tied rows are equal, held ones zero.
    const MatX& C = *cal->covariance;
    if (!c.ties.empty()) EXPECT_EQ(C.row(0), C.row(1));
    if (!c.ties.empty()) EXPECT_GT(C(0, 0), 0);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Constraints, Referee,
    ::testing::Values(
        MonoCase{"AspectRatio", cv::CALIB_FIX_ASPECT_RATIO, {}, {"fx=fy"}},
        MonoCase{"FocalLength", cv::CALIB_FIX_FOCAL_LENGTH, {"fx=560", "cam0 fy"}, {}},
        MonoCase{"ZeroTangent", cv::CALIB_ZERO_TANGENT_DIST, {"p1=0", "cam0.p2=0"}, {}},
        MonoCase{"GivenK", cv::CALIB_FIX_FOCAL_LENGTH | cv::CALIB_FIX_PRINCIPAL_POINT, {"K"}, {}},
        MonoCase{"All",
                 cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_PRINCIPAL_POINT,
                 {"p1=0", "p2=0", "cx", "cy"},
                 {"cam0 fy=cam0 fx"}}),
    [](const auto& kind) { return std::string(kind.param.name); });

TEST(Constraints, StereoCalibrateFindsTheSameRigForGivenLenses) {
  const Calibration start = float_problem(2);
  RefineOptions options;
  options.mark_outliers = false;
  options.fixed = {"cam0", "cam1.lens"};
  const Points left = points_of(start, 0), right = points_of(start, 1);
  cv::Mat K0 = K_of(start.rig.cameras[0].lens), K1 = K_of(start.rig.cameras[1].lens);
  cv::Mat D0 = D_of(start.rig.cameras[0].lens), D1 = D_of(start.rig.cameras[1].lens), R, T, E, F;
  const double rms = cv::stereoCalibrate(left.board, left.px, right.px, K0, D0, K1, D1, {640, 480}, R, T, E,
                                         F, cv::CALIB_FIX_INTRINSIC, kTight);
  for (const Solver solver : {Solver::kBlocks, Solver::kCeres}) {
    options.solver = solver;
    const auto cal = refine(start, options);
    ASSERT_TRUE(cal) << cal.error().text();
    EXPECT_NEAR(cal->stats.rms_px, rms, 1e-6 * rms);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(cal->rig.T_cam_rig[1].t()[i], T.at<double>(i), 1e-7);
    EXPECT_EQ(params(cal->rig.cameras[1].lens)[0], params(start.rig.cameras[1].lens)[0]);
  }
}

// OpenCV's CALIB_SAME_FOCAL_LENGTH ends above this optimum, so the cost itself is the referee: with fx of
// both cameras held at values around the tied one it is a parabola whose vertex is the tied optimum.
TEST(Constraints, ATieAcrossCamerasIsTheMinimumOverTheSharedValue) {
  const Calibration start = float_problem(2);
  RefineOptions options;
  options.mark_outliers = false;
  const auto square_at = [&](std::optional<double> fx) {
    options.ties.clear();
    options.fixed.clear();
    if (fx)
      options.fixed = {"cam0 fx=" + format_double(*fx), "cam1 fx=" + format_double(*fx)};
    else
      options.ties = {"cam0 fx=cam1 fx"};
    const auto cal = refine(start, options);
    EXPECT_TRUE(cal) << cal.error().text();
    return std::pair(cal->stats.rms_px * cal->stats.rms_px, params(cal->rig.cameras[1].lens)[0]);
  };
  for (const Solver solver : {Solver::kBlocks, Solver::kCeres}) {
    options.solver = solver;
    const auto [least, fx] = square_at(std::nullopt);
    const double step = 0.5, below = square_at(fx - step).first, above = square_at(fx + step).first;
    EXPECT_NEAR(square_at(fx).first, least, 1e-11 * least);
    EXPECT_GT(std::min(below, above), least);
    // The cubic term of the cost moves the vertex by its share of the step squared.
    EXPECT_NEAR(0.5 * step * (below - above) / (below - 2 * least + above), 0, 2e-3);
  }
}

// With everything in the rig given, the lenses of the two cameras still hang together by the boards.
TEST(Constraints, AGivenRigStays) {
  const Calibration start = float_problem(3);
  RefineOptions options;
  options.fixed = {"rig"};
  const auto cal = refine(start, options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_EQ(cal->rig.T_cam_rig, start.rig.T_cam_rig);
  options.fixed = {"cam1.pose", "cam2 t_x=-0.21"};
  const auto other = refine(start, options);
  ASSERT_TRUE(other) << other.error().text();
  EXPECT_EQ(other->rig.T_cam_rig[1], start.rig.T_cam_rig[1]);
  EXPECT_DOUBLE_EQ(other->rig.T_cam_rig[2].t().x(), -0.21);
  EXPECT_NE(other->rig.T_cam_rig[2].t().y(), start.rig.T_cam_rig[2].t().y());
}

// A stereo head whose third camera stands exactly above the second: t_x of both is one number.
TEST(Constraints, TiesReachAcrossPosesAndLenses) {
  Calibration start = float_problem(3);
  RefineOptions options;
  options.mark_outliers = false;
  options.ties = {"cam1 t_x=cam2 t_x", "cam0=cam1", "cam2 fx=cam1 fy"};
  options.fixed = {"cam1 r_x=-0.02"};  // a rotation held in part, beside ties
  const auto cal = refine(start, options);
  ASSERT_TRUE(cal) << cal.error().text();
  const auto& rig = cal->rig;
  EXPECT_TRUE(std::ranges::equal(params(rig.cameras[0].lens), params(rig.cameras[1].lens)));
  EXPECT_EQ(params(rig.cameras[2].lens)[0], params(rig.cameras[0].lens)[1]);
  EXPECT_EQ(rig.T_cam_rig[1].t().x(), rig.T_cam_rig[2].t().x());
  EXPECT_NEAR(so3_log(rig.T_cam_rig[1].R()).x(), -0.02, 1e-12);
  const MatX& C = *cal->covariance;
  EXPECT_EQ(C.row(0), C.row(9));   // fx of the first two
  EXPECT_EQ(C.row(1), C.row(18));  // fy of the first, fx of the third
  EXPECT_EQ(C(27, 27), 0);         // r_x
  EXPECT_GT(C(28, 28), 0);
  EXPECT_EQ(C.row(30), C.row(36));  // t_x
}

// The change from one calibration to another in steps of the shared parameters.
VecX step_between(const Calibration& a, const Calibration& b) {
  VecX d = detail::shared_values(b) - detail::shared_values(a);
  const detail::Offsets offsets = detail::offsets_of(a);
  for (std::size_t cam = 1; cam < offsets.pose.size(); ++cam)
    d.segment<6>(offsets.pose[cam]) = box_minus(b.rig.T_cam_rig[cam], a.rig.T_cam_rig[cam]);
  return d;
}

// How parameter i grows with each step, by differences.
VecX slope_of(const Calibration& cal, int i) {
  const VecX x = detail::shared_values(cal);
  const detail::Offsets offsets = detail::offsets_of(cal);
  VecX g = VecX::Zero(x.size());
  g[i] = 1;
  const int at = offsets.pose[1];
  for (int k = 0; k < 6 && i >= at; ++k) {
    Calibration moved = cal;
    moved.rig.T_cam_rig[1] = box_plus(cal.rig.T_cam_rig[1], 1e-6 * Vec6::Unit(k));
    g[at + k] = (detail::shared_values(moved)[i] - x[i]) / 1e-6;
  }
  return g;
}

// A prior of the width that the corners know a parameter to: to first order the two are fused as Gaussians,
// d = C g (v - x_i) / (g'C g + s^2), C - C g g'C / (g'C g + s^2), and the scatter of the corners stays.
TEST(Constraints, APriorIsFusedWithTheCorners) {
  Calibration start =
      float_problem(2, 5, 30);  // so many that no fit folds inside the picture, and none is held
  RefineOptions options;
  options.mark_outliers = false;
  const auto without = refine(start, options);
  ASSERT_TRUE(without);
  const std::vector<std::string> names = shared_parameter_names(start);
  for (const std::string name : {"cam0 fx", "cam1 k1", "cam1 r_y", "cam1 t_z"}) {
    const int i = static_cast<int>(std::find(names.begin(), names.end(), name) - names.begin());
    const VecX g = slope_of(*without, i);
    const MatX& C = *without->covariance;
    const double variance = g.dot(C * g), sigma = std::sqrt(variance),
                 value = detail::shared_values(*without)[i] + 2 * sigma;
    options.priors = {{name, value, sigma}};
    const VecX fused = C * g * (2 * sigma / (2 * variance));
    const MatX C_fused = C - C * g * (C * g).transpose() / (2 * variance);
    for (const Solver solver : {Solver::kBlocks, Solver::kCeres}) {
      options.solver = solver;
      const auto with = refine(start, options);
      ASSERT_TRUE(with) << with.error().text();
      const VecX got = step_between(*without, *with);
      for (int k = 0; k < got.size(); ++k) {
        // second order: some per cent of a sigma, and the scatter moves with one more residual of 1,000
        EXPECT_NEAR(got[k], fused[k], 0.05 * std::sqrt(C(k, k))) << name << " moves " << names[k];
        EXPECT_NEAR((*with->covariance)(k, k), C_fused(k, k), 0.05 * C(k, k)) << name << " " << names[k];
      }
      ASSERT_EQ(with->stats.priors.size(), 1u);
      EXPECT_EQ(with->stats.priors[0].parameter, name);
      EXPECT_NEAR(with->stats.priors[0].pull_sigmas, -1, 0.03) << name;  // halfway back from 2 sigmas
    }
  }
}

// Priors too wide to move anything, each exactly one sigma from the estimate, say of the scatter what the
// corners said already: with S their sum of squares over n - f, (S + m S / (n - f)) / (n - f + m) is the
// same.
TEST(Constraints, WidePriorsLeaveTheCovarianceAsItWas) {
  const Calibration start = float_problem(2, 5);
  RefineOptions options;
  options.mark_outliers = false;
  const auto without = refine(start, options);
  ASSERT_TRUE(without) << without.error().text();
  const auto names = shared_parameter_names(start);
  const VecX x = detail::shared_values(*without);
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    const double sigma = 1e4 * std::sqrt((*without->covariance)(i, i));
    options.priors.push_back({names[static_cast<std::size_t>(i)], x[i] + sigma, sigma});
  }
  // The pull of m = 24 such priors is 1e-8 of the information; m in 2,000 residuals left out would show 1 %.
  for (const Solver solver : {Solver::kBlocks, Solver::kCeres}) {
    options.solver = solver;
    const auto with = refine(start, options);
    ASSERT_TRUE(with) << with.error().text();
    for (Eigen::Index i = 0; i < x.size(); ++i)
      EXPECT_NEAR((*with->covariance)(i, i) / (*without->covariance)(i, i), 1, 1e-5) << names[i];
  }
}

// A prior of what is held is a constant, however far off it lies: neither a measurement nor a misfit.
TEST(Constraints, APriorOfWhatIsHeldSaysNothing) {
  const Calibration start = float_problem(2, 5);
  RefineOptions options;
  options.mark_outliers = false;
  options.fixed = {"cam0 fx=548", "cam1.pose"};
  const auto without = refine(start, options);
  options.priors = {{"cam0 fx", 500, 0.1}, {"cam1 r_x", 0.5, 1e-3}, {"cam1 t_y", 1, 1e-3}};
  const auto with = refine(start, options);
  ASSERT_TRUE(without && with);
  const MatX &a = *without->covariance, &b = *with->covariance;
  // The constant is in the cost and moves the solver's stop by 1e-8; counted, four priors would show 2e-3.
  for (Eigen::Index i = 0; i < a.rows(); ++i) EXPECT_NEAR(b(i, i), a(i, i), 1e-6 * a(i, i)) << i;
}

TEST(Constraints, ASharpPriorIsAsGoodAsHolding) {
  Calibration start = float_problem(1, 6);
  RefineOptions options;
  options.priors = {{"fx", 540, 1e-6}};
  const auto with = refine(start, options);
  options.priors.clear();
  options.fixed = {"fx=540"};
  const auto held = refine(start, options);
  ASSERT_TRUE(with && held);
  EXPECT_NEAR(params(with->rig.cameras[0].lens)[1], params(held->rig.cameras[0].lens)[1], 1e-4);
  EXPECT_NEAR(with->stats.rms_px, held->stats.rms_px, 1e-8);
  EXPECT_LT((*with->covariance)(0, 0), 1.1e-12);
}

TEST(Constraints, CalibrateFindsItsStartUnderThem) {
  const Calibration truth = float_problem(2, 7);
  RefineOptions options;
  options.lenses = {"opencv5"};
  options.fixed = {"cam0 fx=548", "p1=0", "p2=0"};
  options.ties = {"cam1 fx=cam1 fy"};
  options.priors = {{"cx", 328, 3}};
  const auto cal = calibrate(truth.data, options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_EQ(params(cal->rig.cameras[0].lens)[0], 548);
  EXPECT_EQ(params(cal->rig.cameras[1].lens)[0], params(cal->rig.cameras[1].lens)[1]);
  EXPECT_EQ(params(cal->rig.cameras[1].lens)[6], 0);
  EXPECT_EQ(cal->stats.priors.size(), 2u);  // cx of both cameras
  const auto same = refine(*cal, options);
  ASSERT_TRUE(same);
  EXPECT_NEAR(same->stats.rms_px, cal->stats.rms_px, 1e-9);
  EXPECT_EQ(cal->provenance.options.at("ties"), "cam1 fx=cam1 fy");
  EXPECT_EQ(cal->provenance.options.at("priors"), "cx=328+-3");
}

// One view is enough where the matrix is given, and boards seen head-on where the focal length is known.
TEST(Constraints, WhatIsKnownNeedsFewerViews) {
  Calibration truth = float_problem(1, 8);
  Dataset data = truth.data;
  data.views.resize(1);
  RefineOptions options;
  options.lenses = {"opencv4"};
  const auto refused = calibrate(data, options);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("at least 3"));
  options.fixed = {"fx=550", "fy=551.65", "cx=328.3", "cy=236.1", "p1=0", "p2=0", "k2=0.09"};
  const auto cal = calibrate(data, options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_NEAR(params(cal->rig.cameras[0].lens)[4], -0.25, 0.05);
}

TEST(Constraints, OnlyOneCameraMoves) {
  Calibration start = float_problem(3, 9);
  params(start.rig.cameras[1].lens)[0] += 10;
  start.rig.T_cam_rig[1] = box_plus(start.rig.T_cam_rig[1], Vec6::Constant(0.01));
  RefineOptions options;
  options.only = {"cam1"};
  const auto cal = refine(start, options);
  ASSERT_TRUE(cal) << cal.error().text();
  for (int cam : {0, 2}) {
    EXPECT_TRUE(std::ranges::equal(params(cal->rig.cameras[cam].lens), params(start.rig.cameras[cam].lens)));
    EXPECT_EQ(cal->rig.T_cam_rig[cam], start.rig.T_cam_rig[cam]);
  }
  EXPECT_NEAR(params(cal->rig.cameras[1].lens)[0], 550, 3);
  EXPECT_LT(box_minus(cal->rig.T_cam_rig[1], float_problem(3, 9).rig.T_cam_rig[1]).norm(), 5e-3);
  options.only = {"cam0"};
  const auto refused = refine(start, options);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("carries the rig's frame"));
  const auto pair = refine(float_problem(2, 9), options);
  ASSERT_TRUE(pair) << pair.error().text();
  EXPECT_EQ(params(pair->rig.cameras[1].lens)[0], 550);
  EXPECT_GT((*pair->covariance)(18, 18), 0);  // where they stand to each other is cam0's as well
}

// What is said of options that two cameras cannot take.
template <class Set>
std::string refusal(Set&& set) {
  RefineOptions options;
  set(options);
  const auto c = detail::constraints_of(float_problem(2), options);
  return c ? std::string("accepted") : c.error().text();
}

TEST(Constraints, WrongOnesAreRefusedWithTheNames) {
  using O = RefineOptions;
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"cam2 fx"}; }), HasSubstr("cam1 t_z"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"cam0.rig"}; }), HasSubstr("there are"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"fx=long"}; }), HasSubstr("not a number"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"cam0 fx=-5"}; }), HasSubstr("positive"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"cam0 fx=500", "cam0.fx=501"}; }), HasSubstr("500 and 501"));
  EXPECT_THAT(refusal([](O& o) { o.ties = {"fx"}; }), HasSubstr("NAME=NAME"));
  EXPECT_THAT(refusal([](O& o) { o.ties = {"fx=cam0 fy"}; }), HasSubstr("2 parameters on the left"));
  EXPECT_THAT(refusal([](O& o) { o.ties = {"fx=fx"}; }), HasSubstr("itself"));
  EXPECT_THAT(refusal([](O& o) { o.ties = {"cam1 r_x=cam1 r_y"}; }), HasSubstr("rotations"));
  EXPECT_THAT(refusal([](O& o) { o.ties = {"cam1 t_x=cam1 fx"}; }), HasSubstr("pose"));
  EXPECT_THAT(refusal([](O& o) {
                o.ties = {"fx=fy"}, o.fixed = {"cam0 fx=500", "cam0 fy=501"};
              }),
              HasSubstr("tied"));
  EXPECT_THAT(refusal([](O& o) { o.priors = {{"fx", 500, 0}}; }), HasSubstr("sigma above 0"));
  EXPECT_THAT(refusal([](O& o) { o.priors = {{"fz", 500, 1}}; }), HasSubstr("fz"));
  EXPECT_THAT(refusal([](O& o) { o.only = {"middle"}; }), HasSubstr("cam0, cam1"));
}

// One number for many parameters, or for parameters of several cameras: accepted before, and always a slip.
TEST(Constraints, AValueIsOfOneParameter) {
  using O = RefineOptions;
  for (const std::string group : {"lens", "K", "pose", "rig", "cam0", "cam0.K", "cam1.pose"}) {
    const std::string text = refusal([&](O& o) { o.fixed = {group + "=1"}; });
    EXPECT_THAT(text, HasSubstr("'" + group + "=1'"));
    EXPECT_THAT(text, HasSubstr(group + " is a group of"));
    EXPECT_EQ(refusal([&](O& o) { o.fixed = {group}; }), "accepted");
    EXPECT_THAT(refusal([&](O& o) { o.priors = {{group, 1, 1}}; }), HasSubstr(group + " is a group of"));
  }
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"pose=2"}; }), HasSubstr("give each its own: cam1 r_x=..."));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"fx=500"}; }), HasSubstr("cam0 fx=500, cam1 fx=500"));
  EXPECT_EQ(refusal([](O& o) { o.fixed = {"k3=0", "p1=0"}; }), "accepted");  // no such term
  EXPECT_EQ(refusal([](O& o) { o.fixed = {"t_x=-0.1"}; }), "accepted");      // of cam1 alone
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"left.fx"}; }), HasSubstr("no camera or board is called 'left'"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"cam0.fz"}; }), HasSubstr("no shared parameter has this name"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"=3"}; }), HasSubstr("no shared parameter has this name"));
  EXPECT_THAT(refusal([](O& o) { o.fixed = {"cam0 fx=nan"}; }), HasSubstr("not a number"));
}

// Eight numbers each, and none of them means the same.
TEST(Constraints, LensesOfTwoKindsAreNotTiedAsAWhole) {
  Calibration start = float_problem(2);
  start.rig.cameras[0].lens = example_lens("opencv4");
  start.rig.cameras[1].lens = example_lens("kb4");
  RefineOptions options;
  options.ties = {"cam0=cam1"};
  const auto c = detail::constraints_of(start, options);
  ASSERT_FALSE(c);
  EXPECT_THAT(c.error().text(), HasSubstr("it ties cam0 p1 to cam1 k3"));
  options.ties = {"cam0.K=cam1.K"};
  EXPECT_TRUE(detail::constraints_of(start, options));
}

// What the seed guesses of a focal length is nothing to hold.
TEST(Constraints, AFocalLengthIsHeldAtANumber) {
  const Calibration truth = float_problem(2, 7);
  const auto refusal = [&](const std::vector<std::string>& fixed) {
    RefineOptions options{.lenses = {"opencv4"}};
    options.fixed = fixed;
    const auto cal = calibrate(truth.data, options);
    return cal ? std::string("accepted") : cal.error().text();
  };
  for (const std::string whole : {"cam1", "lens", "K", "cam0.fx"}) {
    EXPECT_THAT(refusal({"k2", whole}),
                testing::AllOf(HasSubstr("fixed parameter '" + whole + "'"), HasSubstr("give a start")));
  }
  EXPECT_EQ(refusal({"cam1.cx", "k2", "cam0.fx=550"}), "accepted");
  EXPECT_EQ(refusal({"cam1", "cam1.fx=550", "cam1.fy=551.65", "cam1.cx=328.3", "cam1.cy=236.1"}), "accepted");
  RefineOptions options;
  options.fixed = {"cam1"};  // with a start it is what the option is for
  EXPECT_TRUE(refine(truth, options));
}

}  // namespace
}  // namespace plumbline::test

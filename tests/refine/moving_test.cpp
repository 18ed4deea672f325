// SPDX-License-Identifier: Apache-2.0
// Rolling shutters and clocks: the cost, the solve, its refusals.
#include <ceres/cost_function.h>
#include <gmock/gmock.h>

#include <numbers>

#include "moving_support.hpp"
#include "refine/effects.hpp"
#include "refine/moving_cost.hpp"
#include "refine/moving_solve.hpp"

namespace plumbline::test {
namespace {

RefineOptions options_with(Estimate line_delay, Estimate time_offset, bool mark = false) {
  RefineOptions options;
  options.mark_outliers = mark;
  options.line_delay = line_delay;
  options.time_offset = time_offset;
  options.n_threads = 1;
  return options;
}

RecordingOptions pair_of_cameras(std::uint64_t seed = 1) {
  return {.lenses = {example_lens("opencv5"), example_lens("opencv5", 560)}, .seed = seed};
}

TEST(MovingCost, JacobianAgreesWithDifferences) {
  const Target board = *make_target(Chessboard{4, 3, 0.04});
  Rng rng(3);
  const SE3 mid(so3_exp(Vec3(0.4, 0.3, -0.2)), Vec3(0.02, -0.03, 0.6));
  const Motion motion = polynomial_motion(mid, 0.1, 0.1, rng);
  detail::MovingView view{.lens = example_lens("kb4"),
                          .stencil = {{0, 1, 2, 3, 4}, {-0.04, 0, 0.05, 0.08, 0.13}, 1}};
  view.start_s = 0.003;
  view.middle_row = 239.5;
  view.loss = Loss::kHuber;
  view.loss_scale = 20;
  view.further_board = view.bowed = true;
  for (const Vec3& p : board.points)
    view.observations.push_back({p, Vec2(300 + rng.normal(9), 220), 1.5, bow_shape(*board.outline, p)});
  const Lens lens = view.lens;
  SE3 T_cam_rig(so3_exp(Vec3(0.02, -0.05, 0.05)), Vec3(-0.1, 0.02, 0.01));
  SE3 T_further(so3_exp(Vec3(-0.2, 0.1, 0.3)), Vec3(0.02, 0.03, -0.05));
  std::array<SE3, kMotionFrames> poses;
  for (int j = 0; j < kMotionFrames; ++j) poses[j] = motion(0.05 + view.stencil.t_s[j]);
  double delay = 40e-6, offset = 0.011;
  Vec2 bow(0.004, -0.007);
  std::vector<double> k(params(lens).begin(), params(lens).end());
  const auto cost = detail::make_moving_cost(view);
  std::vector<double*> blocks{k.data(), T_cam_rig.qt.data()};
  for (SE3& T : poses) blocks.push_back(T.qt.data());
  for (double* x : {&delay, &offset, T_further.qt.data(), bow.data()}) blocks.push_back(x);
  const int n = cost->num_residuals();
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  std::vector<Rows> J;
  for (int size : cost->parameter_block_sizes()) J.emplace_back(n, size);
  std::vector<double*> out;
  for (Rows& block : J) out.push_back(block.data());
  VecX r(n), up(n), down(n);
  ASSERT_TRUE(cost->Evaluate(blocks.data(), r.data(), out.data()));
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const auto size = cost->parameter_block_sizes()[b];
    const bool is_pose = size == 7;
    // The scale of what moves a pixel by some tens: pixels, radians and metres, rows' and frames' times
    const double h = b == 0 ? 1e-4 : b == 7 ? 1e-10 : 1e-6;
    for (int i = 0; i < (is_pose ? 6 : size); ++i) {
      const std::vector<double> at(blocks[b], blocks[b] + size);
      const auto move = [&](double d) {
        if (is_pose) {
          SE3 T;
          std::copy(at.begin(), at.end(), T.qt.begin());
          T = box_plus(T, d * Vec6::Unit(i));
          std::copy(T.qt.begin(), T.qt.end(), blocks[b]);
        } else {
          blocks[b][i] = at[i] + d;
        }
      };
      move(h);
      ASSERT_TRUE(cost->Evaluate(blocks.data(), up.data(), nullptr));
      move(-h);
      ASSERT_TRUE(cost->Evaluate(blocks.data(), down.data(), nullptr));
      std::copy(at.begin(), at.end(), blocks[b]);
      const VecX numeric = (up - down) / (2 * h), analytic = J[b].col(i);
      // the row is found to 1e-9 px squared, and rounding of 1e-13 px over 2 h is the rest
      EXPECT_LT((analytic - numeric).norm(), 2e-6 * (1 + analytic.norm())) << "block " << b << ", " << i;
    }
    if (is_pose) EXPECT_EQ(J[b].col(6).norm(), 0);
  }
}

TEST(Moving, ComesBackWithoutNoise) {
  const RecordingOptions o = pair_of_cameras();
  const Recording rec = record_polynomials(o);
  const auto cal = refine(start_of(rec), options_with(Estimate::kYes, Estimate::kYes));
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_LT(cal->stats.rms_px, 1e-8);
  ASSERT_EQ(cal->clocks.size(), 2U);
  for (const CameraClock& clock : cal->clocks)
    EXPECT_NEAR(*clock.line_delay_s, o.line_delay_s, 1e-9 * o.line_delay_s);
  EXPECT_FALSE(cal->clocks[0].time_offset_s);
  EXPECT_NEAR(*cal->clocks[1].time_offset_s, o.time_offset_s, 1e-9 * o.time_offset_s);
  for (std::size_t f = 0; f < rec.T_rig_board.size(); ++f)
    EXPECT_LT(box_minus(*cal->T_rig_board[f], *rec.T_rig_board[f]).norm(), 1e-9);
  EXPECT_THAT(shared_parameter_names(*cal),
              testing::IsSupersetOf({"cam0 line_delay", "cam1 line_delay", "cam1 time_offset"}));
  // the measurement model says what the solver fitted
  const View& view = cal->data.views[3];
  EXPECT_LT((*predict(*cal, view, view.corners[5].point) - view.corners[5].px).norm(), 1e-8);
}

TEST(Moving, ComesBackFromCornersAlone) {
  RecordingOptions o = pair_of_cameras(2);
  o.lenses.resize(1);
  const Recording rec = record_polynomials(o);
  RefineOptions options = options_with(Estimate::kYes, Estimate::kNo, true);
  options.bow = Estimate::kYes;
  const auto cal = calibrate(rec.data, options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_LT(cal->stats.rms_px, 1e-7);
  EXPECT_NEAR(*cal->clocks[0].line_delay_s, o.line_delay_s, 1e-7 * o.line_delay_s);
  EXPECT_LT(bow_of(*cal, 0)->norm(), 1e-8);
  EXPECT_NEAR(params(cal->rig.cameras[0].lens)[0], 550, 1e-3);
}

// Squared errors in units of sigma of two delays and an offset over 8 recordings: 24 degrees of freedom, so
// that the mean is 1 +- 0.29.
TEST(Moving, ErrsByItsSigma) {
  double sum = 0;
  const int n = 8;
  for (int seed = 0; seed < n; ++seed) {
    const RecordingOptions o = pair_of_cameras(10 + seed);
    Calibration start = start_of(record_polynomials(o));
    start.data = with_noise(start.data, 0.1, seed);
    const auto cal = refine(start, options_with(Estimate::kYes, Estimate::kYes));
    ASSERT_TRUE(cal) << cal.error().text();
    const MatX C = cal->covariance->bottomRightCorner<3, 3>();
    const Vec3 e(*cal->clocks[0].line_delay_s - o.line_delay_s, *cal->clocks[1].line_delay_s - o.line_delay_s,
                 *cal->clocks[1].time_offset_s - o.time_offset_s);
    sum += e.dot(MatX(C).inverse() * e);
    EXPECT_LT(std::sqrt(C(0, 0)), 0.1 * o.line_delay_s);
  }
  EXPECT_NEAR(sum / (3 * n), 1, 0.87);  // three standard deviations
}

// Not of the model's form: a hand's swing of 1.5 Hz at 25 images a second.
TEST(Moving, FollowsAnySmoothMotion) {
  RecordingOptions o = pair_of_cameras(5);
  o.n_frames = 20;
  o.n_runs = 3;
  const Recording rec = record(o, [](const SE3& mid, double mid_s, Rng& rng) -> Motion {
    const Vec3 turn(rng.normal(0.15), rng.normal(0.15), rng.normal(0.15));
    const Vec3 shift(rng.normal(0.05), rng.normal(0.05), rng.normal(0.05));
    const double w = 2 * std::numbers::pi * 1.5;
    return [=](double t) {
      const double s = std::sin(w * (t - mid_s)), c = std::cos(1.1 * w * (t - mid_s));
      return SE3(so3_exp(turn * s) * so3_exp(0.5 * Vec3(turn.y(), -turn.x(), 0) * c) * mid.R(),
                 mid.t() + shift * c + 0.3 * Vec3(shift.y(), shift.z(), 0) * s);
    };
  });
  Calibration start = start_of(rec);
  start.data = with_noise(start.data, 0.1, 4);
  const auto cal = refine(start, options_with(Estimate::kYes, Estimate::kYes, true));
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_NEAR(cal->stats.rms_px, 0.1 * std::numbers::sqrt2, 0.01);
  const VecX sigma = cal->covariance->diagonal().tail<3>().cwiseSqrt();
  EXPECT_LT(std::abs(*cal->clocks[0].line_delay_s - o.line_delay_s), 4 * sigma[0]);
  EXPECT_LT(std::abs(*cal->clocks[1].time_offset_s - o.time_offset_s), 4 * sigma[2]);
}

TEST(Moving, StillsAreRefusedWithWhatToRecord) {
  const Recording rec = record_polynomials(pair_of_cameras());
  Calibration start = start_of(rec);
  start.data.views[2].time_s.reset();
  auto cal = refine(start, options_with(Estimate::kYes, Estimate::kNo));
  ASSERT_FALSE(cal);
  EXPECT_EQ(cal.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(cal.error().text(), testing::HasSubstr("only the product of delay and velocity"));
  EXPECT_THAT(cal.error().text(), testing::HasSubstr("1 of "));
  start = start_of(rec);
  for (View& view : start.data.views) *view.time_s *= 10;
  cal = refine(start, options_with(Estimate::kYes, Estimate::kNo));
  ASSERT_FALSE(cal);
  EXPECT_THAT(cal.error().text(), testing::HasSubstr("only the product of delay and velocity"));
  EXPECT_THAT(cal.error().text(), testing::HasSubstr("0.4 s"));
  // without times, auto says nothing and changes nothing
  for (View& view : start.data.views) view.time_s.reset();
  cal = refine(start, options_with(Estimate::kAuto, Estimate::kAuto));
  ASSERT_TRUE(cal);
  EXPECT_TRUE(cal->stats.effects.empty());
  // one camera has no offset
  RecordingOptions alone = pair_of_cameras();
  alone.lenses.resize(1);
  cal = refine(start_of(record_polynomials(alone)), options_with(Estimate::kNo, Estimate::kYes));
  ASSERT_FALSE(cal);
  EXPECT_EQ(cal.error().code, ErrorCode::kInvalidData);
}

// Boards that jump from frame to frame have no velocity, whatever their times say.
TEST(Moving, JumpsAreRefused) {
  RecordingOptions o = pair_of_cameras(3);
  o.n_frames = 1;
  o.n_runs = 30;
  Calibration start = start_of(record_polynomials(o));
  for (View& view : start.data.views) view.time_s = 0.04 * view.frame;
  const auto cal = refine(start, options_with(Estimate::kYes, Estimate::kNo));
  ASSERT_FALSE(cal);
  EXPECT_EQ(cal.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(cal.error().text(), testing::HasSubstr("abruptly"));
}

TEST(Moving, AutoFindsWhatIsThere) {
  RecordingOptions o = pair_of_cameras(7);
  for (const double line_delay_s : {0.0, 15e-6}) {
    o.line_delay_s = line_delay_s;
    Calibration start = start_of(record_polynomials(o));
    start.data = with_noise(start.data, 0.1, 8);
    const auto cal = refine(start, options_with(Estimate::kAuto, Estimate::kAuto));
    ASSERT_TRUE(cal) << cal.error().text();
    ASSERT_EQ(cal->stats.effects.size(), 3U);
    EXPECT_EQ(cal->stats.effects[2].effect, "cam1 time_offset");
    EXPECT_TRUE(cal->stats.effects[2].kept);
    for (int cam : {0, 1}) EXPECT_EQ(cal->clocks[cam].line_delay_s.has_value(), line_delay_s > 0);
    EXPECT_NEAR(cal->stats.rms_px, 0.1 * std::numbers::sqrt2, 0.01);
  }
}

// The elimination by bands against a dense one of Jacobians by differences is what the sigmas above rest on;
// held parameters stay where they are.
TEST(Moving, HeldParametersStay) {
  const Recording rec = record_polynomials(pair_of_cameras());
  Calibration start = start_of(rec);
  start.clocks = {{20e-6, std::nullopt}, {30e-6, 0.003}};
  RefineOptions options = options_with(Estimate::kNo, Estimate::kNo);
  options.fixed = {"cam0 line_delay", "time_offset", "k3", "cam1 t_x"};
  const auto cal = refine(start, options);
  ASSERT_TRUE(cal) << cal.error().text();
  EXPECT_EQ(*cal->clocks[0].line_delay_s, 20e-6);
  EXPECT_EQ(*cal->clocks[1].time_offset_s, 0.003);
  EXPECT_EQ(cal->rig.T_cam_rig[1].t().x(), rec.rig.T_cam_rig[1].t().x());
  EXPECT_NE(*cal->clocks[1].line_delay_s, 30e-6);
  EXPECT_GT(cal->stats.rms_px, 0.01);
}

}  // namespace
}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/crosscheck/crosscheck.hpp"

#include <gmock/gmock.h>

#include "plumbline/core/random.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/refine/refine.hpp"
#include "plumbline/synth/scene.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

Target board() { return *make_target(Chessboard{10, 7, 0.03}); }

Calibration simulated(const Target& target, const std::string& lens, int n_cameras, double noise_px,
                      double fov_deg = 70) {
  SceneOptions options;
  options.lens = lens;
  options.fov_deg = fov_deg;
  options.n_views = 14;
  options.n_cameras = n_cameras;
  options.noise_px = noise_px;
  options.seed = 5;
  auto truth = simulate(target, options);
  EXPECT_TRUE(truth) << truth.error().text();
  return *truth;
}

Calibration refined(const Calibration& start) {
  RefineOptions options;
  options.mark_outliers = false;
  auto out = refine(start, options);
  EXPECT_TRUE(out) << out.error().text();
  return *out;
}

// Without noise the referee must land on the truth, whatever it starts from.
TEST(Crosscheck, TheRefereeRecoversTheTruth) {
  for (const char* lens : {"pinhole", "opencv4", "opencv5", "opencv8"}) {
    SCOPED_TRACE(lens);
    const Calibration truth = simulated(board(), lens, 1, 0);
    const auto check = crosscheck_mrcal(truth);
    ASSERT_TRUE(check) << check.error().text();
    EXPECT_LT(check->referee_rms_px, 1e-6);
    // from the naive seed: mrcal's own stopping threshold lies near 1e-5 px, and opencv8 has a flat valley
    EXPECT_LT(check->referee_rms_from_seed_px, std::string(lens) == "opencv8" ? 1e-2 : 1e-4);
    EXPECT_LT(check->cameras[0].diff_px.max, 1e-4);
    EXPECT_EQ(check->cameras[0].referee_parameters.size(), check->cameras[0].parameters.size());
  }
}

TEST(Crosscheck, BothFindTheSameOptimum) {
  const auto check = crosscheck_mrcal(refined(simulated(board(), "opencv5", 2, 0.2)));
  ASSERT_TRUE(check) << check.error().text();
  ASSERT_EQ(check->cameras.size(), 2U);
  for (const CameraCrosscheck& camera : check->cameras) {
    EXPECT_EQ(camera.referee_lens, "LENSMODEL_OPENCV5");
    EXPECT_NEAR(camera.rms_px, camera.referee_rms_px, 1e-6);
    EXPECT_NEAR(camera.rms_px, 0.28, 0.02);  // 0.2 sqrt 2
    EXPECT_LT(camera.diff_px.max, 0.01);
    EXPECT_LT(camera.joint_diff_px.max, 0.01);
    EXPECT_EQ(camera.diff_px.n_samples, 2700);
  }
  EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-6);
  EXPECT_NEAR(check->referee_rms_from_seed_px, check->referee_rms_px, 1e-6);
  EXPECT_THAT(check->notes, testing::IsEmpty());
}

// A bowed board: mrcal's calobject_warp finds the truth where there is no noise, sign and form included, and
// our optimum where there is.
TEST(Crosscheck, TheRefereeFindsTheBow) {
  Calibration cal = simulated(board(), "opencv5", 2, 0);
  const Vec2 bow(1e-3, -2e-3);
  cal.bow_m = {bow};
  Rng rng(3);
  for (const double noise_px : {0.0, 0.2}) {
    for (View& view : cal.data.views) {
      for (Corner& c : view.corners)
        c.px = *predict(cal, view, c.point) + Vec2(rng.normal(noise_px), rng.normal(noise_px));
    }
    const Calibration ours = noise_px > 0 ? refined(cal) : cal;
    const auto check = crosscheck_mrcal(ours);
    ASSERT_TRUE(check) << check.error().text();
    ASSERT_TRUE(check->bow_m && check->referee_bow_m);
    if (noise_px > 0) {
      const Vec2 sigma = ours.covariance->diagonal().tail<2>().cwiseSqrt();
      const Vec2 difference = *check->bow_m - *check->referee_bow_m;
      EXPECT_LT(difference.cwiseQuotient(sigma).cwiseAbs().maxCoeff(), 1e-4);  // mrcal stops that far away
      EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-9);
      EXPECT_NEAR(check->rms_px, check->referee_rms_from_seed_px, 1e-6);
    } else {
      EXPECT_LT((*check->referee_bow_m - bow).norm(), 1e-9);
      EXPECT_LT(check->referee_rms_px, 1e-6);
      EXPECT_LT(check->referee_rms_from_seed_px, 1e-4);
    }
  }
}

// The referee must see an error of ours: one pixel of focal length in the answer.
TEST(Crosscheck, APlantedErrorShows) {
  Calibration cal = refined(simulated(board(), "opencv5", 1, 0.1));
  params(cal.rig.cameras[0].lens)[0] += 1;
  const auto check = crosscheck_mrcal(cal);
  ASSERT_TRUE(check);
  EXPECT_GT(check->rms_px, check->referee_rms_px + 0.01);
  EXPECT_GT(check->cameras[0].diff_px.max, 0.4);
  EXPECT_NEAR(check->cameras[0].parameters[0] - check->cameras[0].referee_parameters[0], 1, 1e-3);

  Calibration pair = refined(simulated(board(), "opencv5", 2, 0.1));
  params(pair.rig.cameras[1].lens)[2] += 1;
  const auto check_pair = crosscheck_mrcal(pair);
  ASSERT_TRUE(check_pair);
  EXPECT_GT(check_pair->rms_px, check_pair->referee_rms_px + 0.01);
  EXPECT_LT(check_pair->cameras[0].joint_diff_px.max, 0.01);
  EXPECT_GT(check_pair->cameras[1].joint_diff_px.max, 0.4);
}

// Outliers and corners that were not seen stay out of mrcal's sum.
TEST(Crosscheck, OutliersAndGapsAreLeftOut) {
  Calibration cal = simulated(board(), "opencv5", 1, 0.1);
  Rng rng(11);
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    View& view = cal.data.views[v];
    while (view.corners.size() > 60)
      view.corners.erase(view.corners.begin() + rng.index(static_cast<int>(view.corners.size())));
    cal.fits[v].assign(view.corners.size(), {});
  }
  cal = refined(cal);
  const double clean = crosscheck_mrcal(cal)->referee_rms_px;
  for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
    if (cal.data.views[v].corners.size() < 60) continue;
    Corner& corner = cal.data.views[v].corners[30];
    corner.px += Vec2(30, -20);
    cal.fits[v][30].outlier = true;
  }
  const auto check = crosscheck_mrcal(cal);
  ASSERT_TRUE(check);
  EXPECT_NEAR(check->referee_rms_px, clean, 0.01);
  for (auto& fits : cal.fits) {
    for (CornerFit& fit : fits) fit.outlier = false;
  }
  EXPECT_GT(crosscheck_mrcal(cal)->referee_rms_px, 10 * clean);
}

TEST(Crosscheck, ATargetWithoutAGridIsProjectedAndSaidSo) {
  const Calibration cal = refined(simulated(*make_target(AprilGrid{}), "opencv5", 1, 0.1));
  const auto check = crosscheck_mrcal(cal);
  ASSERT_TRUE(check) << check.error().text();
  EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-9);
  EXPECT_LT(check->cameras[0].diff_px.max, 1e-8);
  EXPECT_THAT(check->notes, testing::Contains(testing::HasSubstr("not one uniform grid")));
}

TEST(Crosscheck, LensesOfSeveralKindsAreProjectedJointly) {
  Calibration cal = simulated(board(), "opencv5", 2, 0.1);
  const auto k = params(cal.rig.cameras[1].lens);
  OpenCV8 wider{k[0], k[1], k[2], k[3], {k[4], k[5], k[6], k[7], k[8], 0, 0, 0}};
  cal.rig.cameras[1].lens = wider;
  const auto check = crosscheck_mrcal(refined(cal));
  ASSERT_TRUE(check) << check.error().text();
  EXPECT_EQ(check->cameras[1].referee_lens, "LENSMODEL_OPENCV8");
  // Three of the eight distortion numbers are superfluous here, and along the flat valley mrcal from the seed
  // ends lower.
  EXPECT_NEAR(check->cameras[1].rms_px, check->cameras[1].referee_rms_px, 5e-4);
  EXPECT_LE(check->cameras[1].referee_rms_px, check->cameras[1].rms_px + 1e-6);
  EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-9);
  EXPECT_THAT(check->notes, testing::Contains(testing::HasSubstr("this rig has several")));
}

// kb4: mrcal's splined lens stands in, fitted to ours; its focal lengths, centre and poses are then solved by
// mrcal. The fit is good to 0.01 px, and that is how well both must agree, with noise and without.
TEST(Crosscheck, AFisheyeIsComparedWithTheSplinedLens) {
  for (double fov : {100.0, 170.0}) {
    for (double noise_px : {0.0, 0.1}) {
      SCOPED_TRACE(testing::Message() << fov << " deg, noise " << noise_px);
      const auto check = crosscheck_mrcal(refined(simulated(board(), "kb4", 1, noise_px, fov)));
      ASSERT_TRUE(check) << check.error().text();
      const CameraCrosscheck& camera = check->cameras[0];
      EXPECT_THAT(camera.referee_lens, testing::StartsWith("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3"));
      EXPECT_NEAR(camera.rms_px, camera.referee_rms_px, 0.005);
      EXPECT_LT(camera.diff_px.p95, 0.01);
      EXPECT_LT(camera.diff_px.max, 0.05);
      EXPECT_GT(camera.diff_px.compared_fraction, 0.3);
      EXPECT_THAT(check->notes, testing::Contains(testing::HasSubstr("mrcal has no lens kb4")));
    }
  }
}

// Ours is mrcal's lens: both must find one optimum of all control points, each with mrcal's regularisation.
TEST(Crosscheck, ASplinedLensIsSolvedByMrcalToo) {
  const Calibration truth = simulated(board(), "kb4", 2, 0.1, 120);
  RefineOptions options;
  options.mark_outliers = false;
  options.lenses = {"splined:10x9:150"};
  const auto cal = calibrate(truth.data, options);
  ASSERT_TRUE(cal) << cal.error().text();
  const auto check = crosscheck_mrcal(*cal);
  ASSERT_TRUE(check) << check.error().text();
  for (const CameraCrosscheck& camera : check->cameras) {
    EXPECT_EQ(camera.referee_lens, "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=10_Ny=9_fov_x_deg=150");
    EXPECT_NEAR(camera.rms_px, camera.referee_rms_px, 1e-6);
    EXPECT_LT(camera.diff_px.max, 2e-3);  // where mrcal's thresholds stop it
    EXPECT_GT(camera.diff_px.compared_fraction, 0.3);
    double largest = 0;
    for (std::size_t i = 4; i < camera.referee_parameters.size(); ++i)
      largest = std::max(largest, std::abs(camera.referee_parameters[i]));
    EXPECT_GT(largest, 1e-3);  // the stereographic lens alone would not do
  }
  EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-6);
  Calibration bent = *cal;
  const auto k = params(bent.rig.cameras[0].lens);
  for (std::size_t i = 4; i < k.size(); ++i) k[i] += i % 4 < 2 ? 1e-3 : -1e-3;
  const auto planted = crosscheck_mrcal(bent);
  ASSERT_TRUE(planted) << planted.error().text();
  EXPECT_GT(planted->rms_px, planted->referee_rms_px + 0.01);
}

TEST(Crosscheck, APlantedErrorInAFisheyeShows) {
  Calibration cal = refined(simulated(board(), "kb4", 1, 0.1, 140));
  params(cal.rig.cameras[0].lens)[0] += 1;
  const auto check = crosscheck_mrcal(cal);
  ASSERT_TRUE(check) << check.error().text();
  EXPECT_GT(check->rms_px, 1.5 * check->referee_rms_px);
  EXPECT_GT(check->cameras[0].diff_px.max, 0.3);
}

TEST(Crosscheck, ACameraWithoutCornersIsNamed) {
  Calibration cal = simulated(board(), "opencv5", 1, 0.1);
  for (auto& fits : cal.fits) {
    for (CornerFit& fit : fits) fit.outlier = true;
  }
  const auto check = crosscheck_mrcal(cal);
  ASSERT_FALSE(check);
  EXPECT_EQ(check.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(check.error().text(), testing::HasSubstr("cam0"));
}

// The corners of OpenCV's left and right photographs as mrcal's tools and OpenCV solved them (figures per
// coordinate): left alone 0.13819243, fx 532.8271; both 0.15206919, fx 533.416546 and 537.022864.
class ReferenceCorners : public testing::Test {
 protected:
  static std::optional<Calibration> solved(const std::vector<std::string>& sides) {
    const auto dir = data_dir("../reference");
    if (!dir) return std::nullopt;
    const auto images = parse_vnl(read_text(*dir / "corners-fcc.vnl"));
    EXPECT_TRUE(images);
    Dataset data;
    data.targets = {*make_target(Chessboard{9, 6, 0.025})};
    for (std::size_t cam = 0; cam < sides.size(); ++cam) {
      data.cameras.push_back({sides[cam], {640, 480}});
      for (const VnlImage& image : *images) {
        if (!image.filename.starts_with(sides[cam])) continue;
        const std::string key = image.filename.substr(sides[cam].size(), 2);
        auto found = std::find(data.frames.begin(), data.frames.end(), key);
        if (found == data.frames.end()) found = data.frames.insert(found, key);
        data.views.push_back({static_cast<int>(cam), static_cast<int>(found - data.frames.begin()),
                              image.filename, image.corners, ""});
      }
    }
    RefineOptions options;
    options.mark_outliers = false;
    auto cal = calibrate(data, options);
    EXPECT_TRUE(cal) << cal.error().text();
    return *cal;
  }
};

TEST_F(ReferenceCorners, LeftAlone) {
  const auto cal = solved({"left"});
  PLUMBLINE_NEEDS(cal);
  const auto check = crosscheck_mrcal(*cal);
  ASSERT_TRUE(check) << check.error().text();
  EXPECT_NEAR(check->referee_rms_px / std::sqrt(2), 0.13819243, 1e-7);
  EXPECT_NEAR(check->referee_rms_from_seed_px / std::sqrt(2), 0.13819243, 1e-7);
  EXPECT_NEAR(check->cameras[0].referee_parameters[0], 532.8271, 1e-4);
  EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-7);
  EXPECT_LT(check->cameras[0].diff_px.max, 0.01);
}

TEST_F(ReferenceCorners, BothTogether) {
  const auto cal = solved({"left", "right"});
  PLUMBLINE_NEEDS(cal);
  const auto check = crosscheck_mrcal(*cal);
  ASSERT_TRUE(check) << check.error().text();
  EXPECT_NEAR(check->referee_rms_px / std::sqrt(2), 0.15206919, 1e-7);
  EXPECT_NEAR(check->referee_rms_from_seed_px / std::sqrt(2), 0.15206919, 1e-7);
  EXPECT_NEAR(check->rms_px, check->referee_rms_px, 1e-7);
  EXPECT_NEAR(check->cameras[1].referee_parameters[0], 537.45269, 1e-4);
  for (const CameraCrosscheck& camera : check->cameras) {
    EXPECT_LT(camera.diff_px.max, 0.01);
    EXPECT_LT(camera.joint_diff_px.max, 0.01);
  }
}

}  // namespace
}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
// White box: what becomes of a lens whose radial map the corners leave open at the rim of the picture.
#include "refine/monotonic.hpp"

#include <ceres/cost_function.h>
#include <gmock/gmock.h>

#include "plumbline/rig/validity.hpp"
#include "refine/radial_guard.hpp"
#include "refine/refine_support.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

// How far from the centre the image of opencv5 reaches before it turns back along +x, by small steps of the
// formula [px]; stops at `enough`.
double reach_px(const Lens& lens, double enough) {
  const auto k = params(lens);
  double before = 0;
  for (double r = 1e-4; r < 50; r += 1e-4) {
    const double s = r * r, out = k[0] * r * (1 + s * (k[4] + s * (k[5] + s * k[8])));
    if (!(out > before)) return before;
    if (out > enough) return out;
    before = out;
  }
  return before;
}

double corner_px(const Camera& camera) {
  const auto k = params(camera.lens);
  double far = 0;
  for (double x : {0.0, camera.size.width - 1.0}) {
    for (double y : {0.0, camera.size.height - 1.0}) far = std::max(far, std::hypot(x - k[2], y - k[3]));
  }
  return far;
}

// Boards that stay near the middle of the picture.
Dataset central_corners(const Lens& lens, double within_px, double noise_px, std::uint64_t seed) {
  Scene scene{.lenses = {lens}, .fov_deg = 60, .n_frames = 20, .seed = seed};
  Dataset data = simulate(scene).truth.data;
  const auto k = params(lens);
  for (View& view : data.views) {
    std::erase_if(view.corners,
                  [&](const Corner& c) { return (c.px - Vec2(k[2], k[3])).norm() > within_px; });
  }
  std::erase_if(data.views, [](const View& view) { return view.corners.size() < 12; });
  return with_noise(std::move(data), noise_px, seed);
}

// The complaint of OpenCV's users: corners near the middle only, a low RMS, and a polynomial that turns back
// before the corners of the picture. Free, most of these fits do.
TEST(Monotonic, CornersNearTheMiddleGiveALensThatRisesOverThePicture) {
  const Lens lens = OpenCV5{520, 521, 322, 238, {-0.12, 0.04, 0.0005, -0.0004, -0.005}};
  int held = 0, free_folds = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const Dataset data = central_corners(lens, 170, 0.3, seed);
    const auto cal = calibrate(data, {});
    ASSERT_TRUE(cal) << cal.error().text();
    const Camera& camera = cal->rig.cameras[0];
    EXPECT_FALSE(camera.validity) << seed;  // the truth rises: no data contradict it
    const double far = corner_px(camera);
    // What tangential terms move at the corner, where the walk along +x does not see them.
    EXPECT_GE(reach_px(camera.lens, far), far - 1) << seed;
    EXPECT_FALSE(folds_in_image(camera)) << seed;
    const bool was_held = cal->provenance.options.contains("held_monotonic");
    held += was_held;
    if (was_held) {
      ASSERT_FALSE(cal->stats.weak.empty());
      EXPECT_THAT(cal->stats.weak[0].consequence, HasSubstr("rises over the whole picture"));
    }
    // Against a free solve of the same marks: the constraint costs no more than it says.
    Calibration free = *cal;
    const double cost = cal->stats.rms_px * cal->stats.rms_px * cal->stats.n_corners;
    ASSERT_TRUE(detail::solve_ceres(free, {}).usable);
    detail::evaluate(free);
    const double free_rms = camera_rms_px(free, 0);
    EXPECT_LE(cost, free_rms * free_rms * cal->stats.n_corners * (1 + 16.5 / cal->stats.n_corners)) << seed;
    free_folds += folds_in_image(free.rig.cameras[0]);
  }
  EXPECT_GE(held, 3);
  EXPECT_EQ(held, free_folds);
}

// A lens that does turn back, inside the picture, with corners close up to there: no rising map fits them.
TEST(Monotonic, ALensThatTurnsBackIsValidUpToItsCorners) {
  const OpenCV5 lens{400, 401, 321, 239, {-0.25, 0.02, 0, 0, -0.02}};
  const double turn = reach_px(lens, 1e9);
  ASSERT_LT(turn, 350);  // of 400 px to the corner
  const Dataset data = central_corners(lens, 0.97 * turn, 0.05, 4);
  const auto cal = calibrate(data, {});
  ASSERT_TRUE(cal) << cal.error().text();
  const Camera& camera = cal->rig.cameras[0];
  ASSERT_TRUE(camera.validity);
  double outermost = 0;
  for (const View& view : cal->data.views) {
    for (const Corner& c : view.corners) outermost = std::max(outermost, (c.px - Vec2(321, 239)).norm());
  }
  EXPECT_GT(camera.validity->radius_px, outermost - 2);
  EXPECT_LT(camera.validity->radius_px, turn + 2);
  ASSERT_FALSE(cal->stats.weak.empty());
  EXPECT_THAT(cal->stats.weak[0].consequence, HasSubstr("later steps leave out"));
  // Started again from there with the same data it says the same: nothing is carried over.
  const auto again = refine(*cal, {});
  ASSERT_TRUE(again) << again.error().text();
  ASSERT_TRUE(again->rig.cameras[0].validity);
  EXPECT_NEAR(again->rig.cameras[0].validity->radius_px, camera.validity->radius_px, 0.01);
}

TEST(Monotonic, CornersAllOverThePictureAreLeftAlone) {
  const Lens lens = example_lens("opencv5");
  const Dataset data = with_noise(simulate({.lenses = {lens}}).truth.data, 0.2, 1);
  const auto cal = calibrate(data, {});
  ASSERT_TRUE(cal);
  EXPECT_FALSE(cal->rig.cameras[0].validity);
  EXPECT_FALSE(cal->provenance.options.contains("held_monotonic"));
}

// A rational lens with a pole at the distance `pole` from the axis, where numerator and denominator nearly
// cancel: a pinhole for corners that stay away from it, whose noise says nothing of it.
Calibration with_pole(double pole, double residue) {
  OpenCV8 lens{520, 521, 322, 238, {}};
  lens.d[5] = -1 / (pole * pole);
  lens.d[0] = lens.d[5] + residue;
  Calibration cal = simulate({.lenses = {Pinhole{520, 521, 322, 238}}, .n_frames = 20, .seed = 2}).truth;
  cal.rig.cameras[0].lens = lens;
  for (View& view : cal.data.views) {
    std::erase_if(view.corners, [&](const Corner& c) { return (c.px - Vec2(322, 238)).norm() > 170; });
  }
  cal.data = with_noise(cal.data, 0.3, 3);
  for (const View& view : cal.data.views) cal.fits.emplace_back(view.corners.size());
  cal.view_reason.resize(cal.data.views.size());
  detail::evaluate(cal);
  return cal;
}

double cost_of(const Calibration& cal) {
  double cost = 0;
  for (const auto& fits : cal.fits) {
    for (const CornerFit& fit : fits) cost += 0.5 * fit.residual_px.squaredNorm();
  }
  return cost;
}

// Every pixel of the picture has a ray here, in a rim beside the pole, which unprojection does not see.
TEST(Monotonic, APoleInThePictureIsMovedOutOfIt) {
  Calibration cal = with_pole(0.5, 1e-3);
  ASSERT_EQ(domain_fraction(cal.rig.cameras[0]), 1);
  detail::SolveReport report{.usable = true, .converged = true, .cost = cost_of(cal)};
  const auto notes = detail::keep_monotonic(cal, {}, report);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_THAT(notes[0].consequence, HasSubstr("runs off to infinity (its denominator has a pole)"));
  EXPECT_TRUE(notes[0].held) << notes[0].consequence;
  const Camera& camera = cal.rig.cameras[0];
  EXPECT_FALSE(camera.validity);
  EXPECT_FALSE(folds_in_image(camera));
  // By steps of the formula over the whole picture: no pole, and within the noise's reach of the pinhole.
  const auto k = params(camera.lens);
  const double far = corner_px(camera) / k[0];
  double before = 0;
  for (double r = 1e-3; r < 1.5 && before < far; r += 1e-3) {
    const double s = r * r, q = 1 + s * (k[9] + s * (k[10] + s * k[11]));
    ASSERT_GT(q, 0) << r;
    const double out = r * (1 + s * (k[4] + s * (k[5] + s * k[8]))) / q;
    ASSERT_GT(out, before) << r;
    ASSERT_LT(out, before + 0.02) << r;
    before = out;
  }
  EXPECT_GE(before, far - 2.0 / 520);
}

// What a fit has cost when it stopped on its way says nothing of what the corners contradict.
TEST(Monotonic, AConstrainedFitThatDidNotArriveIsNotBelieved) {
  Calibration cal = with_pole(0.5, 1e-3);
  detail::SolveReport report{.usable = true, .converged = true, .cost = cost_of(cal)};
  const auto notes = detail::keep_monotonic(cal, {.max_iterations = 2}, report);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_FALSE(notes[0].held);
  EXPECT_THAT(notes[0].consequence, HasSubstr("did not arrive in 2 iterations"));
  ASSERT_TRUE(cal.rig.cameras[0].validity);
  EXPECT_LT(cal.rig.cameras[0].validity->angle_rad, std::atan(0.5));
  EXPECT_GT(cal.rig.cameras[0].validity->radius_px, 165);
}

// The guard's derivatives against central differences, with lenses that violate it.
TEST(RadialGuard, DerivativesAreThoseOfItsValue) {
  for (std::string_view name : {"opencv4", "opencv5", "opencv8", "opencv12", "kb4"}) {
    Lens lens = example_lens(name);
    params(lens)[4] = -0.4;
    detail::RadialGuard guard{0, 0.4, {}, 300};
    for (double& to : guard.to) to = 1.3;
    const auto cost = detail::make_radial_guard(lens, guard);
    ASSERT_TRUE(cost) << name;
    const int rows = cost->num_residuals(), n = n_params(lens);
    std::vector<double> k(params(lens).begin(), params(lens).end()), r(rows), J(rows * n), up(rows),
        down(rows);
    const double* blocks[] = {k.data()};
    double* jacobians[] = {J.data()};
    ASSERT_TRUE(cost->Evaluate(blocks, r.data(), jacobians));
    EXPECT_GT(*std::max_element(r.begin(), r.end()), 0) << name;
    for (int p = 0; p < n; ++p) {
      const double at = k[p], h = 1e-6 * std::max(1.0, std::abs(at));
      k[p] = at + h;
      ASSERT_TRUE(cost->Evaluate(blocks, up.data(), nullptr));
      k[p] = at - h;
      ASSERT_TRUE(cost->Evaluate(blocks, down.data(), nullptr));
      k[p] = at;
      for (int i = 0; i < rows; ++i) {
        // Residuals of some 1e4 (100 / px, some 100 px / unit): rounding of 1e-12 over h = 1e-6, and
        // curvature.
        EXPECT_NEAR(J[i * n + p], (up[i] - down[i]) / (2 * h), 1e-4 * (1 + std::abs(J[i * n + p]))) << name;
      }
    }
  }
}

}  // namespace
}  // namespace plumbline::test

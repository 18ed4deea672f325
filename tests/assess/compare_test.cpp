// SPDX-License-Identifier: Apache-2.0
#include "plumbline/assess/compare.hpp"

#include <gmock/gmock.h>

#include <cstdio>

#include "plumbline/geometry/so3.hpp"
#include "plumbline/rig/validity.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

Camera pinhole(double f, double cx, double cy) { return {"c", {640, 480}, Pinhole{f, f, cx, cy}}; }

Camera brown() { return {"c", {640, 480}, OpenCV5{532, 533, 342, 235, {-0.28, 0.05, 0.001, -0.0005, 0.02}}}; }

TEST(CompareCameras, TheSameCameraDiffersByNothing) {
  for (Align align : {Align::kNone, Align::kRotation, Align::kPose}) {
    const auto diff = compare_cameras(brown(), brown(), align);
    ASSERT_TRUE(diff);
    EXPECT_LT(diff->max, 1e-8);
    EXPECT_EQ(diff->n_samples, 2700);
    EXPECT_EQ(diff->compared_fraction, 1);
  }
}

// Pinholes whose centres differ by (3, 4) px project every ray 5 px apart.
TEST(CompareCameras, AShiftOfTheCentreIsTheSameEverywhere) {
  const auto diff = compare_cameras(pinhole(500, 320, 240), pinhole(500, 323, 244));
  ASSERT_TRUE(diff);
  EXPECT_NEAR(diff->rms, 5, 1e-9);
  EXPECT_NEAR(diff->p95, 5, 1e-9);
  EXPECT_NEAR(diff->max, 5, 1e-9);
}

// A focal length 1 % longer moves each pixel by 1 % of its distance from the centre: in closed form over the
// grid.
TEST(CompareCameras, AFocalLengthScalesWithTheDistance) {
  const auto diff = compare_cameras(pinhole(500, 319.5, 239.5), pinhole(505, 319.5, 239.5));
  ASSERT_TRUE(diff);
  EXPECT_NEAR(diff->max, 0.01 * std::hypot(319.5, 239.5), 1e-9);
  // mean of x^2 over n points from -a to a in equal steps: a^2 (n + 1) / (3 (n - 1))
  const double mean = 319.5 * 319.5 * 61 / (3 * 59.0) + 239.5 * 239.5 * 46 / (3 * 44.0);
  EXPECT_NEAR(diff->rms, 0.01 * std::sqrt(mean), 1e-9);
}

TEST(CompareCameras, RotationIsFittedAway) {
  const Camera a = brown();
  const Mat3 R = so3_exp(Vec3(0.01, -0.02, 0.03));
  const Projection turned = [&](const Vec3& p, Mat23* J) {
    auto px = project(a.lens, R * p, J);
    if (px && J) *J = *J * R;
    return px;
  };
  EXPECT_GT(compare_projection(a, turned)->max, 5);
  EXPECT_LT(compare_projection(a, turned, Align::kRotation)->max, 1e-6);
  EXPECT_LT(compare_projection(a, turned, Align::kPose)->max, 1e-6);
}

TEST(CompareCameras, PoseFitsWhatRotationCannot) {
  const Camera a = brown();
  const Vec3 t(0.02, -0.01, 0.03);
  const Projection moved = [&](const Vec3& p, Mat23* J) { return project(a.lens, p + t, J); };
  const auto rotation = compare_projection(a, moved, Align::kRotation, 1.0);
  const auto pose = compare_projection(a, moved, Align::kPose, 1.0);
  EXPECT_GT(rotation->rms, 1);
  EXPECT_LT(pose->max, 1e-6);
}

TEST(CompareCameras, CountsOnlyWhatBothLensesSee) {
  const Camera a{"c",
                 {640, 480},
                 KannalaBrandt4{200, 200, 320, 240, 0, 0, 0, 0}};  // 92 degrees from the axis at the sides
  const Camera b{"c", {640, 480}, Pinhole{200, 200, 320, 240}};
  const auto diff = compare_cameras(a, b);
  ASSERT_TRUE(diff);
  EXPECT_LT(diff->compared_fraction, 1);
  EXPECT_GT(diff->compared_fraction, 0.5);
  EXPECT_EQ(diff->n_samples, static_cast<int>(std::lround(2700 * diff->compared_fraction)));
}

TEST(CompareCameras, RefusesSizesThatDiffer) {
  Camera b = brown();
  b.size = {320, 240};
  const auto diff = compare_cameras(brown(), b);
  ASSERT_FALSE(diff);
  EXPECT_EQ(diff.error().code, ErrorCode::kInvalidData);
  EXPECT_THAT(diff.error().text(), testing::HasSubstr("320x240"));
  const auto nothing = compare_projection(brown(), [](const Vec3&, Mat23*) { return std::optional<Vec2>(); });
  ASSERT_FALSE(nothing);
  EXPECT_EQ(nothing.error().code, ErrorCode::kDegenerate);
}

// The same two lenses through mrcal's own projection_diff on the same grid, the frames taken as one: its
// Python module prints the RMS and the largest difference.
TEST(CompareCameras, AgreesWithMrcalsProjectionDiff) {
  if (run("/usr/bin/python3 -c 'import mrcal'").exit_code != 0)
    GTEST_SKIP() << "mrcal's Python module is not installed";
  const TempDir dir;
  const auto write = [&](const std::string& name, const std::string& k) {
    write_text(dir / name, "{'lensmodel': 'LENSMODEL_OPENCV5', 'intrinsics': [" + k +
                               "], 'extrinsics': [0,0,0,0,0,0], 'imagersize': [640, 480]}\n");
  };
  write("a.cameramodel", "532, 533, 342, 235, -0.28, 0.05, 0.001, -0.0005, 0.02");
  write("b.cameramodel", "534, 534.5, 341, 236, -0.275, 0.04, 0.0012, -0.0002, 0.03");
  write_text(dir / "diff.py",
             "import mrcal, numpy as np\n"
             "m = [mrcal.cameramodel('" +
                 dir.path().string() +
                 "/%s.cameramodel' % c) for c in 'ab']\n"
                 "d = mrcal.projection_diff(m, gridn_width=60, gridn_height=45, intrinsics_only=True, "
                 "focus_radius=0, "
                 "use_uncertainties=False)[0]\n"
                 "print('%.12g %.12g' % (np.sqrt((d*d).mean()), d.max()))\n");
  const auto r = run("/usr/bin/python3 " + (dir / "diff.py").string());
  ASSERT_EQ(r.exit_code, 0) << r.err;
  double rms = 0, max = 0;
  ASSERT_EQ(std::sscanf(r.out.c_str(), "%lf %lf", &rms, &max), 2) << r.out;
  Camera b = brown();
  b.lens = OpenCV5{534, 534.5, 341, 236, {-0.275, 0.04, 0.0012, -0.0002, 0.03}};
  const auto ours = compare_cameras(brown(), b);
  ASSERT_TRUE(ours);
  // 1e-4: mrcal unprojects by an optimisation that stops near 1e-5 px
  EXPECT_NEAR(ours->rms, rms, 1e-4);
  EXPECT_NEAR(ours->max, max, 1e-4);
}

// Two pinholes of different focal lengths differ by the distance from the centre: the largest difference says
// up to where was compared, whichever camera has the limit.
TEST(CompareCameras, LooksInsideTheValidityOnly) {
  Camera a = pinhole(500, 319.5, 239.5), b = pinhole(505, 319.5, 239.5);
  a.validity = validity_of(a.lens, std::atan(0.3));
  for (const auto& diff : {compare_cameras(a, b), compare_cameras(b, a)}) {
    ASSERT_TRUE(diff);
    EXPECT_LE(diff->max, 0.01 * 500 * 0.3 * 1.0101);
    EXPECT_GT(diff->max, 0.01 * 500 * 0.28);
    EXPECT_NEAR(diff->compared_fraction, 3.14159 * 150 * 150 / (639.0 * 479.0), 0.01);
  }
}

}  // namespace
}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
// How far a calibration holds, through files of other software.
#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

#include "plumbline/io/formats.hpp"
#include "plumbline/rig/validity.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

Rig rig_of(const Camera& camera) { return {{camera}, {SE3()}}; }

Rig through(const char* format, const Rig& rig) {
  const auto files = find_format(format)->write(rig, {}).value();
  return read_rig(files).value();
}

const OpenCV5 kMild{400, 402, 322, 236, {-0.1, 0.01, 0.001, -0.0005, 0.001}};
const OpenCV5 kFolds{400, 401, 321, 239, {-0.25, 0.02, 0, 0, -0.02}};  // at some 320 of 400 px

TEST(FormatsValidity, ComesBackFromOursAndFromMrcals) {
  for (const char* format : {"plumbline", "mrcal"}) {
    for (double angle : {0.3, 0.6}) {  // inside the picture; cut by its upper and lower border
      Camera camera{"c", {640, 480}, kMild};
      camera.validity = validity_of(camera.lens, angle);
      const Rig back = through(format, rig_of(camera));
      ASSERT_TRUE(back.cameras[0].validity) << format;
      // The contour is halved to 1e-10 of its radius, and its corners are on the true border.
      EXPECT_NEAR(back.cameras[0].validity->angle_rad, angle, 1e-8) << format;
      EXPECT_NEAR(back.cameras[0].validity->radius_px, camera.validity->radius_px, 1e-5) << format;
    }
    Camera whole{"c", {640, 480}, kMild};
    EXPECT_FALSE(through(format, rig_of(whole)).cameras[0].validity) << format;
    whole.validity = validity_of(whole.lens, 1.2);  // beyond the picture's corners
    if (std::string(format) == "mrcal") EXPECT_FALSE(through(format, rig_of(whole)).cameras[0].validity);
  }
}

// A fold that nobody measured is told to mrcal all the same.
TEST(FormatsValidity, MrcalIsToldOfAFold) {
  const Rig back = through("mrcal", rig_of({"c", {640, 480}, kFolds}));
  ASSERT_TRUE(back.cameras[0].validity);
  EXPECT_NEAR(back.cameras[0].validity->angle_rad, domain_angle_rad(kFolds),
              1e-3);  // where the map stands still
}

// Beside a pole of the denominator at tan(angle) = 0.7 every pixel has a ray, and the region that is told
// ends before.
TEST(FormatsValidity, APoleIsNotExportedSilently) {
  const double q = -1 / 0.49;
  const OpenCV8 lens{400, 401, 321, 239, {q + 0.02, 0, 0, 0, 0, q, 0, 0}};
  const Rig rig = rig_of({"c", {640, 480}, lens});
  const Status refused = check_folds(*find_format("opencv"), rig);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("runs off to infinity inside the picture"));
  const Rig back = through("mrcal", rig);
  ASSERT_TRUE(back.cameras[0].validity);
  EXPECT_LT(back.cameras[0].validity->angle_rad, std::atan(0.7));
  EXPECT_GT(back.cameras[0].validity->angle_rad, std::atan(0.5));
  EXPECT_NEAR(back.cameras[0].validity->angle_rad, fold_of(lens).end.angle_rad, 1e-6);
}

TEST(FormatsValidity, MrcalsPythonKnowsTheRegion) {
  Camera camera{"c", {640, 480}, kMild};
  camera.validity = Validity{std::atan(0.5), 0};
  const test::TempDir dir;
  const auto files = find_format("mrcal")->write(rig_of(camera), {}).value();
  test::write_text(dir / "c.cameramodel", files[0].bytes);
  std::string points;
  std::vector<bool> inside;
  for (double x = 5; x < 640; x += 45) {
    for (double y = 5; y < 480; y += 45) {
      const auto ray = unproject(camera.lens, Vec2(x, y));
      const double tangent = std::hypot(ray->x(), ray->y()) / ray->z();
      if (std::abs(tangent - 0.5) < 0.01) continue;  // between two corners of the contour
      inside.push_back(tangent < 0.5);
      points += "(" + std::to_string(x) + "," + std::to_string(y) + "),";
    }
  }
  const test::Run run =
      test::run("/usr/bin/python3 -c \"import mrcal,numpy as np; m=mrcal.cameramodel('" +
                (dir / "c.cameramodel").string() +
                "'); print(''.join('01'[int(v)] for v in mrcal.is_within_valid_intrinsics_region(np.array([" +
                points + "],dtype=float), m)))\"");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::string expected;
  for (bool in : inside) expected += in ? '1' : '0';
  EXPECT_THAT(run.out, HasSubstr(expected));
  EXPECT_THAT(expected, HasSubstr("0"));
}

std::string cameramodel(const std::string& region) {
  return "{ 'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [400, 400, 319.5, 239.5],\n'extrinsics': "
         "[0,0,0,0,0,0],"
         "\n'imagersize': [640,480],\n'valid_intrinsics_region': " +
         region + "}\n";
}

Result<Rig> read_model(const std::string& region) {
  const NamedBytes file{"c.cameramodel", cameramodel(region)};
  return read_rig(std::span(&file, 1));
}

TEST(FormatsValidity, ReadsMrcalsContours) {
  // A square of half side 100 px about the centre: the cone that it holds has that radius, though its corners
  // lie farther out.
  auto rig = read_model("[ [219.5,139.5], [419.5,139.5], [419.5,339.5], [219.5,339.5], [219.5,139.5] ]");
  ASSERT_TRUE(rig) << rig.error().text();
  ASSERT_TRUE(rig->cameras[0].validity);
  EXPECT_NEAR(rig->cameras[0].validity->radius_px, 100,
              0.6);  // edges are looked at every 5 % of the diagonal
  rig = read_model("[ [0,0], [639,0], [639,479], [0,479], [0,0] ]");
  ASSERT_TRUE(rig);
  EXPECT_FALSE(rig->cameras[0].validity);
  EXPECT_FALSE(read_model("None")->cameras[0].validity);
  for (const char* bad : {"[]", "[[1,2],[3,4]]", "'all'", "[[1,2],[3,4],[5,'x']]", "[[1,2],[3,4],[5]]"}) {
    const auto refused = read_model(bad);
    ASSERT_FALSE(refused) << bad;
    EXPECT_THAT(refused.error().where, HasSubstr("valid_intrinsics_region")) << bad;
  }
}

TEST(FormatsValidity, AFoldIsNotExportedSilently) {
  for (const Format* format : formats()) {
    EXPECT_TRUE(check_folds(*format, rig_of({"c", {640, 480}, kMild}))) << format->name;
    const Status folds = check_folds(*format, rig_of({"c", {640, 480}, kFolds}));
    EXPECT_EQ(static_cast<bool>(folds), format->carries_validity) << format->name;
    if (folds) continue;
    EXPECT_EQ(folds.error().code, ErrorCode::kUnsupported);
    EXPECT_THAT(folds.error().message, HasSubstr("plumbline, mrcal can"));
  }
}

}  // namespace
}  // namespace plumbline

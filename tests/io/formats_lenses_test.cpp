// SPDX-License-Identifier: Apache-2.0
// The lenses that one or two formats know, in those formats' order of parameters.
#include <gmock/gmock.h>

#include "plumbline/io/formats.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

// Numbers by hand in Kalibr's order: omni [xi fu fv pu pv], eucm [alpha beta ...], ds [xi alpha ...].
TEST(KalibrFormat, SpheresStandInKalibrsOrder) {
  struct Known {
    std::string camera, distortion, intrinsics, coefficients, lens;
    std::vector<double> params;
  };
  const std::vector<Known> known{
      {"omni", "none", "[1.5, 500.0, 505.0, 320.0, 240.0]", "[]", "ucm", {200, 202, 320, 240, 0.6}},
      {"omni",
       "radtan",
       "[1.5, 500.0, 505.0, 320.0, 240.0]",
       "[0.1, 0.2, 0.3, 0.4]",
       "mei",
       {500, 505, 320, 240, 1.5, 0.1, 0.2, 0.3, 0.4}},
      {"eucm",
       "none",
       "[0.6, 1.1, 500.0, 505.0, 320.0, 240.0]",
       "[]",
       "eucm",
       {500, 505, 320, 240, 0.6, 1.1}},
      {"ds",
       "none",
       "[-0.2, 0.55, 500.0, 505.0, 320.0, 240.0]",
       "[]",
       "ds",
       {500, 505, 320, 240, -0.2, 0.55}},
      {"pinhole", "fov", "[500.0, 505.0, 320.0, 240.0]", "[0.9]", "fov", {500, 505, 320, 240, 0.9}}};
  for (const Known& k : known) {
    const auto rig = read_rig(std::vector<NamedBytes>{
        {"c", "cam0:\n  camera_model: " + k.camera + "\n  distortion_model: " + k.distortion +
                  "\n  intrinsics: " + k.intrinsics + "\n  distortion_coeffs: " + k.coefficients +
                  "\n  resolution: [640, 480]\n  rostopic: /a/image\n"}});
    ASSERT_TRUE(rig) << k.camera << ": " << rig.error().text();
    EXPECT_EQ(lens_name(rig->cameras[0].lens), k.lens);
    for (std::size_t i = 0; i < k.params.size(); ++i)
      EXPECT_DOUBLE_EQ(params(rig->cameras[0].lens)[i], k.params[i]) << k.lens << " " << i;
    const std::string back = find_format("kalibr")->write(*rig, {}).value()[0].bytes;
    EXPECT_THAT(back, HasSubstr("camera_model: " + k.camera + "\n"));
    EXPECT_THAT(back, HasSubstr("distortion_model: " + k.distortion + "\n"));
  }
  EXPECT_THAT(read_rig(std::vector<NamedBytes>{{"c",
                                                "cam0:\n  camera_model: ds\n  distortion_model: radtan\n"
                                                "  intrinsics: [0, 0.5, 1, 1, 1, 1]\n  "
                                                "distortion_coeffs: [0, 0, 0, 0]\n  resolution: [9, 9]\n"}})
                  .error()
                  .text(),
              HasSubstr("'ds-radtan' is not among our lenses"));
}

TEST(ColmapFormat, FisheyesAndDivisionStandInColmapsOrder) {
  // COLMAP's centre of the top-left pixel is (0.5, 0.5).
  const auto more = read_rig(std::vector<NamedBytes>{{"cameras.txt",
                                                      "1 FOV 640 480 500 501 320.5 240.5 0.9\n"
                                                      "2 SIMPLE_DIVISION 640 480 500 320.5 240.5 -0.2\n"
                                                      "3 EUCM 640 480 500 501 320.5 240.5 0.6 1.1\n"
                                                      "4 EUCM 640 480 500 501 320.5 240.5 0.6 1\n"
                                                      "5 SIMPLE_FISHEYE 640 480 500 320.5 240.5\n"}});
  ASSERT_TRUE(more) << more.error().text();
  std::vector<std::string_view> names;
  for (const Camera& camera : more->cameras) names.push_back(lens_name(camera.lens));
  EXPECT_THAT(names, ::testing::ElementsAre("fov", "division", "eucm", "ucm", "kb4"));
  EXPECT_EQ(params(more->cameras[0].lens)[4], 0.9);
  EXPECT_EQ(params(more->cameras[1].lens)[1], 500);
  EXPECT_EQ(params(more->cameras[1].lens)[4], -0.2);
  EXPECT_EQ(params(more->cameras[2].lens)[5], 1.1);
}

}  // namespace
}  // namespace plumbline

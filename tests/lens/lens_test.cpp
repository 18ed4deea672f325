// SPDX-License-Identifier: Apache-2.0
#include "plumbline/lens/lens.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace plumbline {
namespace {

using ::testing::HasSubstr;

// The names that files and the command line use; they may grow but not change.
TEST(Lens, NamesThatOthersRelyOn) {
  const auto names = lens_names();
  EXPECT_THAT(names,
              ::testing::IsSupersetOf({"pinhole", "opencv4", "opencv5", "opencv8", "opencv12", "kb4"}));
}

TEST(Lens, ParametersStandInOpenCvsOrder) {
  const Lens lens = *make_lens("opencv12", {640, 480}, 500);
  EXPECT_THAT(param_names(lens), ::testing::ElementsAre("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3",
                                                        "k4", "k5", "k6", "s1", "s2", "s3", "s4"));
}

TEST(MakeLens, UnknownNameListsWhatThereIs) {
  const auto lens = make_lens("opencv6", ImageSize{640, 480}, 500);
  ASSERT_FALSE(lens);
  EXPECT_EQ(lens.error().code, ErrorCode::kUnsupported);
  EXPECT_THAT(lens.error().message, HasSubstr("'opencv6'"));
  for (std::string_view name : lens_names()) EXPECT_THAT(lens.error().message, HasSubstr(std::string(name)));
  EXPECT_EQ(make_lens("", std::vector<double>{}).error().code, ErrorCode::kUnsupported);
}

TEST(MakeLens, FocalLengthMustBePositive) {
  for (double focal_px : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    const auto lens = make_lens("kb4", ImageSize{640, 480}, focal_px);
    ASSERT_FALSE(lens) << focal_px;
    EXPECT_EQ(lens.error().code, ErrorCode::kInvalidData);
    EXPECT_THAT(lens.error().message, HasSubstr("focal length"));
  }
}

TEST(MakeLens, RefusesParametersThatMakeNoLens) {
  const auto code_and_text = [](std::vector<double> k) {
    const auto lens = make_lens("opencv4", k);
    EXPECT_FALSE(lens);
    return lens ? std::string() : lens.error().text();
  };
  EXPECT_THAT(code_and_text({1, 2, 3}), HasSubstr("lens opencv4 has 8 parameters, 3 are given"));
  EXPECT_THAT(code_and_text({500, 500, 320, 240, 0, 0, 0, 0, 0}), HasSubstr("9 are given"));
  EXPECT_THAT(code_and_text({500, -500, 320, 240, 0, 0, 0, 0}), HasSubstr("fy of lens opencv4 is -500"));
  EXPECT_THAT(code_and_text({0, 500, 320, 240, 0, 0, 0, 0}), HasSubstr("fx of lens opencv4 is 0"));
  EXPECT_THAT(code_and_text({500, 500, 320, 240, 0, std::nan(""), 0, 0}),
              HasSubstr("k2 of lens opencv4 is nan"));
  EXPECT_THAT(code_and_text({500, 500, -INFINITY, 240, 0, 0, 0, 0}), HasSubstr("[kInvalidData]"));
  EXPECT_TRUE(make_lens("opencv4",
                        std::vector<double>{500, 500, -320, 240, 0, 0, 0, 0}));  // a centre may lie outside
}

TEST(Lens, CameraMatrixHoldsTheFirstFour) {
  const Lens lens = *make_lens("kb4", std::vector<double>{500, 510, 320, 240, 0.1, 0, 0, 0});
  Mat3 K;
  K << 500, 0, 320, 0, 510, 240, 0, 0, 1;
  EXPECT_EQ(camera_matrix_k(lens), K);
}

// By hand: x = 0.5, y = -0.25, s = 0.3125.
TEST(Lens, ProjectsWorkedExamples) {
  const Vec3 p(1, -0.5, 2);
  EXPECT_LT((*project(Pinhole{100, 200, 10, 20}, p) - Vec2(60, -30)).norm(), 1e-13);
  const double s = 0.3125, c = 1 + 0.1 * s - 0.2 * s * s;
  const Vec2 brown(0.5 * c + 2 * 0.01 * 0.5 * -0.25 + 0.02 * (s + 0.5),
                   -0.25 * c + 0.01 * (s + 0.125) + 2 * 0.02 * 0.5 * -0.25);
  EXPECT_LT((*project(OpenCV4{1, 1, 0, 0, {0.1, -0.2, 0.01, 0.02}}, p) - brown).norm(), 1e-15);
  const double r = std::hypot(1, 0.5), theta = std::atan2(r, 2.0), d = theta + 0.1 * std::pow(theta, 3);
  EXPECT_LT((*project(KannalaBrandt4{1, 1, 0, 0, 0.1, 0, 0, 0}, p) - Vec2(d / r, -0.5 * d / r)).norm(),
            1e-15);
}

TEST(Lens, JacobianOfTheParametersIsResizedAndLeftAloneOnFailure) {
  JacLens J;
  ASSERT_TRUE(project(*make_lens("opencv12", {640, 480}, 500), Vec3(0, 0, 1), nullptr, &J));
  EXPECT_EQ(J.cols(), 16);
  ASSERT_TRUE(project(*make_lens("pinhole", {640, 480}, 500), Vec3(0, 0, 1), nullptr, &J));
  EXPECT_EQ(J.cols(), 4);
  const MatX before = J;
  EXPECT_FALSE(project(*make_lens("kb4", {640, 480}, 500), Vec3(0, 0, -1), nullptr, &J));
  EXPECT_EQ(MatX(J), before);
}

TEST(Unproject, CentreIsTheOpticalAxisAndRaysAreUnit) {
  for (std::string_view name : lens_names()) {
    const Lens lens = *make_lens(name, {640, 480}, 500);
    const auto ray = unproject(lens, Vec2(319.5, 239.5));
    ASSERT_TRUE(ray) << name;
    EXPECT_LT((*ray - Vec3(0, 0, 1)).norm(), 1e-15) << name;
    EXPECT_NEAR(unproject(lens, Vec2(0, 0))->norm(), 1, 1e-15) << name;
  }
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// A lens that turns back inside its picture, on its way through the program.
#include "plumbline/rig/validity.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/formats.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

std::string yaml_of(const Camera& camera) {
  return find_format("plumbline")->write({{camera}, {SE3()}}, {}).value()[0].bytes;
}

const OpenCV5 kFolds{400, 401, 321, 239, {-0.25, 0.02, 0, 0, -0.02}};  // at some 320 of 400 px

TEST(ValidityOnItsWay, ConvertRefusesAFoldUnlessForced) {
  const test::TempDir dir;
  test::write_text(dir / "in.yaml", yaml_of({"c", {640, 480}, kFolds}));
  const std::string command =
      "convert " + (dir / "in.yaml").string() + " --to ros -o " + (dir / "out").string();
  const test::Run refused = test::plumbline(command);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, HasSubstr("turns back inside the picture"));
  EXPECT_FALSE(std::filesystem::exists(dir / "out"));
  const test::Run forced = test::plumbline(command + " --force");
  EXPECT_EQ(forced.exit_code, 0) << forced.err;
  EXPECT_THAT(forced.err, HasSubstr("WARNING"));
  EXPECT_TRUE(std::filesystem::exists(dir / "out/c.yaml"));
}

TEST(ValidityOnItsWay, CompareLooksInsideOnly) {
  const test::TempDir dir;
  Camera camera{"c", {640, 480}, Pinhole{500, 500, 319.5, 239.5}};
  test::write_text(dir / "a.yaml", yaml_of(camera));
  camera.lens = Pinhole{505, 505, 319.5, 239.5};
  camera.validity = validity_of(camera.lens, 0.3);
  test::write_text(dir / "b.yaml", yaml_of(camera));
  const test::Run run =
      test::plumbline("compare " + (dir / "a.yaml").string() + " " + (dir / "b.yaml").string() + " --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto diff = nlohmann::json::parse(run.out)["diff_px"];
  EXPECT_LE(double(diff["max"]), 5 * std::tan(0.3) + 1e-9);  // 5 px of focal length by the tangent
  EXPECT_LT(double(diff["compared_fraction"]), 0.3);
}

}  // namespace
}  // namespace plumbline

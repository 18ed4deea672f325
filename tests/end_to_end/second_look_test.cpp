// SPDX-License-Identifier: Apache-2.0
// The program looks twice: from images to a calibration with what the second look adds, and said so.
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/assess/compare.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using Json = nlohmann::json;

const std::string kTargets = std::string(PLUMBLINE_SOURCE_DIR) + "/targets/";

class SecondLook : public ::testing::Test {
 protected:
  void simulate(const std::string& arguments) {
    const test::Run run = test::plumbline("simulate " + arguments + " -o " + (dir / "sim").string());
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }
  Json run(const std::string& arguments, const std::string& output) {
    const test::Run done = test::plumbline(arguments + " --json -o " + (dir / output).string());
    EXPECT_EQ(done.exit_code, 0) << done.err;
    return done.exit_code == 0 ? Json::parse(done.out) : Json();
  }
  Calibration read(const std::string& file) { return *parse_calibration(test::read_text(dir / file)); }
  double difference(const std::string& output) {
    const auto diff = compare_cameras(read("sim/truth.yaml").rig.cameras[0],
                                      read(output + "/calibration.yaml").rig.cameras[0], Align::kRotation);
    EXPECT_TRUE(diff) << diff.error().text();
    return diff ? diff->rms : 1e9;
  }
  test::TempDir dir;
};

TEST_F(SecondLook, TakesTheBiasOutOfCircles) {
  const std::string board = " --target " + kTargets + "acircles_4x11_20mm.yaml ";
  simulate(board + "--lens opencv5 --fov 80 --views 9 --seed 3 --image-noise 1");
  const std::string from = "calibrate" + board + "--cam 'cam0=" + (dir / "sim/cam0/*.png").string() + "' ";
  const Json twice = run(from, "twice"), once = run(from + "--no-second-look", "once");
  ASSERT_TRUE(twice.contains("circle_bias") && twice.contains("second_look"));
  EXPECT_FALSE(once.contains("circle_bias") || once.contains("second_look"));
  EXPECT_GE(twice["circle_bias"]["rounds"], 1);
  EXPECT_LE(twice["circle_bias"]["rounds"], 3);
  EXPECT_GT(twice["circle_bias"]["largest_px"], 0.05);
  // The drawing has discs of 0.8 spacings.
  EXPECT_NEAR(twice["circle_bias"]["diameter_m"][0], 0.016, 1e-4);
  EXPECT_EQ(twice["second_look"]["images_read"], 9);
  EXPECT_LT(twice["rms_px"], once["rms_px"]);
  EXPECT_LT(difference("twice"), difference("once"));

  // The corners that are written give the same calibration again, without images.
  run("calibrate --corners " + (dir / "twice/corners.yaml").string(), "again");
  const Calibration a = read("twice/calibration.yaml"), b = read("again/calibration.yaml");
  for (std::size_t i = 0; i < params(a.rig.cameras[0].lens).size(); ++i)
    EXPECT_EQ(params(a.rig.cameras[0].lens)[i], params(b.rig.cameras[0].lens)[i]);

  // With a calibration at hand one look more suffices: the same centres, to what its noise leaves.
  const Json found = run("detect" + board + "--cam 'cam0=" + (dir / "sim/cam0/*.png").string() +
                             "' --calibration " + (dir / "sim/truth.yaml").string(),
                         "corners.yaml");
  EXPECT_EQ(found["second_look"]["images_read"], 9);
  const Json solved = run("calibrate --corners " + (dir / "corners.yaml").string(), "known");
  EXPECT_NEAR(solved["rms_px"], static_cast<double>(twice["rms_px"]), 1e-4);
}

// A board of two equal ends, of which a strip is covered in one camera's photograph: nothing tells which part
// is seen, until the other camera has said where the board was.
TEST_F(SecondLook, SaysWhatItAdds) {
  test::write_text(dir / "board.yaml", "type: chessboard\ncorners: [9, 7]\nsquare_m: 0.03\n");
  const std::string board = " --target " + (dir / "board.yaml").string() + " ";
  simulate(board + "--cams 2 --baseline 0.05 --views 8 --seed 5");
  const Calibration truth = read("sim/truth.yaml");
  for (const View& view : truth.data.views) {
    if (view.cam != 1 || view.frame > 1) continue;
    std::vector<cv::Point> strip;
    for (const Corner& c : view.corners) {
      if (c.point % 9 >= 6) strip.emplace_back(cvRound(c.px.x()), cvRound(c.px.y()));
    }
    cv::Mat image = cv::imread((dir / "sim" / view.image).string(), cv::IMREAD_GRAYSCALE);
    const cv::RotatedRect around = cv::minAreaRect(strip);
    cv::ellipse(image, {around.center, around.size * 2.0F, around.angle}, cv::Scalar(120), cv::FILLED);
    cv::imwrite((dir / "sim" / view.image).string(), image);
  }
  const std::string from = "calibrate" + board + "--cam 'cam0=" + (dir / "sim/cam0/*.png").string() +
                           "' --cam 'cam1=" + (dir / "sim/cam1/*.png").string() + "' ";
  const Json twice = run(from, "twice"), once = run(from + "--no-second-look", "once");
  const Json& look = twice["second_look"];
  const auto corners = [](const Json& json) {
    int n = 0;
    for (const Json& view : json["views"]) n += static_cast<int>(view["corners"]);
    return n;
  };
  EXPECT_EQ(look["cameras"][0]["added_corners"], 0);
  EXPECT_EQ(look["cameras"][1]["added_corners"], look["added_corners"]);
  EXPECT_EQ(corners(twice) - corners(once), look["added_corners"]);
  EXPECT_EQ(look["added_views"], 2);
  EXPECT_GT(look["added_corners"], 40);
  EXPECT_LT(look["rms_px"], 1.5 * static_cast<double>(twice["rms_px"]));
  EXPECT_EQ(look["outliers"], 0);
  EXPECT_FALSE(twice.contains("circle_bias"));
  // Held against the truth over the whole image, what it added does not cost: 5 % for chance.
  EXPECT_LT(difference("twice"), 1.05 * difference("once"));

  const test::Run text = test::plumbline(from + "--force -o " + (dir / "twice").string());
  EXPECT_THAT(text.out, testing::HasSubstr("second look added cam1"));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// calibrate that starts from files, holds and ties parameters, and goes on from an earlier calibration.
#include <gmock/gmock.h>

#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/synth/scene.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

class CalibrateStart : public ::testing::Test {
 protected:
  void SetUp() override {
    const Target target = *make_target(Chessboard{.columns = 9, .rows = 6, .square_m = 0.03});
    truth = *simulate(target, {.lens = "opencv5", .n_views = 12, .n_cameras = 2, .noise_px = 0.1, .seed = 4});
    write_text(dir / "corners.yaml", format_corners(truth.data));
    write_text(dir / "truth.yaml", format_calibration(rig_of(truth)));
  }
  static Calibration rig_of(const Calibration& cal) {
    Calibration rig;
    rig.rig = cal.rig;
    return rig;
  }
  test::Run calibrate(const std::string& arguments) const {
    return plumbline("calibrate " + arguments + " -o " + (dir / "out").string() + " --force");
  }
  Calibration result() const { return *parse_calibration(read_text(dir / "out" / "calibration.yaml")); }
  std::string corners() const { return "--corners " + (dir / "corners.yaml").string(); }

  TempDir dir;
  Calibration truth;
};

TEST_F(CalibrateStart, HoldsTiesAndKnowsParameters) {
  const test::Run done =
      calibrate(corners() + " --fix cam0.cx=319.5,p1=0 --tie fx=fy --prior cam1.cy=239.5+-2");
  ASSERT_EQ(done.exit_code, 0) << done.err;
  const Calibration cal = result();
  const auto k0 = params(cal.rig.cameras[0].lens), k1 = params(cal.rig.cameras[1].lens);
  EXPECT_EQ(k0[2], 319.5);
  EXPECT_EQ(k0[0], k0[1]);
  EXPECT_EQ(k1[0], k1[1]);
  EXPECT_EQ(k1[6], 0);
  ASSERT_EQ(cal.stats.priors.size(), 1u);
  EXPECT_EQ(cal.stats.priors[0].parameter, "cam1 cy");
  EXPECT_THAT(done.out, HasSubstr("prior: cam1 cy = 239.5 +- 2"));
}

TEST_F(CalibrateStart, WrongPartsAreNamed) {
  EXPECT_THAT(calibrate(corners() + " --fix left.fx").err, HasSubstr("cam1 t_z"));
  const test::Run run = calibrate(corners() + " --prior fx=500");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_THAT(run.err, HasSubstr("NAME=VALUE+-SIGMA"));
  EXPECT_EQ(calibrate(corners() + " --start nowhere.yaml").exit_code, 2);
  EXPECT_EQ(calibrate(corners() + " --add").exit_code, 2);
}

// The start may be a file of any format and of another lens.
TEST_F(CalibrateStart, StartsFromCameraFiles) {
  ASSERT_EQ(calibrate(corners()).exit_code, 0);
  const Calibration plain = result();
  ASSERT_EQ(
      plumbline("convert " + (dir / "truth.yaml").string() + " --to mrcal -o " + (dir / "mrcal").string())
          .exit_code,
      0);
  for (const std::string& start : {dir / "truth.yaml", dir / "mrcal"}) {
    const test::Run done = calibrate(corners() + " --start " + start);
    ASSERT_EQ(done.exit_code, 0) << done.err;
    EXPECT_NEAR(result().stats.rms_px, plain.stats.rms_px, 1e-9);
    EXPECT_EQ(result().provenance.options.at("start"), "given");
  }
  const test::Run other = calibrate(corners() + " --lens opencv8 --start " + (dir / "truth.yaml").string());
  ASSERT_EQ(other.exit_code, 0) << other.err;
  EXPECT_EQ(lens_name(result().rig.cameras[0].lens), "opencv8");
  EXPECT_LE(result().stats.rms_px, plain.stats.rms_px);
}

TEST_F(CalibrateStart, AGivenRigAndOneCameraAlone) {
  const std::string start = corners() + " --start " + (dir / "truth.yaml").string();
  ASSERT_EQ(calibrate(start + " --fix rig").exit_code, 0);
  EXPECT_EQ(result().rig.T_cam_rig, truth.rig.T_cam_rig);
  ASSERT_EQ(calibrate(start + " --only cam1").exit_code, 0);
  const Calibration cal = result();
  EXPECT_TRUE(std::ranges::equal(params(cal.rig.cameras[0].lens), params(truth.rig.cameras[0].lens)));
  EXPECT_NE(params(cal.rig.cameras[1].lens)[0], params(truth.rig.cameras[1].lens)[0]);
}

TEST_F(CalibrateStart, ViewsAreAddedToAnEarlierCalibration) {
  // Half of the frames first, the other half added: the same as all at once.
  Dataset first = truth.data, second = truth.data;
  std::erase_if(first.views, [](const View& v) { return v.frame >= 6; });
  std::erase_if(second.views, [](const View& v) { return v.frame < 6; });
  write_text(dir / "corners.yaml", format_corners(first));
  write_text(dir / "more.yaml", format_corners(second));
  ASSERT_EQ(calibrate(corners()).exit_code, 0);
  const std::string old = (dir / "old.yaml").string();
  write_text(old, read_text(dir / "out" / "calibration.yaml"));
  EXPECT_EQ(calibrate(old + " --corners " + (dir / "more.yaml").string()).exit_code, 2);
  const test::Run added = calibrate(old + " --add --corners " + (dir / "more.yaml").string());
  ASSERT_EQ(added.exit_code, 0) << added.err;
  const Calibration cal = result();
  EXPECT_EQ(cal.data.views.size(), truth.data.views.size());
  write_text(dir / "corners.yaml", format_corners(truth.data));
  ASSERT_EQ(calibrate(corners()).exit_code, 0);
  EXPECT_NEAR(cal.stats.rms_px, result().stats.rms_px, 1e-9);
  // the same once more: refused, or in the place of the old ones
  const test::Run again = calibrate(old + " --add " + corners());
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("are there already"));
  ASSERT_EQ(calibrate(old + " --add --replace " + corners()).exit_code, 0);
  EXPECT_NEAR(result().stats.rms_px, cal.stats.rms_px, 1e-9);
  // and solved again alone, with a held lens
  const test::Run alone = calibrate(old + " --fix lens");
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  EXPECT_EQ(result().data.views.size(), first.views.size());
}

TEST_F(CalibrateStart, OneLensIsNamedAndTheOtherKeepsTheStarts) {
  const std::string start = corners() + " --start " + (dir / "truth.yaml").string();
  const test::Run done = calibrate(start + " --lens cam1=opencv8 --fix cam0");
  ASSERT_EQ(done.exit_code, 0) << done.err;
  EXPECT_EQ(lens_name(result().rig.cameras[1].lens), "opencv8");
  EXPECT_TRUE(std::ranges::equal(params(result().rig.cameras[0].lens), params(truth.rig.cameras[0].lens)));
  EXPECT_EQ(calibrate(start + " --lens cam2=opencv8").exit_code, 2);
  EXPECT_EQ(calibrate(corners() + " --lens cam1=opencv8").exit_code, 2);  // without a start, all or none
}

TEST_F(CalibrateStart, NothingThatIsGivenIsIgnored) {
  ASSERT_EQ(calibrate(corners()).exit_code, 0);
  const std::string old = (dir / "old.yaml").string();
  write_text(old, read_text(dir / "out" / "calibration.yaml"));
  for (const std::string option : {"--image-size 640x480", "--pair-by order", "--pair-by name"}) {
    for (const std::string& input : {old, corners()}) {
      const test::Run run = calibrate(input + " " + option);
      EXPECT_EQ(run.exit_code, 2) << input << " " << option;
      EXPECT_THAT(run.err, HasSubstr(option.substr(0, option.find(' '))));
    }
  }
  // Times are taken, into the views that are solved again.
  std::string times = "image,time_s\n";
  for (const View& view : truth.data.views)
    times += view.image + "," + std::to_string(100 + 0.5 * view.frame) + "\n";
  write_text(dir / "times.csv", times);
  const test::Run run = calibrate(old + " --times " + (dir / "times.csv").string());
  ASSERT_EQ(run.exit_code, 0) << run.err;
  for (const View& view : result().data.views) EXPECT_EQ(view.time_s, 0.5 * view.frame);
  EXPECT_EQ(calibrate(old + " --times " + (dir / "none.csv").string()).exit_code, 1);
}

// Each message has what was typed, the file, and what to do.
TEST_F(CalibrateStart, MessagesSpeakOfTheOptionThatWasTyped) {
  ASSERT_EQ(calibrate(corners()).exit_code, 0);
  const std::string old = (dir / "old.yaml").string(), file = (dir / "corners.yaml").string();
  write_text(old, read_text(dir / "out" / "calibration.yaml"));
  const auto says = [&](const std::string& arguments, const std::vector<std::string>& words) {
    const test::Run run = calibrate(arguments);
    EXPECT_EQ(run.exit_code, 1) << arguments;
    for (const std::string& word : words) EXPECT_THAT(run.err, HasSubstr(word)) << arguments;
    EXPECT_THAT(run.err, testing::Not(HasSubstr("--from"))) << arguments;
  };
  says(corners() + " --start " + file, {"--start " + file, "--corners " + file});
  says(file, {file, "--corners " + file});
  says((dir / "truth.yaml").string(), {"--start " + (dir / "truth.yaml").string()});
  write_text(dir / "note.txt", "not a camera");
  const std::string note = (dir / "note.txt").string();
  says(corners() + " --start " + note, {"--start " + note + ": not a camera file"});
  says(old + " --add " + corners(), {"--add to " + old, "there already", "--replace"});
  Dataset other = truth.data;
  other.cameras[1].name = "middle";
  write_text(dir / "other.yaml", format_corners(other));
  const std::string renamed = "--corners " + (dir / "other.yaml").string();
  says(old + " --add " + renamed,
       {"--add to " + old + ": camera middle", "cam0, cam1", "one of these names"});
  says(old + " --add --replace " + renamed, {"--add --replace to " + old + ": camera middle"});
  says(renamed + " --start " + (dir / "truth.yaml").string(),
       {"--start " + (dir / "truth.yaml").string() + ": camera middle", "cam0, cam1", "name the cameras"});
  says("--corners " + old, {old, "--start " + old});
}

}  // namespace
}  // namespace plumbline::test

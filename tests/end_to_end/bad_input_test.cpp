// SPDX-License-Identifier: Apache-2.0
// Each bad input of the command-line contract: its own message, its exit code, and nothing left behind.
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

// A folder with a target and simulated corners in mrcal's text form, made by OpenCV's projection.
class BadInput : public ::testing::Test {
 protected:
  void SetUp() override {
    test::write_text(dir / "board.yaml", "type: chessboard\ncorners: [7, 5]\nsquare_m: 0.03\n");
    test::write_text(dir / "good.vnl", corners(8, true));
  }

  // Corners of n views of a 7x5 board; tilted, or all parallel to the image.
  static std::string corners(int n_views, bool tilted) {
    std::vector<cv::Point3d> board;
    for (int i = 0; i < 35; ++i) board.emplace_back(0.03 * (i % 7), 0.03 * (i / 7), 0);
    const cv::Mat K = (cv::Mat_<double>(3, 3) << 600, 0, 320, 0, 605, 240, 0, 0, 1);
    const std::vector<double> distortion{-0.2, 0.05, 0.001, -0.001, 0};
    std::string text = "# filename x y level\n";
    for (int v = 0; v < n_views; ++v) {
      const double a = 0.7 * v;
      const cv::Vec3d rotation =
          tilted ? cv::Vec3d(0.5 * std::cos(a), 0.5 * std::sin(a), 0.1 * v) : cv::Vec3d(0, 0, 0.2 * v);
      const cv::Vec3d translation(-0.09 + 0.05 * std::cos(a), -0.06 + 0.04 * std::sin(a),
                                  tilted ? 0.45 + 0.02 * v : 0.5);
      std::vector<cv::Point2d> px;
      cv::projectPoints(board, rotation, translation, K, distortion, px);
      for (const cv::Point2d& p : px)
        text +=
            "img" + std::to_string(v) + ".png " + std::to_string(p.x) + " " + std::to_string(p.y) + " 0\n";
    }
    return text;
  }

  test::Run calibrate_vnl(const std::string& file, const std::string& more = "") {
    return test::plumbline("calibrate --corners " + (dir / file).string() + " --target " +
                           (dir / "board.yaml").string() + " --image-size 640x480 -o " +
                           (dir / "out").string() + " " + more);
  }

  test::Run calibrate_images(const std::string& pattern) {
    return test::plumbline("calibrate --target " + (dir / "board.yaml").string() +
                           " --cam 'cam=" + (dir / pattern).string() + "' -o " + (dir / "out").string());
  }

  // The failure is one line on stderr, and no output and no temporary thing is left in the folder.
  void expect_failed(const test::Run& run, const std::string& says, int exit_code = 1) {
    EXPECT_EQ(run.exit_code, exit_code) << run.err;
    EXPECT_THAT(run.err, HasSubstr(says));
    // One line of failure; on a slow machine lines of progress may stand before it.
    const std::string last = run.err.substr(run.err.rfind('\n', run.err.size() - 2) + 1);
    if (exit_code == 1) EXPECT_THAT(last, AllOf(testing::StartsWith("plumbline "), HasSubstr(says)));
    for (const auto& entry : fs::directory_iterator(dir.path())) {
      const std::string name = entry.path().filename().string();
      EXPECT_THAT(name, AllOf(Not(HasSubstr("out")), Not(testing::StartsWith(".")))) << "left behind";
    }
  }

  test::TempDir dir;
};

TEST_F(BadInput, TheGoodInputOfTheseTestsIsGood) {
  const test::Run run = calibrate_vnl("good.vnl");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_TRUE(fs::exists(dir / "out/calibration.yaml"));
  EXPECT_TRUE(fs::exists(dir / "out/corners.yaml"));
}

TEST_F(BadInput, MissingFiles) {
  expect_failed(calibrate_vnl("nothing.vnl"), "nothing.vnl");
  expect_failed(calibrate_images("nothing*.png"), "no file matches");
  expect_failed(test::plumbline("rectify " + (dir / "no.yaml").string() + " --cam a=x --cam b=y -o " +
                                (dir / "out").string()),
                "no.yaml");
}

TEST_F(BadInput, AnImageThatCannotBeDecoded) {
  test::write_text(dir / "a.png", "this is not a picture");
  expect_failed(calibrate_images("a*.png"), "a.png");
  test::write_text(dir / "a.png", "");
  expect_failed(calibrate_images("a*.png"), "a.png");
}

TEST_F(BadInput, TwoImageSizesInOneCamera) {
  cv::imwrite((dir / "a1.png").string(), cv::Mat(200, 300, CV_8U, cv::Scalar(128)));
  cv::imwrite((dir / "a2.png").string(), cv::Mat(201, 300, CV_8U, cv::Scalar(128)));
  expect_failed(calibrate_images("a*.png"), "300x201");
}

TEST_F(BadInput, TheBoardIsInNoImage) {
  cv::imwrite((dir / "a1.png").string(), cv::Mat(200, 300, CV_8U, cv::Scalar(128)));
  cv::imwrite((dir / "a2.png").string(), cv::Mat(200, 300, CV_8U, cv::Scalar(90)));
  expect_failed(calibrate_images("a*.png"), "7x5");
}

TEST_F(BadInput, TooFewViews) {
  test::write_text(dir / "few.vnl", corners(1, true));
  expect_failed(calibrate_vnl("few.vnl"), "view");
  test::write_text(dir / "few.vnl", "# filename x y level\n");
  expect_failed(calibrate_vnl("few.vnl"), "few.vnl");
}

TEST_F(BadInput, ViewsThatAreAllParallelToTheImage) {
  test::write_text(dir / "flat.vnl", corners(8, false));
  expect_failed(calibrate_vnl("flat.vnl"), "parallel");
}

TEST_F(BadInput, DltOfAFlatBoardIsRefused) {
  expect_failed(calibrate_vnl("good.vnl", "--start dlt"), "kDegenerate");
}

TEST_F(BadInput, TruncatedAndHostileYaml) {
  ASSERT_EQ(calibrate_vnl("good.vnl").exit_code, 0);
  const std::string whole = test::read_text(dir / "out/calibration.yaml");
  fs::remove_all(dir / "out");
  test::write_text(dir / "cal.yaml", whole.substr(0, whole.size() / 2));
  const std::string crosscheck = "crosscheck " + (dir / "cal.yaml").string();
  expect_failed(test::plumbline(crosscheck), "cal.yaml");
  test::write_text(dir / "cal.yaml", std::string(100000, '['));
  expect_failed(test::plumbline(crosscheck), "cal.yaml");
  test::write_text(dir / "cal.yaml", "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]\n");
  expect_failed(test::plumbline(crosscheck), "cal.yaml");
  test::write_text(dir / "cal.yaml", "");
  expect_failed(test::plumbline(crosscheck), "cal.yaml");
}

TEST_F(BadInput, NotANumber) {
  std::string text = corners(8, true);
  text.replace(text.find("img3.png ") + 9, 5, "nan  ");
  test::write_text(dir / "nan.vnl", text);
  expect_failed(calibrate_vnl("nan.vnl"), "nan.vnl");
  test::write_text(dir / "board.yaml", "type: chessboard\ncorners: [7, 5]\nsquare_m: .nan\n");
  expect_failed(calibrate_vnl("good.vnl"), "square_m");
}

TEST_F(BadInput, AnExistingOutputIsNotTouchedWithoutForce) {
  ASSERT_EQ(calibrate_vnl("good.vnl").exit_code, 0);
  const std::string before = test::read_text(dir / "out/calibration.yaml");
  test::write_text(dir / "out/mine.txt", "keep me");
  const test::Run again = calibrate_vnl("good.vnl", "--lens opencv4");
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("--force"));
  EXPECT_EQ(test::read_text(dir / "out/calibration.yaml"), before);
  EXPECT_EQ(test::read_text(dir / "out/mine.txt"), "keep me");
  // --force replaces results, and nothing that is not one.
  const test::Run foreign = calibrate_vnl("good.vnl", "--lens opencv4 --force");
  EXPECT_EQ(foreign.exit_code, 1);
  EXPECT_THAT(foreign.err, HasSubstr("mine.txt"));
  EXPECT_EQ(test::read_text(dir / "out/mine.txt"), "keep me");
  fs::remove(dir / "out/mine.txt");
  EXPECT_EQ(calibrate_vnl("good.vnl", "--lens opencv4 --force").exit_code, 0);
  EXPECT_NE(test::read_text(dir / "out/calibration.yaml"), before);
}

TEST_F(BadInput, CornersThatDoNotFitTheTarget) {
  std::string text = corners(8, true);
  text.resize(text.size() - 200);
  text.resize(text.rfind('\n') + 1);
  test::write_text(dir / "cut.vnl", text);
  expect_failed(calibrate_vnl("cut.vnl"), "35 points");
  ASSERT_EQ(calibrate_vnl("good.vnl").exit_code, 0);
  fs::rename(dir / "out/corners.yaml", dir / "corners.yaml");
  fs::remove_all(dir / "out");
  test::write_text(dir / "other.yaml", "type: chessboard\ncorners: [7, 5]\nsquare_m: 0.06\n");
  expect_failed(test::plumbline("calibrate --corners " + (dir / "corners.yaml").string() + " --target " +
                                (dir / "other.yaml").string() + " -o " + (dir / "out").string()),
                "leave --target away");
}

TEST_F(BadInput, AFullDisc) {
  // A file size limit of 4 KiB: writing fails part of the way.
  const std::string rest = " calibrate --corners " + (dir / "good.vnl").string() + " --target " +
                           (dir / "board.yaml").string() + " --image-size 640x480 -o " +
                           (dir / "out").string();
  expect_failed(test::run("mkdir -p " + (dir / "tmp").string() + "; ulimit -f 4; " + PLUMBLINE_BINARY + rest +
                          " >/dev/null"),
                "calibration.yaml");
  fs::remove_all(dir / "tmp");
  const std::string limited = std::string("ulimit -f 4; ") + PLUMBLINE_BINARY + " ",
                    board = (dir / "board.yaml").string();
  const std::string out = " -o " + (dir / "out").string() + " >/dev/null";
  expect_failed(test::run(limited + "simulate --target " + board + " --views 2 --size 320x240" + out),
                "File too large");
  expect_failed(
      test::run(limited + "target print " + board + " -o " + (dir / "out.png").string() + " >/dev/null"),
      "out.png");
  const test::Run full = test::run(std::string(PLUMBLINE_BINARY) + " list lenses >/dev/full");
  EXPECT_EQ(full.exit_code, 1);
  EXPECT_THAT(full.err, HasSubstr("standard output"));
  const test::Run target =
      test::plumbline("target new --type chessboard --corners 9x6 --square 0.025 --force -o /dev/full");
  EXPECT_EQ(target.exit_code, 1);
  EXPECT_THAT(target.err, HasSubstr("/dev/full"));
}

TEST_F(BadInput, WrongUsage) {
  for (const char* arguments :
       {"", "nonsense", "calibrate", "calibrate --lens", "list", "list nothing",
        "convert a.yaml --to nothing -o x",
        "target new --type chessboard --corners 9 --square 0.025 -o x.yaml",
        "detect --target t --cam noequals -o x.yaml", "compare a.yaml",
        "compare a.yaml b.yaml --max-diff nan", "crosscheck a.yaml --max-diff inf",
        "calibrate --corners a.yaml -o x --max-rms nan",
        "target new --type chessboard --corners 9x6 --square 0.025 --tags 6x6 -o x.yaml",
        "detect --target t --cam a=b -o x.json", "--threads -3 list lenses",
        "rectify c.yaml --cam a=b -o x"}) {
    const test::Run run = test::plumbline(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments << ": " << run.err;
    EXPECT_FALSE(run.err.empty()) << arguments;
    EXPECT_TRUE(run.out.empty()) << arguments;
  }
  const test::Run lens = calibrate_vnl("good.vnl", "--lens nothing");
  expect_failed(lens, "opencv5", 2);
}

TEST_F(BadInput, QualityGates) {
  const test::Run missed = calibrate_vnl("good.vnl", "--lens pinhole --outliers off --max-rms 0.01 --json");
  EXPECT_EQ(missed.exit_code, 3) << missed.err;
  fs::remove_all(dir / "out");
  EXPECT_EQ(calibrate_vnl("good.vnl", "--max-rms 0.01").exit_code, 0);
  const std::string calibration = (dir / "out/calibration.yaml").string();
  EXPECT_EQ(test::plumbline("compare " + calibration + " " + calibration + " --max-diff 1e-9").exit_code, 0);
  EXPECT_EQ(test::plumbline("crosscheck " + calibration + " --max-diff 1e-15").exit_code, 3);
  const std::string other = (dir / "other").string();
  ASSERT_EQ(test::plumbline("calibrate --lens opencv4 --corners " + (dir / "out/corners.yaml").string() +
                            " -o " + other)
                .exit_code,
            0);
  EXPECT_EQ(test::plumbline("compare " + calibration + " " + other + "/calibration.yaml --max-diff 1e-15")
                .exit_code,
            3);
}

TEST_F(BadInput, HelpIsNotAnError) {
  EXPECT_EQ(test::plumbline("--help").exit_code, 0);
  EXPECT_EQ(test::plumbline("calibrate --help").exit_code, 0);
  EXPECT_THAT(test::plumbline("--help").out, HasSubstr("calibrate"));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// The whole road on simulated data with known truth: no focal length is given anywhere.
#include <nlohmann/json.hpp>

#include "plumbline/assess/compare.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/lens/lens.hpp"
#include "support/lens_samples.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using Json = nlohmann::json;

const std::string kTargets = std::string(PLUMBLINE_SOURCE_DIR) + "/targets/";

Calibration read(const std::filesystem::path& file) { return *parse_calibration(test::read_text(file)); }

class Simulated : public ::testing::Test {
 protected:
  void simulate(const std::string& arguments) {
    const test::Run run = test::plumbline("simulate " + arguments + " --force -o " + (dir / "sim").string());
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }
  Json calibrate(const std::string& arguments) {
    const test::Run run =
        test::plumbline("calibrate " + arguments + " --json --force -o " + (dir / "cal").string());
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return run.exit_code == 0 ? Json::parse(run.out) : Json();
  }
  DiffPx difference(int cam) {
    const Calibration truth = read(dir / "sim/truth.yaml"), ours = read(dir / "cal/calibration.yaml");
    const auto diff = compare_cameras(truth.rig.cameras[cam], ours.rig.cameras[cam]);
    EXPECT_TRUE(diff) << diff.error().text();
    return diff ? *diff : DiffPx{};
  }
  test::TempDir dir;
};

TEST_F(Simulated, WithoutNoiseEveryLensGivesTheTruthBack) {
  for (std::string_view lens : test::fixed_lens_names()) {
    const std::string name(lens);
    simulate("--target " + kTargets + "chessboard_9x6_25mm.yaml --lens " + name +
             " --fov 65 --views 25 --noise 0 --cams 2 --baseline 0.08 --no-images --seed 7");
    calibrate("--corners " + (dir / "sim/corners.yaml").string() + " --lens " + name + " --outliers off");
    for (int cam : {0, 1}) {
      // Over the whole image, also where no corner was; the rational lenses' coefficients trade against one
      // another there.
      const double limit = name == "opencv8" || name == "opencv12" ? 1e-5 : 1e-6;
      EXPECT_LT(difference(cam).max, limit) << name << " camera " << cam;
    }
    const Calibration truth = read(dir / "sim/truth.yaml"), ours = read(dir / "cal/calibration.yaml");
    EXPECT_LT(ours.stats.rms_px, 1e-6) << name;
    EXPECT_LT(box_minus(ours.rig.T_cam_rig[1], truth.rig.T_cam_rig[1]).norm(), 1e-7) << name;
  }
}

TEST_F(Simulated, TheLensIsChosenAndTheTableKept) {
  simulate("--target " + kTargets +
           "chessboard_9x6_25mm.yaml --lens opencv4 --fov 65 --views 24 --noise 0.2 --no-images --seed 7");
  const std::string corners = "--corners " + (dir / "sim/corners.yaml").string() + " --lens auto";
  const Json report = calibrate(corners + " --threads 1");
  ASSERT_TRUE(report.contains("lens_tries"));
  const std::string bytes = test::read_text(dir / "cal/calibration.yaml");
  calibrate(corners + " --threads 3");
  EXPECT_EQ(test::read_text(dir / "cal/calibration.yaml"), bytes);
  const Calibration ours = read(dir / "cal/calibration.yaml");
  EXPECT_EQ(report["lens_tries"].size(), ours.provenance.lens_tries.size());
  std::string chosen;
  for (const Json& t : report["lens_tries"]) {
    EXPECT_TRUE(t["held_out_px"].is_number() || t["reason"].is_string()) << t;
    if (t["chosen"]) chosen = t["lens"];
  }
  EXPECT_EQ(chosen, report["cameras"][0]["lens"]);
  EXPECT_EQ(chosen, lens_name(ours.rig.cameras[0].lens));
  const test::Run text = test::plumbline("calibrate " + corners + " --force -o " + (dir / "cal").string());
  EXPECT_THAT(text.out, ::testing::HasSubstr(" * " + chosen));
}

TEST_F(Simulated, RenderedStereoPicturesGiveTheRigBackWithinTheirNoise) {
  simulate(
      "--target " + kTargets +
      "charuco_8x11_24mm_4X4_50.yaml --lens opencv5 --fov 60 --views 15 --cams 2 --baseline 0.1 --seed 5");
  const std::string sim = (dir / "sim").string();
  const Json report = calibrate("--target " + kTargets + "charuco_8x11_24mm_4X4_50.yaml --cam 'cam0=" + sim +
                                "/cam0/*.png' --cam 'cam1=" + sim + "/cam1/*.png'");
  ASSERT_TRUE(report.contains("rms_px"));
  EXPECT_LT(double(report["rms_px"]), 0.15);
  const Calibration truth = read(dir / "sim/truth.yaml"), ours = read(dir / "cal/calibration.yaml");
  ASSERT_TRUE(ours.covariance);
  // Each shared parameter within five of its own standard deviations: the sigmas are not much too small.
  const auto values = [](const Calibration& c) {
    std::vector<double> all;
    for (const Camera& camera : c.rig.cameras)
      all.insert(all.end(), params(camera.lens).begin(), params(camera.lens).end());
    return all;
  };
  const std::vector<double> t = values(truth), o = values(ours);
  for (std::size_t i = 0; i < t.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    EXPECT_LT(std::abs(t[i] - o[i]), 5 * std::sqrt((*ours.covariance)(k, k)))
        << shared_parameter_names(ours.rig)[i];
  }
  EXPECT_LT(box_minus(ours.rig.T_cam_rig[1], truth.rig.T_cam_rig[1]).norm(), 2e-3);
}

TEST_F(Simulated, OnePictureOfACornerOfThreeBoardsGivesTheCameraMatrix) {
  const std::string target = kTargets + "corner_cube_inside_charuco_5x5_30mm.yaml";
  simulate("--target " + target + " --lens pinhole --fov 45 --size 1280x960 --views 1 --seed 3");
  const Json report = calibrate("--target " + target + " --cam 'cam0=" + (dir / "sim/cam0").string() +
                                "/*.png' --start dlt --lens pinhole");
  ASSERT_EQ(report["camera_matrices"].size(), 1U);
  const Json& m = report["camera_matrices"][0];
  const Calibration truth = read(dir / "sim/truth.yaml");
  const Mat3 K_true = camera_matrix_k(truth.rig.cameras[0].lens);
  const SE3 T_true = *truth.T_rig_board[0];
  // A corner at about 0.05 px of 45 corners: focal length to 0.5 %, pose to millimetres.
  EXPECT_NEAR(double(m["K"][0][0]) / K_true(0, 0), 1, 5e-3);
  EXPECT_NEAR(double(m["K"][1][1]) / K_true(1, 1), 1, 5e-3);
  Mat34 P;
  Mat3 K, R;
  Vec3 t, C;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) P(r, c) = m["P"][r][c];
    for (int c = 0; c < 3; ++c) K(r, c) = m["K"][r][c], R(r, c) = m["R"][r][c];
    t[r] = m["t"][r];
    C[r] = m["C"][r];
  }
  EXPECT_LT((C - T_true.centre()).norm(), 5e-3);
  EXPECT_LT((R.transpose() * T_true.R() - Mat3::Identity()).norm(), 1e-2);
  EXPECT_GT(R.determinant(), 0);
  EXPECT_LT((P * C.homogeneous()).norm() / P.norm(), 1e-12);  // the centre is the null vector of P
  Mat34 Rt;
  Rt << R, t;
  EXPECT_LT((P - K * Rt).norm() / P.norm(), 1e-12);
  const test::Run text =
      test::plumbline("calibrate --force --target " + target + " --cam 'cam0=" + (dir / "sim/cam0").string() +
                      "/*.png' --start dlt --lens pinhole -o " + (dir / "cal").string());
  for (const char* name : {" P = ", " K = ", " R = ", " t = ", " C = "})
    EXPECT_THAT(text.out, ::testing::HasSubstr(name));
}

TEST_F(Simulated, AFisheyeBeyond180DegreesFromItsPictures) {
  simulate("--target " + kTargets +
           "aprilgrid_6x6_88mm.yaml --lens kb4 --fov 190 --size 800x800 --views 20 --seed 2");
  const Json report = calibrate("--target " + kTargets + "aprilgrid_6x6_88mm.yaml --cam 'cam0=" +
                                (dir / "sim/cam0").string() + "/*.png' --lens kb4");
  ASSERT_TRUE(report.contains("rms_px"));
  const Calibration truth = read(dir / "sim/truth.yaml");
  EXPECT_NEAR(double(report["cameras"][0]["params"]["fx"]) / params(truth.rig.cameras[0].lens)[0], 1, 1e-3);
  EXPECT_LT(double(report["rms_px"]), 0.1);
}

TEST_F(Simulated, TheSameSeedGivesTheSameFiles) {
  const std::string arguments =
      "--target " + kTargets + "chessboard_9x6_25mm.yaml --views 3 --size 320x240 --seed 9 ";
  simulate(arguments + "--threads 1");
  const std::string picture = test::read_text(dir / "sim/cam0/000.png"),
                    corners = test::read_text(dir / "sim/corners.yaml");
  simulate(arguments + "--threads 3");
  EXPECT_EQ(test::read_text(dir / "sim/cam0/000.png"), picture);
  EXPECT_EQ(test::read_text(dir / "sim/corners.yaml"), corners);
  simulate("--target " + kTargets + "chessboard_9x6_25mm.yaml --views 3 --size 320x240 --seed 10");
  EXPECT_NE(test::read_text(dir / "sim/corners.yaml"), corners);
}

}  // namespace
}  // namespace plumbline

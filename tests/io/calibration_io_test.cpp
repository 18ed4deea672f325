// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/calibration_io.hpp"

#include <gmock/gmock.h>

#include <bit>
#include <cstdint>

#include "io/example.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

TEST(CalibrationYaml, HasNoNegativeZero) {
  Calibration calibration = test::example_calibration();
  calibration.rig.T_cam_rig[1].qt = {1, -0.0, 0, -0.0, -0.1, -0.0, 0};
  calibration.fits[0][0].residual_px = {-0.0, 0.5};
  calibration.data.views[0].corners[0].px = {-0.0, 3};
  (*calibration.covariance)(0, 1) = -0.0;
  const std::string yaml = format_calibration(calibration);
  // "-0" that no digit or point follows.
  for (auto at = yaml.find("-0"); at != std::string::npos; at = yaml.find("-0", at + 1)) {
    EXPECT_NE(std::string(".0123456789").find(yaml.at(at + 2)), std::string::npos)
        << yaml.substr(at - 30, 60);
  }
  EXPECT_THAT(yaml,
              HasSubstr("{quaternion_wxyz: [1, 0, 0, 0], translation_m: [-0.10000000000000001, 0, 0]}"));
  EXPECT_EQ(format_calibration(*parse_calibration(yaml)), yaml);
}

TEST(CalibrationYaml, GivesSeveralBoardsBackToTheLastBit) {
  const Calibration a = test::example_of_two_boards();
  const std::string yaml = format_calibration(a);
  const auto b = parse_calibration(yaml);
  ASSERT_TRUE(b) << b.error().text() << "\n" << yaml;
  EXPECT_EQ(format_calibration(*b), yaml);
  EXPECT_EQ(b->T_board0_board, a.T_board0_board);
  EXPECT_EQ(*b->covariance, *a.covariance);
  ASSERT_EQ(b->data.targets.size(), 2u);
  EXPECT_EQ(b->data.targets[1].spec, a.data.targets[1].spec);
  for (std::size_t v = 0; v < a.data.views.size(); ++v)
    EXPECT_EQ(b->data.views[v].target, a.data.views[v].target) << v;
  std::string swapped = yaml;
  swapped.replace(swapped.find("  chessboard_3x2_25mm: {q"), 21, "  another");
  const auto broken = parse_calibration(swapped);
  ASSERT_FALSE(broken);
  EXPECT_THAT(broken.error().text(), HasSubstr("one pose for each target"));
}

// Files from before there were several boards have no trace of them, and are written as they were.
TEST(CalibrationYaml, OneBoardIsWrittenAsBefore) {
  const std::string yaml = format_calibration(test::example_calibration());
  EXPECT_THAT(yaml, HasSubstr("p_cam = T_cam_rig * T_rig_board * p_board;"));
  EXPECT_EQ(yaml.find("board0"), std::string::npos);
  EXPECT_EQ(yaml.find("targets"), std::string::npos);
  EXPECT_EQ(yaml.find("    target:"), std::string::npos);
}

TEST(CalibrationYaml, GivesEverythingBackToTheLastBit) {
  const Calibration a = test::example_calibration();
  const std::string yaml = format_calibration(a);
  const auto parsed = parse_calibration(yaml);
  ASSERT_TRUE(parsed) << parsed.error().text() << "\n" << yaml;
  const Calibration& b = *parsed;
  EXPECT_EQ(format_calibration(b), yaml);

  ASSERT_EQ(b.rig.cameras.size(), 2u);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(b.rig.cameras[i].name, a.rig.cameras[i].name);
    EXPECT_EQ(b.rig.cameras[i].size, a.rig.cameras[i].size);
    EXPECT_EQ(lens_name(b.rig.cameras[i].lens), lens_name(a.rig.cameras[i].lens));
    const auto p = params(a.rig.cameras[i].lens), q = params(b.rig.cameras[i].lens);
    for (std::size_t k = 0; k < p.size(); ++k) {
      // The sum turns the one -0 into 0, which is how it is written.
      EXPECT_EQ(std::bit_cast<std::uint64_t>(p[k] + 0.0), std::bit_cast<std::uint64_t>(q[k])) << k;
    }
  }
  EXPECT_EQ(b.rig.T_cam_rig, a.rig.T_cam_rig);
  EXPECT_EQ(b.T_rig_board, a.T_rig_board);
  EXPECT_EQ(b.view_reason, a.view_reason);
  EXPECT_EQ(corners_hash(b.data), corners_hash(a.data));
  EXPECT_EQ(b.data.detector, a.data.detector);
  ASSERT_EQ(b.fits.size(), a.fits.size());
  for (std::size_t v = 0; v < a.fits.size(); ++v) {
    EXPECT_EQ(b.data.views[v].image, a.data.views[v].image);
    EXPECT_EQ(b.data.views[v].reason, a.data.views[v].reason);
    ASSERT_EQ(b.fits[v].size(), a.fits[v].size()) << v;
    for (std::size_t i = 0; i < a.fits[v].size(); ++i) {
      EXPECT_EQ(b.fits[v][i].residual_px, a.fits[v][i].residual_px);
      EXPECT_EQ(b.fits[v][i].outlier, a.fits[v][i].outlier);
    }
  }
  EXPECT_EQ(b.stats.rms_px, a.stats.rms_px);
  EXPECT_EQ(b.stats.rms_xy_px, a.stats.rms_xy_px);
  EXPECT_EQ(b.stats.n_corners, 17);
  EXPECT_EQ(b.stats.n_outliers, 3);
  EXPECT_EQ(b.stats.iterations, 12);
  EXPECT_TRUE(b.stats.converged);
  EXPECT_EQ(b.stats.termination, a.stats.termination);
  ASSERT_EQ(b.stats.weak.size(), 1u);
  EXPECT_EQ(b.stats.weak[0].parameters, a.stats.weak[0].parameters);
  EXPECT_EQ(b.stats.weak[0].sigma, a.stats.weak[0].sigma);
  EXPECT_EQ(b.stats.weak[0].consequence, a.stats.weak[0].consequence);
  EXPECT_EQ(*b.covariance, *a.covariance);
  EXPECT_EQ(b.provenance.version, a.provenance.version);
  EXPECT_EQ(b.provenance.options, a.provenance.options);
  EXPECT_EQ(b.provenance.corners_hash, a.provenance.corners_hash);
}

TEST(CalibrationYaml, GivesValidityAndTheLensesTriedBack) {
  const Calibration a = test::example_calibration();
  const auto b = parse_calibration(format_calibration(a));
  ASSERT_TRUE(b) << b.error().text();
  EXPECT_FALSE(b->rig.cameras[0].validity);
  ASSERT_TRUE(b->rig.cameras[1].validity);
  EXPECT_EQ(b->rig.cameras[1].validity->angle_rad, a.rig.cameras[1].validity->angle_rad);
  EXPECT_EQ(b->rig.cameras[1].validity->radius_px, a.rig.cameras[1].validity->radius_px);
  ASSERT_EQ(b->provenance.lens_tries.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    const LensTry &x = a.provenance.lens_tries[i], &y = b->provenance.lens_tries[i];
    EXPECT_EQ(std::tie(x.camera, x.lens, x.n_params, x.rms_px, x.held_out_px, x.excess, x.excess_sigma,
                       x.chosen, x.reason),
              std::tie(y.camera, y.lens, y.n_params, y.rms_px, y.held_out_px, y.excess, y.excess_sigma,
                       y.chosen, y.reason));
  }
  std::string text = format_calibration(a);
  const auto at = text.find("angle_rad: ");
  for (const char* bad : {"0", "-1", "4", "nan", "[1]"}) {
    std::string wrong = text;
    wrong.replace(at, wrong.find('\n', at) - at, std::string("angle_rad: ") + bad);
    const auto parsed = parse_calibration(wrong);
    ASSERT_FALSE(parsed) << bad;
    EXPECT_THAT(parsed.error().where, ::testing::HasSubstr("cameras[1].validity.angle_rad, line ")) << bad;
  }
}

TEST(CalibrationYaml, ARigAloneIsAFileToo) {
  Calibration rig_only;
  rig_only.rig = test::example_calibration().rig;
  const std::string yaml = format_calibration(rig_only);
  EXPECT_EQ(yaml.find("views:\n"), std::string::npos);
  const auto back = parse_calibration(yaml);
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->rig.T_cam_rig, rig_only.rig.T_cam_rig);
  EXPECT_TRUE(back->data.views.empty());
  EXPECT_EQ(format_calibration(*back), yaml);
}

TEST(CalibrationYaml, DataMayHaveOtherCamerasThanTheRig) {
  Calibration a = test::example_calibration();
  a.data.cameras[1].size = {800, 600};
  EXPECT_EQ(parse_calibration(format_calibration(a))->data.cameras[1].size, (ImageSize{800, 600}));
}

TEST(CalibrationYaml, AFileByHandNeedsNoContents) {
  std::string yaml = format_calibration(test::example_calibration());
  const auto at = yaml.find("contents:");
  yaml.erase(at, yaml.find('\n', at) - at);
  EXPECT_TRUE(parse_calibration(yaml));
}

TEST(CalibrationYaml, NamesWhatIsWrong) {
  const std::string good = format_calibration(test::example_calibration());
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string bad = good;
    const auto at = bad.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    const auto calibration = parse_calibration(bad.replace(at, from.size(), to));
    return calibration ? std::string("no error") : calibration.error().text();
  };
  EXPECT_THAT(with("plumbline_calibration: 1", "plumbline_calibration: 99"), HasSubstr("newer Plumbline"));
  EXPECT_THAT(with("views: 5", "views: 6"), HasSubstr("cut off or was changed"));
  EXPECT_THAT(with("lens: kb4", "lens: kb5"), HasSubstr("cameras[1].lens"));
  EXPECT_THAT(with("lens: kb4", "lens: kb5"), HasSubstr("[kUnsupported]"));
  EXPECT_THAT(with("      fx: ", "      fx: -"), HasSubstr("cameras[0].parameters"));
  EXPECT_THAT(with("      k3: ", "      k9: "), HasSubstr("'k3' is missing"));
  EXPECT_THAT(with("      k3: 0.16", "      k3: 0.16\n      k9: 1"), HasSubstr("no parameter 'k9'"));
  EXPECT_THAT(with("rms_px: ", "rms_px: .inf #"), HasSubstr("summary.rms_px"));
  EXPECT_THAT(with("quaternion_wxyz: [1,", "quaternion_wxyz: [2,"), HasSubstr("unit quaternion"));
  EXPECT_THAT(with("  left: {", "  lefty: {"), HasSubstr("in the order of the cameras"));
  EXPECT_THAT(with("covariance: |\n", "covariance: |\n  1 2\n"),
              HasSubstr("row 1: 23 numbers are needed, there are 2"));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// Bows, clocks and times in calibration.yaml and corners.yaml.
#include <gmock/gmock.h>

#include "example.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"

namespace plumbline::test {
namespace {

Calibration example_with_effects() {
  Calibration c = example_calibration();
  c.bow_m = {Vec2(1.0 / 3000, -2e-4)};
  c.clocks = {{30e-6 / 7, std::nullopt}, {std::nullopt, -0.1 / 3}};
  c.stats.effects = {{"chessboard bow", 2, 12.5, 1e-5, 0.005, true, ""},
                     {"left line_delay", 1, 0, 0, 0, false, "it: moves too little"}};
  for (View& view : c.data.views) view.time_s = 0.1 * view.frame + 1.0 / 3;
  c.provenance.corners_hash = corners_hash(c.data);
  const auto n = static_cast<Eigen::Index>(shared_parameter_names(c).size());
  c.covariance = MatX::Identity(n, n) / 7;
  return c;
}

TEST(EffectsYaml, ComeBack) {
  const Calibration c = example_with_effects();
  const std::string text = format_calibration(c);
  const auto back = parse_calibration(text);
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(format_calibration(*back), text);
  EXPECT_EQ(*back->bow_m[0], *c.bow_m[0]);
  EXPECT_EQ(back->clocks[0].line_delay_s, c.clocks[0].line_delay_s);
  EXPECT_EQ(back->clocks[1].time_offset_s, c.clocks[1].time_offset_s);
  EXPECT_FALSE(back->clocks[1].line_delay_s);
  EXPECT_EQ(back->data.views[1].time_s, c.data.views[1].time_s);
  EXPECT_EQ(back->stats.effects[1].reason, c.stats.effects[1].reason);
  EXPECT_EQ(*back->covariance, *c.covariance);
  EXPECT_EQ(corners_hash(back->data), c.provenance.corners_hash);
  EXPECT_THAT(text, testing::HasSubstr("sigma_line_delay_s: 0.3779644730092"));  // 1 / sqrt 7
  const auto corners = parse_corners(format_corners(c.data));
  ASSERT_TRUE(corners) << corners.error().text();
  EXPECT_EQ(corners->views[3].time_s, c.data.views[3].time_s);
}

TEST(EffectsYaml, WithoutThemTheFileIsAsItWas) {
  const Calibration c = example_calibration();
  for (const std::string& text : {format_calibration(c), format_corners(c.data)}) {
    for (const char* word : {"bow", "clock", "time_s", "effect"})
      EXPECT_EQ(text.find(word), std::string::npos);
  }
}

TEST(EffectsYaml, FaultsAreNamed) {
  std::string text = format_calibration(example_with_effects());
  const auto replaced = [&](const std::string& from, const std::string& to) {
    std::string copy = text;
    copy.replace(copy.find(from), from.size(), to);
    const auto read = parse_calibration(copy);
    EXPECT_FALSE(read) << from;
    return read ? "" : read.error().text();
  };
  EXPECT_THAT(replaced("    x_m:", "    z_m:"), testing::HasSubstr("z_m"));
  EXPECT_THAT(replaced("clocks:\n  left:", "clocks:\n  top:"), testing::HasSubstr("there is no 'top'"));
  EXPECT_THAT(replaced("time_s: 0.33333", "time_s: x0.33333"), testing::HasSubstr("time_s"));
}

}  // namespace
}  // namespace plumbline::test

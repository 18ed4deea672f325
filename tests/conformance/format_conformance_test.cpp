// SPDX-License-Identifier: Apache-2.0
// Every format with every lens: what is written is read back as the same projection, or refused with
// kUnsupported, and the table's `lenses` says which. A new format or lens is found by itself.
#include <gmock/gmock.h>

#include <algorithm>

#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/io/formats.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {

const ImageSize kSize{640, 480};

/// A lens with every parameter set, so that a lost or swapped one moves pixels.
Lens lens_with_everything(std::string_view name, double shift) {
  Lens lens = make_lens(name, kSize, 410 + shift).value();
  const auto values = params(lens);
  const auto names = param_names(lens);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (names[i] == "fy") values[i] += 7;
    if (names[i] == "cx") values[i] += 5.125;
    if (names[i] == "cy") values[i] -= 3.0 / 7;
    if (i >= 4) values[i] += (i % 2 ? -1 : 1) * (0.011 + 1e-3 * shift) / static_cast<double>(i);
  }
  return lens;
}

Rig rig_of(std::string_view lens, int n_cameras) {
  Rig rig;
  for (int i = 0; i < n_cameras; ++i) {
    rig.cameras.push_back(
        {"cam_" + std::string(1, static_cast<char>('a' + i)), kSize, lens_with_everything(lens, i)});
    rig.T_cam_rig.push_back(i == 0 ? SE3()
                                   : SE3(so3_exp({0.02 * i, -0.35, 0.1}), {-0.11 * i, 0.05, 1.0 / 300}));
  }
  return rig;
}

double projection_difference_px(const Lens& a, const Lens& b) {
  double worst = 0;
  for (int y = 0; y < 480; y += 40) {
    for (int x = 0; x < 640; x += 40) {
      const auto ray = unproject(a, Vec2(x, y));
      if (!ray) continue;
      const auto p = project(a, *ray), q = project(b, *ray);
      worst = std::max(worst, p && q ? (*p - *q).norm() : 1e9);
    }
  }
  return worst;
}

bool expresses(const Format& format, std::string_view lens) {
  const auto names = split(format.lenses, ' ');
  return std::find(names.begin(), names.end(), lens) != names.end();
}

struct Case {
  const Format* format;
  std::string_view lens;
};

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const Format* format : formats()) {
    for (std::string_view lens : lens_names()) all.push_back({format, lens});
  }
  return all;
}

class FormatConformance : public ::testing::TestWithParam<Case> {};

TEST_P(FormatConformance, ComesBackOrIsRefused) {
  const auto& [format, lens] = GetParam();
  for (const int n_cameras : {1, 2, 3}) {
    const Rig rig = rig_of(lens, n_cameras);
    const auto files = format->write(rig, {});
    ASSERT_EQ(files.has_value(), expresses(*format, lens)) << "the table says: " << format->lenses;
    if (!files) {
      EXPECT_EQ(files.error().code, ErrorCode::kUnsupported);
      EXPECT_THAT(files.error().message, ::testing::HasSubstr(std::string(lens)));
      EXPECT_THAT(files.error().where, ::testing::HasSubstr("cam_a"));
      continue;
    }
    if (!format->read) continue;
    for (const NamedBytes& file : *files) {
      for (const Format* other : formats())
        EXPECT_EQ(other->recognises(file.bytes), other == format) << file.name << ": " << other->name;
    }
    const auto back = read_rig(*files);
    ASSERT_TRUE(back) << back.error().text() << "\n" << files->front().bytes;
    ASSERT_EQ(back->cameras.size(), rig.cameras.size());
    ASSERT_EQ(back->T_cam_rig.size(), rig.cameras.size());
    for (int i = 0; i < n_cameras; ++i) {
      EXPECT_EQ(back->cameras[i].size, kSize);
      EXPECT_EQ(lens_name(back->cameras[i].lens), lens);
      EXPECT_LT(projection_difference_px(rig.cameras[i].lens, back->cameras[i].lens), 1e-9);
      if (format->name != "colmap") EXPECT_EQ(back->cameras[i].name, rig.cameras[i].name);
      if (format->carries_extrinsics)
        EXPECT_LT(box_minus(back->T_cam_rig[i], rig.T_cam_rig[i]).norm(), 1e-14);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, FormatConformance, ::testing::ValuesIn(cases()), [](const auto& info) {
  return std::string(info.param.format->name) + "_" + std::string(info.param.lens);
});

TEST(Formats, TheTableIsWhole) {
  for (const Format* format : formats()) {
    EXPECT_EQ(find_format(format->name), format);
    EXPECT_FALSE(format->summary.empty() || format->files.empty() || !format->write || !format->recognises);
    for (const std::string& lens : split(format->lenses, ' ')) {
      EXPECT_TRUE(make_lens(lens, kSize, 1.0)) << format->name << " names the lens '" << lens << "'";
    }
  }
  EXPECT_EQ(find_format("none"), nullptr);
}

}  // namespace
}  // namespace plumbline

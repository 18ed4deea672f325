// SPDX-License-Identifier: Apache-2.0
// Files that were cut off, changed or made to harm: an error with a message, never a crash or a hang, and
// never another calibration.
#include <gmock/gmock.h>

#include <chrono>
#include <functional>

#include "io/example.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/io/points_io.hpp"
#include "plumbline/io/target_io.hpp"
#include "plumbline/io/transform_io.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

/// A text and its reader; nullopt for success.
struct Reader {
  std::string name, text;
  std::function<std::optional<Error>(std::string_view)> read;
};

void PrintTo(const Reader& reader, std::ostream* out) { *out << reader.name; }

template <class T>
std::optional<Error> error_of(const Result<T>& result) {
  return result ? std::nullopt : std::optional(result.error());
}

Rig rig_for(const Format& format) {
  Rig rig;
  const std::string lens = format.name == "mrcal" ? "opencv8" : "kb4";
  for (int i = 0; i < 2; ++i) {
    Lens one = make_lens(lens, {640, 480}, 400.0 / 3).value();
    for (double& v : params(one).subspan(4)) v = 1.0 / 300;
    rig.cameras.push_back({i ? "right" : "left", {640, 480}, one});
  }
  rig.T_cam_rig = {SE3(), SE3(Mat3::Identity(), {-1.0 / 30, 0.1, 0.2})};
  return rig;
}

std::vector<Reader> readers() {
  std::vector<Reader> all;
  const Calibration c = test::example_calibration();
  const auto target = [](std::string_view text) { return error_of(parse_target(text)); };
  BoardRig boards;
  boards.parts = {{Charuco{4, 5, 0.1, 0.07, "4X4_50", 0, Charuco::Layout::kLegacy}, SE3()},
                  {AprilGrid{}, SE3()}};
  for (const TargetSpec& spec :
       {TargetSpec(Chessboard{9, 6, 0.0255}), boards.parts[0].board,
        TargetSpec(AprilGrid{6, 6, 0.088, 0.3, "36h11", 12}), TargetSpec(Circles{4, 11, 0.025, 0.011, true}),
        TargetSpec(Points3d{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0.5}}}),
        TargetSpec(boards)}) {
    all.push_back(
        {"target_" + std::string(target_type(spec)), format_target(make_target(spec).value()), target});
  }
  all.push_back({"corners", format_corners(c.data),
                 [](std::string_view text) { return error_of(parse_corners(text)); }});
  all.push_back(
      {"vnl", format_vnl(c.data, 0), [](std::string_view text) { return error_of(parse_vnl(text)); }});
  all.push_back({"calibration", format_calibration(c),
                 [](std::string_view text) { return error_of(parse_calibration(text)); }});
  const auto points = [](std::string_view text) { return error_of(parse_points(text)); };
  all.push_back({"points_csv", "X,Y,Z,u,v\n0.5,1,2,3.25,1\n-1,2e-3,3,4,5\n", points});
  all.push_back({"points_yaml", "{columns: [u, v], rows: [[0.5, 1], [2, 3], [-4e2, 5]]}\n", points});
  all.push_back({"transform", "{R: [[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]], t: [1, 2, 3]}\n",
                 [](std::string_view text) { return error_of(parse_transform(text)); }});
  for (const Format* format : formats()) {
    const auto files = format->write(rig_for(*format), {}).value();
    for (std::size_t i = 0; i < files.size(); ++i) {
      // One file of the set is hostile, the others are as they should be.
      all.push_back(
          {std::string(format->name) + "_" + std::to_string(i), files[i].bytes, [=](std::string_view text) {
             auto given = files;
             given[i].bytes = text;
             return error_of(read_rig(given, format->name));
           }});
    }
  }
  return all;
}

class Hostile : public ::testing::TestWithParam<Reader> {
 protected:
  /// Runs the reader, holds it to one second, and its error to a message.
  std::optional<Error> read(std::string_view text) const {
    const auto begin = std::chrono::steady_clock::now();
    auto error = GetParam().read(text);
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
    if (error) EXPECT_FALSE(error->message.empty());
    return error;
  }
};

TEST_P(Hostile, TheWholeFileIsRead) {
  const auto error = read(GetParam().text);
  EXPECT_FALSE(error) << error->text();
}

TEST_P(Hostile, CutOffAnywhereItIsAnError) {
  const std::string& text = GetParam().text;
  // Only whole rows of a vnl may go unnoticed: that format has neither a count nor an end. Neither has a CSV,
  // whose last number may be cut too, because files by hand often end without a line's end.
  const bool csv = GetParam().name == "points_csv", rows_only = csv || GetParam().name == "vnl";
  const std::size_t step = text.size() > 6000 ? 11 : 1;
  for (std::size_t n = 0; n + 1 < text.size(); n += step) {
    const std::string_view cut = std::string_view(text).substr(0, n);
    const bool in_last_cell = csv && n > 20 && text.find_first_of(",\n", n - 1) == text.find('\n', n - 1);
    const bool may_pass = in_last_cell || (rows_only && n > 20 && text[n - 1] == '\n');
    const auto error = read(cut);
    EXPECT_TRUE(error || may_pass) << "cut at " << n << " of " << text.size() << ":\n..."
                                   << cut.substr(n > 80 ? n - 80 : 0);
    if (::testing::Test::HasFailure()) return;
  }
}

TEST_P(Hostile, EveryByteChangedDoesNotCrash) {
  std::string text = GetParam().text;
  const std::size_t step = std::max<std::size_t>(1, text.size() / 200);
  for (std::size_t i = 0; i < text.size(); i += step) {
    const char was = text[i];
    for (const char c : {'\0', '\xff', '{', '[', '"', '-', '9', '\n', ':', '*', '%'}) {
      text[i] = c;
      (void)GetParam().read(text);
    }
    text[i] = was;
  }
}

TEST_P(Hostile, NumbersThatAreNoneAreRefused) {
  const std::string& text = GetParam().text;
  int n_tried = 0;
  for (const char* bad : {"nan", ".nan", "inf", "-.inf", "1e999", "0x10", "1,5"}) {
    // The first number with a decimal point, or else the last number of the file.
    auto dot = text.find('.', text.find("0.") == std::string::npos ? 0 : text.find("0.") - 1);
    if (dot == std::string::npos) continue;
    const auto begin = text.find_last_not_of("0123456789.-", dot) + 1,
               end = text.find_first_not_of("0123456789.e-+", dot);
    if (begin >= end || text.substr(begin, end - begin) == ".") continue;
    std::string changed = text;
    changed.replace(begin, end - begin, bad);
    EXPECT_TRUE(read(changed)) << bad << " for " << text.substr(begin, end - begin);
    ++n_tried;
  }
  EXPECT_GT(n_tried, 0);
}

TEST_P(Hostile, NestingAliasesAndNonsense) {
  for (const char* open : {"[", "{", "{a: ", "- ", "? ", "(", "a:\n", "!!a ", "&a ", "\"", "|\n", "%"}) {
    std::string deep;
    while (deep.size() < 200'000) deep += open;
    EXPECT_TRUE(read(deep)) << open;
    std::string indented;
    for (int i = 0; i < 300; ++i) indented += std::string(i, ' ') + "a:\n";
    EXPECT_TRUE(read(indented));
  }
  std::string bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (char c = 'b'; c < 'z'; ++c) {
    const std::string p(1, static_cast<char>(c - 1));
    bomb += std::string(1, c) + ": &" + c + " [*" + p + ", *" + p + ", *" + p + ", *" + p + ", *" + p +
            ", *" + p + "]\n";
  }
  EXPECT_TRUE(read(bomb));
  for (const std::string& text :
       {std::string(), std::string("\n"), std::string("~"), std::string("[]"), std::string("{}"),
        std::string("5"), std::string("\xff\xfe\x00\x00", 4), std::string("\xfe\xff"),
        std::string(100'000, '\0'), std::string("%YAML:1.0"), std::string("%YAML:1.0\n---\n"),
        std::string("--- a\n--- b\n"), std::string("{'lensmodel': }"), std::string("# only a remark\n")}) {
    EXPECT_TRUE(read(text)) << text.substr(0, 20);
  }
  EXPECT_TRUE(read(GetParam().text + "---\n" + GetParam().text) || GetParam().name == "vnl");
}

INSTANTIATE_TEST_SUITE_P(All, Hostile, ::testing::ValuesIn(readers()),
                         [](const auto& info) { return info.param.name; });

TEST(HostileYaml, AliasesAreNamed) {
  const auto target = parse_target("type: chessboard\ncorners: &a [9, 6]\nsquare_m: *a\n");
  ASSERT_FALSE(target);
  EXPECT_THAT(target.error().text(), HasSubstr("line 3: aliases"));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/dataset_io.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <charconv>

#include "io/example.hpp"
#include "io/yaml.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

void expect_same(const Dataset& a, const Dataset& b) {
  ASSERT_EQ(a.targets.size(), b.targets.size());
  for (std::size_t i = 0; i < a.targets.size(); ++i) {
    EXPECT_EQ(a.targets[i].spec, b.targets[i].spec);
    EXPECT_EQ(a.targets[i].name, b.targets[i].name);
  }
  EXPECT_EQ(a.frames, b.frames);
  EXPECT_EQ(a.detector, b.detector);
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (std::size_t i = 0; i < a.cameras.size(); ++i) {
    EXPECT_EQ(a.cameras[i].name, b.cameras[i].name);
    EXPECT_EQ(a.cameras[i].size, b.cameras[i].size);
  }
  ASSERT_EQ(a.views.size(), b.views.size());
  for (std::size_t v = 0; v < a.views.size(); ++v) {
    const View &p = a.views[v], &q = b.views[v];
    EXPECT_EQ(std::tie(p.cam, p.frame, p.target, p.image, p.reason),
              std::tie(q.cam, q.frame, q.target, q.image, q.reason));
    ASSERT_EQ(p.corners.size(), q.corners.size());
    for (std::size_t i = 0; i < p.corners.size(); ++i) {
      EXPECT_EQ(p.corners[i].point, q.corners[i].point);
      EXPECT_EQ(p.corners[i].px, q.corners[i].px);
      EXPECT_EQ(p.corners[i].sigma_px, q.corners[i].sigma_px);
    }
  }
}

std::string error_of(const std::string& yaml) {
  const auto data = parse_corners(yaml);
  return data ? "no error" : data.error().text();
}

TEST(CornersYaml, GivesTheDatasetBackToTheLastBit) {
  const Dataset data = test::example_calibration().data;
  const std::string yaml = format_corners(data);
  const auto back = parse_corners(yaml);
  ASSERT_TRUE(back) << back.error().text() << "\n" << yaml;
  expect_same(data, *back);
  EXPECT_EQ(format_corners(*back), yaml);
}

TEST(CornersYaml, GivesSeveralBoardsBack) {
  const Dataset data = test::example_of_two_boards().data;
  const std::string yaml = format_corners(data);
  const auto back = parse_corners(yaml);
  ASSERT_TRUE(back) << back.error().text() << "\n" << yaml;
  expect_same(data, *back);
  EXPECT_EQ(format_corners(*back), yaml);
}

TEST(CornersYaml, ViewsOfSeveralBoardsNameTheirs) {
  const std::string yaml = format_corners(test::example_of_two_boards().data);
  const auto without = [&](const std::string& line, const std::string& instead) {
    std::string text = yaml;
    text.replace(text.find(line), line.size(), instead);
    return error_of(text);
  };
  EXPECT_THAT(without("    target: chessboard_3x2_25mm\n", ""), HasSubstr("target"));
  EXPECT_THAT(without("    target: chessboard_3x2_25mm\n", "    target: nobody\n"),
              HasSubstr("there is no target 'nobody'"));
  EXPECT_THAT(without("name: \"the other: board\"", "name: chessboard_3x2_25mm"), HasSubstr("there twice"));
  EXPECT_THAT(
      without("targets:\n", "target: {type: chessboard, corners: [3, 2], square_m: 0.025}\ntargets:\n"),
      HasSubstr("both 'target' and 'targets'"));
}

TEST(CornersYaml, ReadsAHandWrittenFile) {
  const auto data = parse_corners(
      "plumbline_corners: 1\n"
      "target: {type: chessboard, corners: [3, 2], square_m: 0.025}\n"
      "cameras: [{name: cam, width: 100, height: 80}]\n"
      "frames: [\"01\"]\n"
      "views:\n"
      "- camera: cam\n"
      "  frame: 01\n"
      "  image: a.png\n"
      "  corners: |\n"
      "    0 1.5 2.5 1\n"
      "\n"
      "    5   3 4e1\t0.1\n");
  ASSERT_TRUE(data) << data.error().text();
  ASSERT_EQ(data->views[0].corners.size(), 2u);
  EXPECT_EQ(data->views[0].corners[1].point, 5);
  EXPECT_EQ(data->views[0].corners[1].px, Vec2(3, 40));
}

TEST(CornersYaml, AListOfListsIsReadToo) {
  const Dataset data = test::example_calibration().data;
  std::string text = format_corners(data), lists;
  for (std::size_t at; (at = text.find("    corners: |\n")) != std::string::npos;) {
    const auto first = at + 15;
    auto last = first;
    lists = "    corners: [";
    while (text.compare(last, 6, "      ") == 0) {
      const auto end = text.find('\n', last);
      std::string row = text.substr(last + 6, end - last - 6);
      std::replace(row.begin(), row.end(), ' ', ',');
      lists += (lists.back() == '[' ? "[" : ", [") + row + "]";
      last = end + 1;
    }
    text.replace(at, last - at, lists + "]\n");
  }
  const auto read = parse_corners(text);
  ASSERT_TRUE(read) << read.error().text();
  EXPECT_EQ(format_corners(*read), format_corners(data));
  text.replace(text.find("[["), 2, "[[x, ");
  EXPECT_THAT(error_of(text), HasSubstr("row 1: 'point x y sigma' is needed"));
}

// The shortest text of a double is the double: std::from_chars is the referee, over all exponents.
TEST(CornersYaml, ShortNumbersAreTheSameDoubles) {
  Rng rng(5);
  for (int i = 0; i < 20000; ++i) {
    const double value = std::ldexp(rng.uniform(-1, 1), static_cast<int>(rng.uniform(-60, 60)));
    std::string text;
    io::append_number(text, value);
    double back = 0;
    std::from_chars(text.data(), text.data() + text.size(), back);
    ASSERT_EQ(back, value) << text;
  }
  std::string zero;
  io::append_number(zero, -0.0);
  EXPECT_EQ(zero, "0");
}

TEST(CornersYaml, NamesWhatIsWrong) {
  const std::string good = format_corners(test::example_calibration().data);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string bad = good;
    const auto at = bad.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return error_of(bad.replace(at, from.size(), to));
  };
  EXPECT_THAT(with("plumbline_corners: 1", "plumbline_corners: 2"), HasSubstr("[kUnsupported]"));
  EXPECT_THAT(with("plumbline_corners: 1", "corners: 1"), HasSubstr("not a corners file"));
  EXPECT_THAT(with("camera: left", "camera: lft"),
              HasSubstr("views[0].camera, line 15: there is no camera 'lft'"));
  EXPECT_THAT(with("      0 ", "      x "), HasSubstr("row 1: the number of a point is needed, not 'x'"));
  EXPECT_THAT(with("      1 ", "      7 "), HasSubstr("point 7 of a target with 6 points [kInvalidData]"));
  EXPECT_THAT(with("      1 ", "      0 "), HasSubstr("out of order or there twice"));
  EXPECT_THAT(with("      1 ", "      1 nan "), HasSubstr("row 2"));
  EXPECT_THAT(with("width: 640", "width: 0"), HasSubstr("not within"));
  EXPECT_THAT(with("detector:", "detectr:"), HasSubstr("did you mean 'detector'?"));
}

TEST(Vnl, ReadsLevelsWeightsAndAbsentPoints) {
  const auto levels = parse_vnl(
      "## generated with a tool\n"
      "# filename x y level\n"
      "a.png - - -\n"
      "007 10.5 20.25 0\n"
      "007 11 21 2\n"
      "# a remark\n"
      "007 12 22 -\n"
      "007 - - -\n"
      "007 13 23 -1\n"
      "007 -3 23 0\n"
      "007 14 24 1\n");
  ASSERT_TRUE(levels) << levels.error().text();
  ASSERT_EQ(levels->size(), 2u);
  EXPECT_EQ((*levels)[0].filename, "a.png");
  EXPECT_TRUE((*levels)[0].corners.empty());
  const auto& corners = (*levels)[1].corners;
  EXPECT_EQ((*levels)[1].filename, "007");
  ASSERT_EQ(corners.size(), 3u);
  EXPECT_EQ(corners[0].px, Vec2(10.5, 20.25));
  EXPECT_EQ(corners[1].sigma_px, 4);
  EXPECT_EQ(corners[2].point, 6);
  EXPECT_EQ(corners[2].sigma_px, 2);

  const auto weights = parse_vnl("#weight y x filename\n4 20 10 f\n0 1 1 f\n- 1 1 f\n0.5 21 11 f\n");
  ASSERT_TRUE(weights) << weights.error().text();
  ASSERT_EQ((*weights)[0].corners.size(), 2u);
  EXPECT_EQ((*weights)[0].corners[0].px, Vec2(10, 20));
  EXPECT_EQ((*weights)[0].corners[0].sigma_px, 0.25);
  EXPECT_EQ((*weights)[0].corners[1].point, 3);
  EXPECT_EQ((*weights)[0].corners[1].sigma_px, 2);

  EXPECT_EQ(parse_vnl("# filename x y\r\nf 1 2\r\n")->at(0).corners.at(0).sigma_px, 1);
}

TEST(Vnl, NamesTheLine) {
  const auto error_in = [](const std::string& text) {
    const auto images = parse_vnl(text);
    return images ? std::string("no error") : images.error().text();
  };
  EXPECT_THAT(error_in("f 1 2 0\n"), HasSubstr("line 1: a legend"));
  EXPECT_THAT(error_in(""), HasSubstr("no legend"));
  EXPECT_THAT(error_in("# filename x level\n"), HasSubstr("line 1: the legend needs"));
  EXPECT_THAT(error_in("# filename x y level weight\n"), HasSubstr("both level and weight"));
  EXPECT_THAT(error_in("# filename x y x\n"), HasSubstr("'x' twice"));
  EXPECT_THAT(error_in("# filename x y level\nf 1 2\n"),
              HasSubstr("line 2: 4 columns are needed, there are 3"));
  EXPECT_THAT(error_in("# filename x y level\n\nf 1 z 0\n"), HasSubstr("line 3: a pixel is needed"));
  EXPECT_THAT(error_in("# filename x y level\nf 1 nan 0\n"), HasSubstr("line 2: a pixel is needed"));
  EXPECT_THAT(error_in("# filename x y level\nf 1 1 1e9\n"), HasSubstr("above 30"));
  EXPECT_THAT(error_in("# filename x y weight\nf 1 1 1e-320\n"), HasSubstr("no finite inverse"));
}

TEST(Vnl, WritesWhatItReads) {
  Dataset data = test::example_calibration().data;
  data.views[0].corners = {{1, {10.25, 1.0 / 3}, 1}, {4, {30, 40}, 2}};
  data.views[1].corners = {{0, {7, 8}, 4}};
  EXPECT_EQ(format_vnl(data, 0),
            "# filename x y level\n"
            "img/left01.jpg - - -\nimg/left01.jpg 10.25 0.33333333333333331 0\nimg/left01.jpg - - "
            "-\nimg/left01.jpg - - -\n"
            "img/left01.jpg 30 40 1\nimg/left01.jpg - - -\n"
            "img/left2.jpg 7 8 2\nimg/left2.jpg - - -\nimg/left2.jpg - - -\nimg/left2.jpg - - "
            "-\nimg/left2.jpg - - -\n"
            "img/left2.jpg - - -\n"
            "img/leftx_y.jpg - - -\n");
  const auto back = parse_vnl(format_vnl(data, 0));
  ASSERT_TRUE(back);
  EXPECT_EQ((*back)[0].corners[1].point, 4);
  EXPECT_EQ((*back)[0].corners[0].px, data.views[0].corners[0].px);
  EXPECT_EQ((*back)[1].corners[0].sigma_px, 4);
  data.views[0].corners[0].sigma_px = 0.05;  // the finest: level 0; 2 px is 5.3 levels above
  EXPECT_EQ(parse_vnl(format_vnl(data, 0))->at(0).corners[1].sigma_px, 32);
}

// mrcal's own reader must see the same points, the same absences and weight = 1 / sigma.
TEST(Vnl, MrcalReadsOurFile) {
  Dataset data = test::example_calibration().data;
  data.views[0].corners = {
      {0, {10.25, 20.5}, 1}, {1, {30, 40}, 1}, {2, {50, 60}, 2}, {3, {50, 80}, 1}, {5, {90, 80}, 4}};
  data.views[1].corners.clear();
  const test::TempDir dir;
  test::write_text(dir / "corners.vnl", format_vnl(data, 0));
  const auto run = test::run("cd " + dir.path().string() +
                             " && /usr/bin/python3 -c \"import mrcal\n"
                             "o, _, f = mrcal.compute_chessboard_corners(3, 2, "
                             "globs_per_camera=['*left*.jpg'], corners_cache_vnl='corners.vnl')\n"
                             "print(o[0].reshape(6, 3).tolist())\"");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out,
              HasSubstr("[[10.25, 20.5, 1.0], [30.0, 40.0, 1.0], [50.0, 60.0, 0.5], [50.0, 80.0, 1.0], "
                        "[-1.0, -1.0, -1.0], [90.0, 80.0, 0.25]]"));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/points_io.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <random>

#include "plumbline/core/text.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string error_of(const std::string& text) {
  const auto table = parse_points(text);
  return table ? "read" : table.error().text();
}

TEST(Points, EveryShapeOfTheSameTable) {
  for (const std::string text :
       {"X,u\n1,-2.5\n3e-1,4\n", "X, u\n1, -2.5\n0.3 ,4", "X u\n 1\t-2.5\n0.3 4\n",
        "X,u\r\n1,-2.5\r\n.3,+4\r\n", "# remark\n\nX,u # names\n1,-2.5 # a row\n# more\n0.3,4\n",
        "# written by numpy\n# X u\n1 -2.5\n0.3 4\n", "# X, u\n1 -2.5\n0.3 4\n",
        "\xEF\xBB\xBFX,u\n1,-2.5\n0.3,4\n", "\"X\",\"u\"\n1,-2.5\n0.3,4\n",
        "columns: [X, u]\nrows: [[1, -2.5], [0.3, 4]]\n",
        "columns: [X, u]\nrows:\n  - [1, -2.5]\n  - [0.3, 4]\n",
        "---\ncolumns: [X, u]\nrows: |\n  1 -2.5\n  0.3 4\n",
        "columns: [X, u]\nrows: |\n  1, -2.5\n  0.3, 4\n",
        "{\"columns\": [\"X\", \"u\"], \"rows\": [[1, -2.5], [0.3, 4]]}"}) {
    const auto table = parse_points(text);
    ASSERT_TRUE(table) << text << table.error().text();
    EXPECT_THAT(table->columns, ElementsAre("X", "u")) << text;
    EXPECT_THAT(table->values, ElementsAre(ElementsAre(1, 0.3), ElementsAre(-2.5, 4))) << text;
  }
}

TEST(Points, RowsKnowTheirLines) {
  EXPECT_THAT(parse_points("# a\nX\n1\n\n# b\n2\n").value().lines, ElementsAre(3, 6));
  EXPECT_THAT(parse_points("columns: [X]\nrows: |\n  1\n  2\n").value().lines, ElementsAre(3, 4));
  EXPECT_THAT(parse_points("columns: [X]\nrows:\n  - [1]\n  - [2]\n").value().lines, ElementsAre(3, 4));
}

TEST(Points, EveryFaultIsNamedWithItsLine) {
  EXPECT_THAT(error_of("X,Y\n1,2\n3\n"), HasSubstr("line 3: 1 values for the 2 columns X, Y [kParse]"));
  EXPECT_THAT(error_of("X,Y\n1,2,3\n"), HasSubstr("line 2: 3 values for the 2 columns"));
  EXPECT_THAT(error_of("X,Y\n1,2,\n"), HasSubstr("line 2: 3 values for the 2 columns"));
  EXPECT_THAT(error_of("X,Y\n1,nan\n"), HasSubstr("line 2: Y is 'nan'; a finite number is needed"));
  EXPECT_THAT(error_of("X,Y\n1,inf\n"), HasSubstr("line 2: Y is 'inf'"));
  EXPECT_THAT(error_of("X,Y\n1,1e999\n"), HasSubstr("line 2: Y is '1e999'"));
  EXPECT_THAT(error_of("X,Y\n1,\n"), HasSubstr("line 2: Y is ''"));
  EXPECT_THAT(error_of("X,Y\n1,two\n"), HasSubstr("line 2: Y is 'two'"));
  EXPECT_THAT(error_of("X,X\n1,2\n"), HasSubstr("line 1: two columns are named 'X'"));
  EXPECT_THAT(error_of("X,2D\n1,2\n"), HasSubstr("line 1: '2D' is no name of a column"));
  EXPECT_THAT(error_of("1,2\n3,4\n"), HasSubstr("line 1: numbers without a header"));
  EXPECT_THAT(error_of("# three names here\n1,2\n"), HasSubstr("line 2: numbers without a header"));
  EXPECT_THAT(error_of(""), HasSubstr("no header and no rows"));
  EXPECT_THAT(error_of("X,Y\n"), HasSubstr("a header and no rows"));
  EXPECT_THAT(error_of(std::string("X,Y\n1,\0\n", 8)), HasSubstr("line 2: a zero byte"));
  EXPECT_THAT(error_of("columns: [X]\nrows: [[1], [1, 2]]\n"), HasSubstr("line 2: 2 values"));
  EXPECT_THAT(error_of("columns: [X]\nrows: |\n  1\n  .nan\n"), HasSubstr("line 4: X is '.nan'"));
  EXPECT_THAT(error_of("columns: [X]\nrow: [[1]]\n"), HasSubstr("did you mean 'rows'"));
  EXPECT_THAT(error_of("columns: [X]\n"), HasSubstr("rows"));
  EXPECT_THAT(error_of("columns: []\nrows: [[1]]\n"), HasSubstr("at least one column"));
}

TEST(Points, ValuesThatAreNotKnown) {
  const auto table = parse_points("u,v,w\n1,2,-\n-,4,5\n").value();
  EXPECT_EQ(points_2d(table, "u", "v").error().text(),
            "line 3: a value of this row is '-', and all are needed here [kInvalidData]");
  const auto seen = seen_points_2d(table, "u", "v").value();
  EXPECT_EQ(seen[0], Vec2(1, 2));
  EXPECT_FALSE(seen[1]);
  EXPECT_FALSE(parse_points("{columns: [u], rows: [[~]]}").value().values[0][0] == 0);
}

TEST(Points, MissingColumnsAreNamed) {
  const auto table = parse_points("x,Y,Z\n1,2,3\n").value();
  EXPECT_EQ(points_3d(table, "X", "Y", "Z").error().text(),
            "the column 'X' is missing; there are x, Y, Z (capitals count) [kInvalidData]");
  EXPECT_EQ(points_3d(table, "Z", "Y", "x").value()[0], Vec3(3, 2, 1));
}

TEST(Points, WrittenTextGivesTheSameTable) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal(0, 1000);
  PointTable table{{"X", "u1", "v_2"}, {{}, {}, {}}, {}};
  for (int r = 0; r < 200; ++r) {
    for (auto& column : table.values) column.push_back(normal(random) * 1e-9);
    table.lines.push_back(r + 2);
  }
  const auto again = parse_points(format_points(table)).value();
  EXPECT_EQ(again.columns, table.columns);
  EXPECT_EQ(again.values, table.values);
  EXPECT_EQ(again.lines, table.lines);
}

TEST(Points, WhatIsTooMuchIsRefused) {
  std::string wide = "a0";
  for (int i = 1; i < 1001; ++i) wide += ",a" + std::to_string(i);
  EXPECT_THAT(error_of(wide + "\n"), HasSubstr("1001 columns; at most 1000"));
  EXPECT_THAT(error_of("X\n" + std::string((std::size_t{64} << 20) + 1, '1')), HasSubstr("at most 64"));
  std::string tall = "a0";
  for (int i = 1; i < 1000; ++i) tall += " a" + std::to_string(i);
  std::string row;
  for (int i = 0; i < 1000; ++i) row += "1 ";
  tall += "\n";
  for (int i = 0; i < 10001; ++i) tall += row + "\n";
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_THAT(error_of(tall), HasSubstr("line 10002: more than 10000000 values"));
  // Ten million values; a loaded machine takes several times the 0.3 s of a free one.
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// White box: blocks of numbers that go around the YAML parser. The parser itself is the referee: a block with
// one letter in it is never lifted.
#include "io/yaml_blocks.hpp"

#include <gmock/gmock.h>

#include <random>

#include "io/yaml.hpp"

namespace plumbline::io {
namespace {

// What the parser makes of the value of `b`, told in a form that is not lifted (a '#' among the numbers), and
// what comes of the text as it is.
void expect_as_parsed(const std::string& text) {
  std::string marked = text;
  const auto digit = marked.find('7');
  ASSERT_NE(digit, std::string::npos) << text;
  marked[digit] = 'Q';
  ASSERT_FALSE(lift_blocks(marked)) << text;
  const auto plain = parse_yaml(marked), lifted = parse_yaml(text);
  ASSERT_EQ(plain.has_value(), lifted.has_value()) << text;
  if (!plain) return;
  std::string expected = Field(**plain).at("b").text();
  if (const auto at = expected.find('Q'); at != std::string::npos)
    expected[at] = '7';  // else below the block
  EXPECT_EQ(Field(**lifted).at("b").text(), expected) << text;
  EXPECT_EQ(Field(**lifted).at("b").line(), Field(**plain).at("b").line()) << text;
  if (Field(**plain).has("c")) {
    EXPECT_EQ(Field(**lifted).at("c").line(), Field(**plain).at("c").line()) << text;
  }
}

TEST(YamlBlocks, SayWhatTheParserSays) {
  for (const char* text :
       {"b: |\n  7 2\n  3 4\n", "b: |\n  7 2\n  3 4", "b: |\n  7 2\n\n\n  3 4\n\n\nc: 1\n",
        "b: |\n\n  7 2\nc: 1\n", "a: x\nb: |\n    7 2\n      3 4\n    5 6\nc: 1\n",
        "b: |\n  7 2\n 3 4\nc: 1\n", "b: |\n  7\t2\n \n  3\nc: 1\n", "b: |\r\n  7 2\r\n  3 4\r\nc: 1\r\n",
        "b: |\n  7 2\n# remark\nc: 1\n", "b: |\n  7 2\n     \n  3 4\nc: 1\n", "b: |\n   \n  7 2\nc: 1\n",
        "b: |\n  7 2\n\t\nc: 1\n", "b: |\n7 2\nc: 1\n", "# b: |\nb: |\n  7\nc: 1\n"}) {
    expect_as_parsed(text);
  }
}

TEST(YamlBlocks, AtRandomSayWhatTheParserSays) {
  std::mt19937_64 rng(4);
  int n_lifted = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = rng() % 2 ? "a: 0\nb: |\n" : "b: |\n";
    text += std::string(rng() % 4, ' ') + "7 1\n";
    for (int row = static_cast<int>(rng() % 5); row > 0; --row) {
      text += std::string(rng() % 4, ' ');
      if (rng() % 3) text += "-2.5e3 4";
      if (rng() % 8 == 0) text += '\t';
      if (row > 1 || rng() % 4) text += '\n';
    }
    if (text.back() == '\n' && rng() % 2) text += "c: 5\n";
    n_lifted += lift_blocks(text).has_value();
    expect_as_parsed(text);
  }
  EXPECT_GT(n_lifted, 500);
}

// A block inside a quoted text is not one: the text stays as it is.
TEST(YamlBlocks, InsideAQuotedTextIsText) {
  const std::string text = "a: \"x\n\n  b: |\n    7 2\n  y\"\nc: |\n  1 2\n";
  ASSERT_TRUE(lift_blocks(text));
  const auto tree = parse_yaml(text);
  ASSERT_TRUE(tree) << tree.error().text();
  EXPECT_EQ(Field(**tree).at("a").text(), "x\nb: | 7 2 y");
  EXPECT_EQ(Field(**tree).at("c").text(), "1 2\n");
}

TEST(YamlBlocks, TheTagOfAStrangerIsNoBlock) {
  const auto tree = parse_yaml("b: !plumbline-block 0\nc: |\n  1 2\n");
  ASSERT_TRUE(tree);
  EXPECT_EQ(Field(**tree).at("b").text(), "0");
  EXPECT_EQ(Field(**tree).at("c").text(), "1 2\n");
}

}  // namespace
}  // namespace plumbline::io

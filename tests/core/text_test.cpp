// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/text.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <clocale>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>

#include "plumbline/core/random.hpp"

namespace plumbline {
namespace {

TEST(FormatDouble, ParsesBackToTheSameBits) {
  Rng rng(1);
  for (int i = 0; i < 20000; ++i) {
    const double x = std::bit_cast<double>(rng.bits());
    if (!std::isfinite(x)) continue;
    const std::string text = format_double(x);
    EXPECT_EQ(std::strtod(text.c_str(), nullptr), x) << text;  // the C library is the referee
    EXPECT_EQ(parse_double(text), x) << text;
  }
}

TEST(FormatDouble, EdgesAndNamesOfWhatIsNotANumber) {
  EXPECT_EQ(format_double(0.0), "0");
  EXPECT_EQ(format_double(0.1), "0.10000000000000001");
  EXPECT_EQ(format_double(-2.5), "-2.5");
  EXPECT_EQ(format_double(std::numeric_limits<double>::quiet_NaN()), "nan");
  EXPECT_EQ(format_double(-std::numeric_limits<double>::quiet_NaN()), "nan");
  EXPECT_EQ(format_double(std::numeric_limits<double>::infinity()), "inf");
  EXPECT_EQ(format_double(-std::numeric_limits<double>::infinity()), "-inf");
}

TEST(ParseDouble, TakesTheWholeTextOrNothing) {
  EXPECT_EQ(parse_double("1.5"), 1.5);
  EXPECT_EQ(parse_double("+1.5"), 1.5);
  EXPECT_EQ(parse_double("-2e-3"), -2e-3);
  for (const char* bad : {"", "+", "-", "1.5 ", " 1.5", "1,5", "1.5x", "nan", "inf", "-inf", "1e999", "+-1",
                          "-+1", "++1", "0x10", "1e", "."}) {
    EXPECT_EQ(parse_double(bad), std::nullopt) << "'" << bad << "'";
  }
}

TEST(ParseInt, TakesTheWholeTextOrNothing) {
  EXPECT_EQ(parse_int("42"), 42);
  EXPECT_EQ(parse_int("-7"), -7);
  EXPECT_EQ(parse_int("+7"), 7);
  EXPECT_EQ(parse_int("007"), 7);
  for (const char* bad : {"", "+", "4.0", "4 ", "2147483648", "+-1", "0x10"}) {
    EXPECT_EQ(parse_int(bad), std::nullopt) << "'" << bad << "'";
  }
}

TEST(NaturalLess, RunsOfDigitsCompareAsNumbers) {
  const std::vector<std::string> ordered{"",
                                         "1",
                                         "2",
                                         "10",
                                         "a",
                                         "img1",
                                         "img2",
                                         "img2b",
                                         "img10",
                                         "img10a3",
                                         "img10a20",
                                         "img99999999999999999998",
                                         "img99999999999999999999",
                                         "imgs"};
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    for (std::size_t j = 0; j < ordered.size(); ++j) {
      EXPECT_EQ(natural_less(ordered[i], ordered[j]), i < j) << ordered[i] << " | " << ordered[j];
    }
  }
}

TEST(NaturalLess, LeadingZerosDoNotChangeTheNumber) {
  EXPECT_TRUE(natural_less("left002", "left10"));
  EXPECT_TRUE(natural_less("left02b", "left2c"));
  EXPECT_FALSE(natural_less("left2c", "left02b"));
  // Equal as numbers, different as texts: one of the two comes first, so that sorting is reproducible.
  EXPECT_NE(natural_less("left02", "left2"), natural_less("left2", "left02"));
}

TEST(NaturalLess, IsAStrictWeakOrderOnRandomNames) {
  Rng rng(2);
  std::vector<std::string> names;
  for (int i = 0; i < 60; ++i) {
    std::string name;
    for (int n = rng.index(5); n >= 0; --n) name += "019a."[rng.index(5)];
    names.push_back(name);
  }
  for (const auto& a : names) {
    EXPECT_FALSE(natural_less(a, a)) << a;
    for (const auto& b : names) {
      if (a != b) {
        EXPECT_NE(natural_less(a, b), natural_less(b, a)) << a << " | " << b;
      }
      for (const auto& c : names) {
        if (natural_less(a, b) && natural_less(b, c)) {
          EXPECT_TRUE(natural_less(a, c)) << a << " | " << b << " | " << c;
        }
      }
    }
  }
}

TEST(Split, KeepsEmptyPieces) {
  EXPECT_EQ(split("a,,b", ','), (std::vector<std::string>{"a", "", "b"}));
  EXPECT_EQ(split("", ','), (std::vector<std::string>{""}));
  EXPECT_EQ(split("a,", ','), (std::vector<std::string>{"a", ""}));
}

TEST(JoinAndSplit, AreInverse) {
  const std::vector<std::string> pieces{"", "fx", "", "1.5", ""};
  EXPECT_EQ(split(join(pieces, ";"), ';'), pieces);
  EXPECT_EQ(join({"a", "b", "c"}, ", "), "a, b, c");
  EXPECT_EQ(join({}, ", "), "");
}

TEST(Trim, TakesWhiteSpaceFromBothEndsOnly) {
  EXPECT_EQ(trim(" \t a b\r\n"), "a b");
  EXPECT_EQ(trim(" \n"), "");
  EXPECT_EQ(trim(""), "");
}

}  // namespace
}  // namespace plumbline

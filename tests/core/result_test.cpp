// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/result.hpp"

#include <gtest/gtest.h>

#include <memory>
#include <set>
#include <stdexcept>
#include <string>

namespace plumbline {
namespace {

Result<int> half(int n) {
  if (n % 2 != 0) return Error{ErrorCode::kInvalidData, "7 is odd; give an even number", "n"};
  return n / 2;
}

TEST(Result, HoldsAValue) {
  const auto r = half(8);
  ASSERT_TRUE(r);
  EXPECT_TRUE(r.has_value());
  EXPECT_EQ(*r, 4);
  EXPECT_THROW((void)r.error(), std::invalid_argument);
}

TEST(Result, HoldsAnError) {
  const auto r = half(7);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(r.error().text(), "n: 7 is odd; give an even number [kInvalidData]");
}

TEST(Result, ValueOfAnErrorThrowsItsText) {
  const auto r = half(7);
  try {
    (void)r.value();
    FAIL() << "value() of an error returned";
  } catch (const std::invalid_argument& e) {
    EXPECT_EQ(std::string(e.what()), r.error().text());
  }
  EXPECT_THROW((void)*r, std::invalid_argument);
}

TEST(Result, MovesOutWhatCannotBeCopied) {
  Result<std::unique_ptr<int>> r(std::make_unique<int>(3));
  const std::unique_ptr<int> p = *std::move(r);
  EXPECT_EQ(*p, 3);
}

TEST(Result, ArrowReachesTheValueAndChangesIt) {
  Result<std::string> r(std::string("ab"));
  r->push_back('c');
  EXPECT_EQ(r->size(), 3U);
  EXPECT_EQ(*r, "abc");
}

TEST(Status, IsSuccessUnlessGivenAnError) {
  EXPECT_TRUE(Status());
  const Status bad = Error{ErrorCode::kIo, "no such file", "a.yaml"};
  EXPECT_FALSE(bad);
  EXPECT_EQ(bad.error().where, "a.yaml");
  EXPECT_THROW((void)Status().error(), std::invalid_argument);
}

TEST(Error, TextLeavesOutAnEmptyWhere) {
  EXPECT_EQ((Error{ErrorCode::kParse, "line 3: no colon", ""}.text()), "line 3: no colon [kParse]");
}

TEST(ErrorCode, EachHasANameOfItsOwn) {
  std::set<std::string> names;
  for (auto code : {ErrorCode::kIo, ErrorCode::kParse, ErrorCode::kUnsupported, ErrorCode::kDegenerate,
                    ErrorCode::kNotConverged, ErrorCode::kInvalidData}) {
    names.insert(to_string(code));
  }
  EXPECT_EQ(names.size(), 6U);
  EXPECT_FALSE(names.contains("kUnknown"));
}

TEST(Check, ThrowsTheTextAndTheCondition) {
  const int n = 3;
  EXPECT_NO_THROW(PLUMBLINE_CHECK(n == 3, "three"));
  try {
    PLUMBLINE_CHECK(n >= 4, "at least four points are needed");
    FAIL() << "the check passed";
  } catch (const std::invalid_argument& e) {
    EXPECT_STREQ(e.what(), "at least four points are needed (n >= 4)");
  }
}

}  // namespace
}  // namespace plumbline

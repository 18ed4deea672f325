// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/transform_io.hpp"

#include <gmock/gmock.h>

#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
using ::testing::HasSubstr;

// A quarter turn about z, and (1, 2, 3).
const Mat3 kR = (Mat3() << 0, -1, 0, 1, 0, 0, 0, 0, 1).finished();

TEST(TransformFile, EveryShapeOfTheSameTransform) {
  for (const std::string text :
       {"0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n", "0,-1,0,1\r\n1,0,0,2\r\n0,0,1,3\r\n",
        "T: [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]",
        "T:\n  - [0, -1, 0, 1]\n  - [1, 0, 0, 2]\n  - [0, 0, 1, 3]\n",
        "[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]",
        "{\"R\": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], \"t\": [1, 2, 3], \"more\": {}}",
        "quaternion_wxyz: [0.70710678118654757, 0, 0, 0.70710678118654757]\ntranslation_m: [1, 2, 3]",
        "rotation_rad: [0, 0, 1.5707963267948966]\nt: [1, 2, 3]",
        "rvec_rad: [0, 0, 1.5707963267948966]\nt: [1, 2, 3]"}) {
    const auto T = parse_transform(text);
    ASSERT_TRUE(T) << text << T.error().text();
    // A few roundings of numbers near 1.
    EXPECT_LT((T->R() - kR).norm(), 1e-15) << text;
    EXPECT_EQ(T->t(), Vec3(1, 2, 3)) << text;
  }
  EXPECT_EQ(parse_transform("0 -1 0 1 0 0 0 0 1").value().t(), Vec3(0, 0, 0));
  EXPECT_EQ(parse_transform("t: [1, 2, 3]").value().R(), Mat3::Identity());
}

TEST(TransformFile, FaultsAreNamed) {
  const auto fault = [](const std::string& text) { return parse_transform(text).error().text(); };
  EXPECT_THAT(fault("1 2 3"), HasSubstr("9 (R), 12 (3x4) or 16 (4x4) numbers; there are 3"));
  EXPECT_THAT(fault("1 0 0 0 2 0 0 0 1"), HasSubstr("not a rotation: |R'R - I| = 3"));
  EXPECT_THAT(fault("1 0 0 0 1 0 0 0 -1"), HasSubstr("det R = -1"));
  EXPECT_THAT(fault("1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1"), HasSubstr("last row"));
  EXPECT_THAT(fault("quaternion_wxyz: [1, 1, 0, 0]"), HasSubstr("quaternion_wxyz, line 1"));
  EXPECT_THAT(fault("R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nrvec_rad: [0, 0, 1]"), HasSubstr("contradicts"));
  const std::string T = "T: [1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1]\n";
  EXPECT_THAT(fault(T + "R: [0, -1, 0, 1, 0, 0, 0, 0, 1]"), HasSubstr("contradicts"));
  EXPECT_THAT(fault(T + "t: [5, 6, 8]"), HasSubstr("contradicts"));
  EXPECT_EQ(parse_transform(T + "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nt: [5, 6, 7]").value().t(), Vec3(5, 6, 7));
  EXPECT_THAT(fault("x: 1"), HasSubstr("no transform"));
  EXPECT_THAT(fault("t: [1, 2]"), HasSubstr("3 numbers are needed"));
}

}  // namespace
}  // namespace plumbline

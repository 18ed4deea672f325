// SPDX-License-Identifier: Apache-2.0
#include "plumbline/lens/range.hpp"

#include <gmock/gmock.h>

namespace plumbline {
namespace {

TEST(Range, IsThatOfThePapers) {
  EXPECT_EQ(out_of_range(UnifiedCamera{300, 300, 320, 240, 0.6}), "");
  EXPECT_EQ(out_of_range(UnifiedCamera{300, 300, 320, 240, 1}), "alpha = 1: ucm is used with 0 <= alpha < 1");
  EXPECT_THAT(out_of_range(UnifiedCamera{300, 300, 320, 240, -0.01}), testing::HasSubstr("alpha = -0.01"));
  EXPECT_EQ(out_of_range(EnhancedUnifiedCamera{300, 300, 320, 240, 1, 0.1}), "");
  EXPECT_THAT(out_of_range(EnhancedUnifiedCamera{300, 300, 320, 240, 0.5, -0.2}),
              testing::HasSubstr("beta = -0.2: eucm is used with 0 <= alpha <= 1 and beta > 0"));
  EXPECT_NE(out_of_range(EnhancedUnifiedCamera{300, 300, 320, 240, 1.5, 1}), "");
  EXPECT_EQ(out_of_range(DoubleSphere{300, 300, 320, 240, -0.3, 0}), "");
  EXPECT_NE(out_of_range(DoubleSphere{300, 300, 320, 240, -0.3, 1.01}), "");
  for (const auto name : lens_names())
    EXPECT_EQ(out_of_range(*make_lens(name, ImageSize{640, 480}, 500)), "") << name;
}

}  // namespace
}  // namespace plumbline

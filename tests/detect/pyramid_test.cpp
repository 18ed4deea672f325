// SPDX-License-Identifier: Apache-2.0
#include "detect/pyramid.hpp"

#include <opencv2/core.hpp>

#include "plumbline/detect/detect.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

// Odd rows and columns are left out, so that the scale is a power of two everywhere: a step at column 960 of
// 1015 lies where the scale says, not a share of the width.
TEST(Pyramid, ScaleIsExact) {
  cv::Mat image(1011, 1015, CV_8U, cv::Scalar(0));
  image.colRange(960, 1015).setTo(200);
  const auto levels = detail::pyramid_of(image, 130);
  ASSERT_EQ(levels.size(), 4U);
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const int ratio = static_cast<int>(detail::pyramid_ratio(levels.size(), k));
    ASSERT_EQ(ratio, 8 >> k);
    EXPECT_EQ(levels[k].at<unsigned char>(50, 960 / ratio - 1), 0);
    EXPECT_EQ(levels[k].at<unsigned char>(50, 960 / ratio), 200);
  }
}

// Strips and images of a few pixels have a reason, whatever is looked for.
TEST(Pyramid, StripsHaveAReason) {
  for (const cv::Size size : {cv::Size(9000, 16), cv::Size(17, 9000), cv::Size(40, 30), cv::Size(1, 1)}) {
    const cv::Mat image(size, CV_8U, cv::Scalar(128));
    for (const TargetSpec& spec :
         {TargetSpec(Chessboard{}), TargetSpec(Charuco{}), TargetSpec(AprilGrid{}), TargetSpec(Circles{})}) {
      const auto found = detect_target(image, *make_target(spec));
      ASSERT_TRUE(found) << size << " " << found.error().message;
      EXPECT_TRUE(found->corners.empty());
      EXPECT_FALSE(found->reason.empty());
    }
  }
}

}  // namespace
}  // namespace plumbline::test

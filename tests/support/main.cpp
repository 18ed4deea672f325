// SPDX-License-Identifier: Apache-2.0
// gtest's main, with an exit code of its own (77, which CTest reads as "skipped") when every test was
// skipped.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  const int status = RUN_ALL_TESTS();
  const auto& result = *testing::UnitTest::GetInstance();
  const bool all_skipped = result.skipped_test_count() > 0 && result.successful_test_count() == 0;
  return status == 0 && all_skipped ? 77 : status;
}

// SPDX-License-Identifier: Apache-2.0
// The detection table of docs/detect.md. It takes minutes, so it runs only when asked for:
//   detect_test --gtest_also_run_disabled_tests --gtest_filter='*DetectionTable*'
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "detect/data_sets.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/image/image.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

double median(std::vector<double> v) {
  if (v.empty()) return 0;
  std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
  return v[v.size() / 2];
}

TEST(DISABLED_DetectionTable, AllDataSets) {
  const char* only = std::getenv("PLUMBLINE_DATA_SET");  // part of a folder's name
  fmt::print(
      "| data set | images | found | corners (of all) | median sigma px | median ms "
      "|\n|---|---|---|---|---|---|\n");
  for (const DataSet& set : data_sets()) {
    if (only != nullptr && set.folder.find(only) == std::string::npos) continue;
    const auto folder = data_dir(set.folder);
    if (!folder) continue;
    const Target target = *make_target(set.spec);
    int found = 0, corners = 0;
    std::vector<double> ms, sigma;
    std::string remarks;
    const auto files = images_of(*folder, set.pattern);
    for (const auto& file : files) {
      const auto grey = read_image_grey(file);
      ASSERT_TRUE(grey) << grey.error().text();
      const auto start = std::chrono::steady_clock::now();
      const auto result = detect_target(*grey, target);
      ms.push_back(
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
      ASSERT_TRUE(result) << result.error().text();
      found += result->corners.empty() ? 0 : 1;
      corners += static_cast<int>(result->corners.size());
      for (const Corner& c : result->corners) sigma.push_back(c.sigma_px);
      if (only != nullptr) {
        fmt::print("  {} {} {} {} {:.0f} ms\n", file.filename().string(), result->corners.size(),
                   result->method, result->reason, ms.back());
      }
      if (result->corners.empty()) remarks += " " + file.filename().string();
      if (result->method.starts_with("SB")) remarks += " " + file.filename().string() + "(SB)";
    }
    fmt::print("| {} {} | {} | {} | {} ({}) | {:.3f} | {:.0f} |{}\n", set.folder, target.name, files.size(),
               found, corners, files.size() * target.points.size(), median(sigma), median(ms), remarks);
    EXPECT_GE(found, set.found);
  }
}

}  // namespace
}  // namespace plumbline::test

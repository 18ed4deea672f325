// SPDX-License-Identifier: Apache-2.0
// The boards that are shipped in targets/: each YAML is readable, and its PDF and SVG are what the code
// prints today.
#include <algorithm>
#include <filesystem>

#include "plumbline/io/target_io.hpp"
#include "plumbline/synth/print.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;

std::vector<fs::path> shipped(const std::string& extension) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(fs::path(PLUMBLINE_SOURCE_DIR) / "targets")) {
    if (entry.path().extension() == extension) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

TEST(Targets, PrintsAreWhatTheCodePrintsToday) {
  ASSERT_GE(shipped(".yaml").size(), 9u);
  for (fs::path file : shipped(".yaml")) {
    const auto target = parse_target(test::read_text(file));
    ASSERT_TRUE(target) << file << ": " << target.error().text();
    EXPECT_EQ(target->name, file.stem().string());
    for (const auto& [format, extension] :
         {std::pair{PrintFormat::kPdf, ".pdf"}, {PrintFormat::kSvg, ".svg"}}) {
      const auto print = print_target(*target, {format});
      ASSERT_TRUE(print) << file << ": " << print.error().text();
      const std::string bytes = test::read_text(file.replace_extension(extension));
      EXPECT_TRUE(bytes == print->bytes) << file << " is not what the code prints: run ./dev targets";
      EXPECT_LT(bytes.size(), 200'000u) << file;
    }
  }
}

TEST(Targets, NothingElseLiesThere) {
  EXPECT_EQ(shipped(".pdf").size(), shipped(".yaml").size());
  EXPECT_EQ(shipped(".svg").size(), shipped(".yaml").size());
}

TEST(Targets, TheTableNamesEachBoard) {
  const std::string readme = test::read_text(fs::path(PLUMBLINE_SOURCE_DIR) / "targets/README.md");
  for (const fs::path& file : shipped(".yaml"))
    EXPECT_NE(readme.find(file.stem().string()), std::string::npos) << file;
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/glob.hpp"

#include <fstream>

#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;

class GlobFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"left1.jpg", "left2.jpg", "left10.jpg", "right1.jpg", "a/cam0/7.png",
                             "a/cam1/7.png", "a/cam1/8.png", ".left3.jpg", "left4.txt"}) {
      fs::create_directories((dir / name).parent_path());
      std::ofstream(dir / name) << "x";
    }
  }
  std::vector<std::string> names(const std::string& pattern) {
    std::vector<std::string> result;
    const auto matches = glob_files((dir / pattern).string());
    if (matches) {
      for (const GlobMatch& m : *matches) result.push_back(m.name + " " + m.key);
    }
    return result;
  }
  test::TempDir dir;
};

using ::testing::ElementsAre;

TEST_F(GlobFiles, SortsNaturallyAndKeepsWhatTheWildcardMatched) {
  EXPECT_THAT(names("left*.jpg"), ElementsAre("left1.jpg 1", "left2.jpg 2", "left10.jpg 10"));
}

TEST_F(GlobFiles, QuestionMarkIsOneCharacterAndNeighboursAreOneCapture) {
  EXPECT_THAT(names("left?.jpg"), ElementsAre("left1.jpg 1", "left2.jpg 2"));
  EXPECT_THAT(names("left??.jpg"), ElementsAre("left10.jpg 10"));
}

TEST_F(GlobFiles, WildcardsInFoldersAreJoinedBySlash) {
  EXPECT_THAT(names("a/cam*/*.png"), ElementsAre("cam0/7.png 0/7", "cam1/7.png 1/7", "cam1/8.png 1/8"));
}

TEST_F(GlobFiles, WithoutWildcardTheKeyIsTheStem) {
  EXPECT_THAT(names("right1.jpg"), ElementsAre("right1.jpg right1"));
}

TEST_F(GlobFiles, AFolderIsAllFilesInIt) {
  for (const char* folder : {"a/cam1", "a/cam1/", "a/cam1/.", "./a/../a/cam1/./"})
    EXPECT_THAT(names(folder), ElementsAre("7.png 7", "8.png 8")) << folder;
  fs::create_directory(dir / "empty");
  const auto nothing = glob_files((dir / "empty").string());
  ASSERT_FALSE(nothing);
  EXPECT_THAT(nothing.error().text(), testing::HasSubstr("holds 0 entries"));
}

TEST_F(GlobFiles, NamesNeverHoldAnAbsolutePath) {
  const auto matches = glob_files((dir / "a/cam1/*.png").string());
  ASSERT_TRUE(matches);
  EXPECT_EQ(matches->front().name, "7.png");
  EXPECT_TRUE(fs::exists(matches->front().file));
}

TEST_F(GlobFiles, NamesAreTheSameWhereverOneStands) {
  const fs::path before = fs::current_path();
  fs::current_path(dir.path());
  const auto matches = glob_files("./a/cam1/*.png");
  fs::current_path(before);
  ASSERT_TRUE(matches);
  EXPECT_EQ(matches->front().name, "7.png");
}

TEST_F(GlobFiles, SaysWhatTheFolderHoldsWhenNothingMatches) {
  const auto none = glob_files((dir / "*.tiff").string());
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kIo);
  EXPECT_THAT(none.error().message, ::testing::HasSubstr("entries"));
  EXPECT_FALSE(glob_files((dir / "no/such/*.png").string()));
  EXPECT_FALSE(glob_files((dir / "missing.png").string()));
  EXPECT_FALSE(glob_files(""));
  EXPECT_FALSE(glob_files("/"));
}

TEST(GlobKey, MatchesNamesOfFilesThatNeedNotExist) {
  EXPECT_EQ(glob_key("left*", "left01.jpg"), "01.jpg");
  EXPECT_EQ(glob_key("left*.jpg", "some/where/left01.jpg"), "01");
  EXPECT_EQ(glob_key("l*/x*.png", "l3/x4.png"), "3/4");
  EXPECT_EQ(glob_key("left*.jpg", "right01.jpg"), std::nullopt);
  EXPECT_EQ(glob_key("*/left*.jpg", "left01.jpg"), std::nullopt);
  EXPECT_EQ(glob_key("*a*.png", "bacada.png"), "b/cada");  // shortest first
}

}  // namespace
}  // namespace plumbline

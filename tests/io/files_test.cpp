// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/files.hpp"

#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "support/support.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using test::read_text;
using test::TempDir;
using test::write_text;

std::vector<std::string> names_in(const fs::path& dir) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(dir)) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

TEST(ReadFile, GivesTheBytesAsTheyAre) {
  const TempDir dir;
  const std::string bytes("a\0b\r\n\xff", 6);
  write_text(dir / "f", bytes);
  EXPECT_EQ(read_file(dir / "f").value(), bytes);
  write_text(dir / "empty", "");
  EXPECT_EQ(read_file(dir / "empty").value(), "");
}

TEST(ReadFile, SaysWhyNot) {
  const TempDir dir;
  const auto missing = read_file(dir / "none");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kIo);
  EXPECT_EQ(missing.error().where, (dir / "none").string());
  EXPECT_NE(missing.error().message.find("No such file"), std::string::npos);
  EXPECT_NE(read_file(dir.path()).error().message.find("is a directory"), std::string::npos);
  EXPECT_NE(read_file("/dev/zero").error().message.find("256 MiB"), std::string::npos);
}

TEST(WriteFile, WritesAndRefusesToReplace) {
  const TempDir dir;
  ASSERT_TRUE(write_file(dir / "f", "one", false));
  EXPECT_EQ(read_text(dir / "f"), "one");
  const Status again = write_file(dir / "f", "two", false);
  ASSERT_FALSE(again);
  EXPECT_NE(again.error().message.find("--force"), std::string::npos);
  EXPECT_EQ(read_text(dir / "f"), "one");
  ASSERT_TRUE(write_file(dir / "f", "two", true));
  EXPECT_EQ(read_text(dir / "f"), "two");
  EXPECT_EQ(names_in(dir.path()), std::vector<std::string>{"f"});
}

TEST(WriteFile, HasTheUsualPermissions) {
  const TempDir dir;
  const mode_t old = umask(022);
  ASSERT_TRUE(write_file(dir / "f", "x", false));
  umask(old);
  struct stat status {};
  ASSERT_EQ(stat((dir / "f").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0644u);
}

TEST(WriteFile, AFullDeviceIsAnErrorAndTheDeviceSurvives) {
  for (const bool force : {false, true}) {
    const Status full = write_file("/dev/full", "x", force);
    ASSERT_FALSE(full);
    EXPECT_EQ(full.error().code, ErrorCode::kIo);
    EXPECT_NE(full.error().message.find("No space left"), std::string::npos) << full.error().text();
    EXPECT_TRUE(fs::is_character_file("/dev/full"));
  }
  EXPECT_TRUE(write_file("/dev/null", "x", false));
}

// What `ulimit -f` does: a limit of file size in this process, with SIGXFSZ ignored as main() does.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &old_);
    const rlimit limit{bytes, old_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &old_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit old_{};
  void (*handler_)(int);
};

TEST(WriteFile, AFileTooLargeLeavesNothingAndKeepsTheOldOne) {
  const TempDir dir;
  write_text(dir / "old", "kept");
  Status fresh, replaced;
  {
    const FileSizeLimit limit(4096);
    fresh = write_file(dir / "new", std::string(10000, 'x'), false);
    replaced = write_file(dir / "old", std::string(10000, 'x'), true);
  }
  ASSERT_FALSE(fresh);
  EXPECT_NE(fresh.error().message.find("too large"), std::string::npos) << fresh.error().text();
  ASSERT_FALSE(replaced);
  EXPECT_EQ(names_in(dir.path()), std::vector<std::string>{"old"});
  EXPECT_EQ(read_text(dir / "old"), "kept");
}

TEST(WriteFile, RefusesWhatIsNoFile) {
  const TempDir dir;
  EXPECT_NE(write_file(dir.path(), "x", true).error().message.find("is a directory"), std::string::npos);
  EXPECT_FALSE(write_file(dir.path() / "", "x", true));
  EXPECT_NE(write_file(dir / "no" / "f", "x", false).error().message.find("No such file"), std::string::npos);
  EXPECT_FALSE(write_file("", "x", true));
}

TEST(WriteFile, ALinkStaysALink) {
  const TempDir dir;
  write_text(dir / "real", "one");
  fs::create_symlink("real", dir / "link");
  EXPECT_FALSE(write_file(dir / "link", "two", false));
  ASSERT_TRUE(write_file(dir / "link", "two", true));
  EXPECT_TRUE(fs::is_symlink(dir / "link"));
  EXPECT_EQ(read_text(dir / "real"), "two");
}

TEST(WriteFile, WorksInTheWorkingDirectoryAndWithTheLongestName) {
  const TempDir dir;
  const fs::path before = fs::current_path();
  fs::current_path(dir.path());
  EXPECT_TRUE(write_file(std::string(255, 'n'), "x", false));
  fs::current_path(before);
  EXPECT_EQ(names_in(dir.path()).front().size(), 255u);
}

TEST(OutputDir, AppearsAtCommitAndNotBefore) {
  const TempDir dir;
  auto out = OutputDir::create(dir / "out", false);
  ASSERT_TRUE(out);
  EXPECT_EQ(out->path().parent_path(), dir.path());
  EXPECT_EQ(out->path().filename().string().front(), '.');
  ASSERT_TRUE(out->write("a.txt", "a"));
  ASSERT_TRUE(out->write("left/01.txt", "b"));
  EXPECT_FALSE(fs::exists(dir / "out"));
  ASSERT_TRUE(out->commit());
  EXPECT_EQ(read_text(dir / "out" / "a.txt"), "a");
  EXPECT_EQ(read_text(dir / "out" / "left" / "01.txt"), "b");
  EXPECT_EQ(names_in(dir.path()), std::vector<std::string>{"out"});
}

TEST(OutputDir, VanishesWithoutCommit) {
  const TempDir dir;
  {
    auto out = OutputDir::create(dir / "out/", false);
    ASSERT_TRUE(out);
    ASSERT_TRUE(out->write("a", "a"));
    OutputDir moved = *std::move(out);
    ASSERT_TRUE(moved.write("b", "b"));
    auto other = OutputDir::create(dir / "other", false);
    moved = *std::move(other);  // drops the first
    EXPECT_EQ(names_in(dir.path()).size(), 1u);
  }
  EXPECT_TRUE(names_in(dir.path()).empty());
}

TEST(OutputDir, AnExistingOneIsReplacedOnlyWithForceAndOnlyAtCommit) {
  const TempDir dir;
  fs::create_directory(dir / "out");
  write_text(dir / "out" / "corners.yaml", "old");
  EXPECT_NE(OutputDir::create(dir / "out", false).error().message.find("--force"), std::string::npos);
  {
    auto out = OutputDir::create(dir / "out", true);
    ASSERT_TRUE(out->write("new", "new"));
    EXPECT_EQ(read_text(dir / "out" / "corners.yaml"), "old");
  }
  EXPECT_EQ(read_text(dir / "out" / "corners.yaml"), "old");
  auto out = OutputDir::create(dir / "out", true);
  ASSERT_TRUE(out->write("new", "new"));
  ASSERT_TRUE(out->commit());
  EXPECT_EQ(names_in(dir / "out"), std::vector<std::string>{"new"});
  EXPECT_EQ(names_in(dir.path()), std::vector<std::string>{"out"});
}

TEST(OutputDir, WhatIsNotOursIsNeverReplaced) {
  const TempDir dir;
  const fs::path out = dir / "out";
  fs::create_directories(out / "left");
  write_text(out / "calibration.yaml", "old");
  write_text(out / "left" / "01.png", "old");
  const auto refused_for = [&](const fs::path& foreign) {
    fs::create_directories((out / foreign).parent_path());
    write_text(out / foreign, "mine");
    const auto refused = OutputDir::create(out, true);
    const std::string message = refused ? "" : refused.error().message;
    EXPECT_EQ(message, "holds " + foreign.string() +
                           ", which Plumbline did not write; remove it or choose another -o");
    EXPECT_EQ(read_text(out / foreign), "mine");
    fs::remove(out / foreign);
  };
  refused_for("keep.dat");
  refused_for("keep.txt");
  refused_for("photograph.png");  // images of ours are in a folder with the name of the camera
  refused_for("left/02.jpg");
  refused_for(".git");
  refused_for("board.yaml");  // the user's target: no camera is in it
  fs::create_directories(out / "left" / "deeper");
  EXPECT_FALSE(OutputDir::create(out, true));
  fs::remove(out / "left" / "deeper");
  fs::create_symlink("calibration.yaml", out / "cameras.txt");
  EXPECT_FALSE(OutputDir::create(out, true));
  fs::remove(out / "cameras.txt");
  EXPECT_EQ(names_in(out), (std::vector<std::string>{"calibration.yaml", "left"}));
  EXPECT_EQ(names_in(dir.path()), std::vector<std::string>{"out"});
  // Camera files have the names of their cameras.
  write_text(out / "any name.yml", "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n");
  EXPECT_TRUE(OutputDir::create(out, true));
}

TEST(OutputDir, WhatCameInTheMeantimeIsNotReplacedEither) {
  const TempDir dir;
  fs::create_directory(dir / "out");
  write_text(dir / "out" / "calibration.yaml", "old");
  {
    auto out = OutputDir::create(dir / "out", true);
    ASSERT_TRUE(out);
    ASSERT_TRUE(out->write("calibration.yaml", "new"));
    write_text(dir / "out" / "keep.dat", "mine");
    const Status late = out->commit();
    ASSERT_FALSE(late);
    EXPECT_EQ(late.error().code, ErrorCode::kIo);
    EXPECT_NE(late.error().message.find("keep.dat"), std::string::npos);
  }
  EXPECT_EQ(read_text(dir / "out" / "keep.dat"), "mine");
  EXPECT_EQ(read_text(dir / "out" / "calibration.yaml"), "old");
  EXPECT_EQ(names_in(dir.path()), std::vector<std::string>{"out"});
}

TEST(OutputDir, TheHomeDirectoryAndWhatIsAboveItAreNeverReplaced) {
  const TempDir dir;
  fs::create_directories(dir / "users" / "me");
  const char* const old = std::getenv("HOME");
  const std::string before = old ? old : "";
  setenv("HOME", (dir / "users" / "me").c_str(), 1);
  for (const fs::path& place : {dir / "users" / "me", dir / "users"}) {
    const auto refused = OutputDir::create(place, true);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message.find("home directory"), std::string::npos);
  }
  old ? setenv("HOME", before.c_str(), 1) : unsetenv("HOME");
}

TEST(OutputDir, OneMadeInTheMeantimeIsNotTouched) {
  const TempDir dir;
  auto out = OutputDir::create(dir / "out", false);
  fs::create_directory(dir / "out");  // empty: a plain rename() would replace it
  const Status late = out->commit();
  ASSERT_FALSE(late);
  EXPECT_NE(late.error().message.find("exists already"), std::string::npos);
}

TEST(OutputDir, MakesParentsThatAreNotThere) {
  const TempDir dir;
  auto output = OutputDir::create(dir / "a" / "b" / "out", false);
  ASSERT_TRUE(output) << output.error().text();
  ASSERT_TRUE(output->write("x.txt", "x"));
  ASSERT_TRUE(output->commit());
  EXPECT_EQ(read_text(dir / "a" / "b" / "out" / "x.txt"), "x");
}

TEST(OutputDir, TakesParentsItMadeWithItWhenNothingIsCommitted) {
  const TempDir dir;
  fs::create_directory(dir / "mine");
  { ASSERT_TRUE(OutputDir::create(dir / "mine" / "a" / "b" / "out", false)); }
  EXPECT_FALSE(fs::exists(dir / "mine" / "a"));
  EXPECT_TRUE(fs::exists(dir / "mine"));
}

TEST(OutputDir, RefusesPlacesThatCannotBe) {
  const TempDir dir;
  write_text(dir / "file", "x");
  EXPECT_NE(OutputDir::create(dir / "file", true).error().message.find("is a file"), std::string::npos);
  EXPECT_FALSE(OutputDir::create(dir / "file" / "out", false));
  EXPECT_FALSE(OutputDir::create("", true));
  EXPECT_FALSE(OutputDir::create("/", true));
  const fs::path before = fs::current_path();
  fs::create_directory(dir / "here");
  fs::current_path(dir / "here");
  EXPECT_NE(OutputDir::create(".", true).error().message.find("working directory"), std::string::npos);
  EXPECT_NE(OutputDir::create(dir.path(), true).error().message.find("working directory"), std::string::npos);
  EXPECT_FALSE(OutputDir::create("..", true));
  fs::current_path(before);
  EXPECT_EQ(names_in(dir.path()), (std::vector<std::string>{"file", "here"}));
}

TEST(OutputDir, NamesMayNotLeaveIt) {
  const TempDir dir;
  auto out = OutputDir::create(dir / "out", false);
  for (const char* name : {"../evil", "a/../../evil", "/tmp/evil", "..", ".", "", "a/"}) {
    EXPECT_FALSE(out->write(name, "x")) << name;
  }
  EXPECT_TRUE(fs::is_empty(out->path()));
}

TEST(OutputDir, AFileThatCannotBeWrittenIsNamedByItsFinalPlace) {
  const TempDir dir;
  {
    auto out = OutputDir::create(dir / "out", false);
    const FileSizeLimit limit(100);
    const Status full = out->write("a", std::string(1000, 'x'));
    ASSERT_FALSE(full);
    EXPECT_EQ(full.error().where, (dir / "out" / "a").string());
  }
  EXPECT_TRUE(names_in(dir.path()).empty());
}

}  // namespace
}  // namespace plumbline

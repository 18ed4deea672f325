// SPDX-License-Identifier: Apache-2.0
#include "support/support.hpp"

#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

namespace plumbline::test {
namespace fs = std::filesystem;

TempDir::TempDir() {
  std::string name = (fs::temp_directory_path() / "plumbline_test_XXXXXX").string();
  if (!mkdtemp(name.data())) throw std::runtime_error("mkdtemp failed");
  path_ = name;
}

TempDir::~TempDir() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

namespace {
std::optional<fs::path> folder_of(const char* variable, const std::string& folder) {
  const char* root = std::getenv(variable);
  const fs::path dir = root ? fs::path(root) / folder : fs::path();
  if (root && fs::is_directory(dir)) return dir;
  const char* required = std::getenv("PLUMBLINE_REQUIRE_DATA");
  if (required && std::string(required) == "1") {
    ADD_FAILURE() << "PLUMBLINE_REQUIRE_DATA=1, but " << variable << " has no folder '" << folder << "'";
  }
  return std::nullopt;
}
}  // namespace

std::optional<fs::path> data_dir(const std::string& folder) { return folder_of("PLUMBLINE_DATA", folder); }
std::optional<fs::path> demo_images() { return folder_of("PLUMBLINE_DEMO_IMAGES", ""); }

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}

Run run(const std::string& command) {
  const TempDir dir;
  const fs::path out = dir / "out", err = dir / "err";
  const int status =
      std::system(("(" + command + ") >'" + out.string() + "' 2>'" + err.string() + "'").c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), read_text(out), read_text(err)};
}

Run plumbline(const std::string& arguments) {
  std::string command = PLUMBLINE_BINARY;
  command += ' ';
  command += arguments;
  return run(command);
}

}  // namespace plumbline::test

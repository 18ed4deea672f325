// SPDX-License-Identifier: Apache-2.0
#include "image/codec.hpp"

#include <dlfcn.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "plumbline/core/text.hpp"

namespace plumbline::detail {
namespace {

namespace fs = std::filesystem;

/// The environment's folder, folders near the running program (a build tree, an installation that was moved),
/// the folder configured at build time, and last the run path that the program was linked with.
std::vector<std::string> candidates(const char* name) {
  std::vector<fs::path> folders;
  if (const char* dir = std::getenv("PLUMBLINE_MODULE_DIR"); dir != nullptr && *dir != 0)
    folders.emplace_back(dir);
  std::error_code ignored;
  const fs::path program = fs::read_symlink("/proc/self/exe", ignored);
  if (!program.empty()) {
    const fs::path here = program.parent_path();
    folders.push_back(here / "lib/plumbline");
    folders.push_back(here.parent_path() / PLUMBLINE_LIBDIR / "plumbline");
    folders.push_back(here.parent_path() / "lib/plumbline");
  }
  folders.emplace_back(PLUMBLINE_MODULE_DIR);
  std::vector<std::string> files;
  for (const fs::path& folder : folders) files.push_back((folder / name).string());
  files.emplace_back(name);
  return files;
}

/// The symbol of the first module of this name that can be loaded.
Result<const void*> load(const char* name, const char* symbol, const char* what) {
  std::string failures;
  const std::vector<std::string> files = candidates(name);
  for (const std::string& file : files) {
    const bool is_path = file.find('/') != std::string::npos;
    if (std::error_code ignored; is_path && !fs::exists(file, ignored)) continue;
    void* module = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (module != nullptr) {
      if (const void* api = dlsym(module, symbol)) return api;
    }
    const char* why = dlerror();
    if (is_path) failures += std::string("; ") + (why != nullptr ? why : "no reason given");
  }
  return Error{ErrorCode::kIo,
               std::string(what) + " need the module " + name + ", which is not in any of: " +
                   join(files, ", ") + failures + ". Set PLUMBLINE_MODULE_DIR to the folder that holds it",
               ""};
}

template <class Api>
Result<const Api*> load_api(const char* name, const char* symbol, const char* what) {
  const Result<const void*> api = load(name, symbol, what);
  if (!api) return api.error();
  return static_cast<const Api*>(*api);
}

}  // namespace

Result<const ImageioApi*> image_codec() {
  static const auto codec = load_api<ImageioApi>(kImageioFile, kImageioSymbol, "images");
  return codec;
}

Result<const VideoioApi*> video_codec() {
  static const auto codec = load_api<VideoioApi>(kVideoioFile, kVideoioSymbol, "videos");
  return codec;
}

}  // namespace plumbline::detail

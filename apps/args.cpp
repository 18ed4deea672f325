// SPDX-License-Identifier: Apache-2.0
#include "args.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <set>

#include "plumbline/core/text.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/io/glob.hpp"
#include "plumbline/io/target_io.hpp"

namespace plumbline::apps {
namespace fs = std::filesystem;

void on_run(CLI::App& app, int& exit_code, std::function<Result<int>()> body) {
  // "target new" for a subcommand of a subcommand; the program itself has no name of its own to add.
  const CLI::App* parent = app.get_parent();
  const bool nested = parent && parent->get_parent();
  const std::string name = nested ? parent->get_name() + " " + app.get_name() : app.get_name();
  app.callback([name, &exit_code, body = std::move(body)] {
    auto result = body();
    if (result) {
      exit_code = *result;
      return;
    }
    std::string line = result.error().text();
    std::replace(line.begin(), line.end(), '\n', ' ');
    fmt::print(stderr, "plumbline {}: {}\n", name, line);
    exit_code = kFailed;
  });
}

void usage_error(const std::string& message) { throw CLI::ValidationError(message); }

namespace {
// What is wrong with one --cam argument; empty when nothing is.
std::string fault_of_cam(const std::string& argument) {
  const std::size_t equals = argument.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == argument.size()) {
    return fmt::format("{}: NAME=GLOB is needed, for example --cam left='img/left*.jpg'", argument);
  }
  const bool plain = std::all_of(argument.begin(), argument.begin() + equals, [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-' || c == '.';
  });
  if (plain && argument.front() != '.') return "";
  return fmt::format("{}: a camera's name is letters, digits, '_', '-' and '.'", argument);
}
}  // namespace

CLI::Option* add_cam_option(CLI::App& app, std::vector<std::string>& cams) {
  return app
      .add_option("--cam", cams,
                  "NAME=GLOB, once per camera: images or videos, a pattern in quotes or a folder")
      ->allow_extra_args(false)
      ->check(CLI::Validator(fault_of_cam, "NAME=GLOB"));
}

CLI::Option* add_target_option(CLI::App& app, std::vector<std::string>& targets) {
  return app
      .add_option("--target", targets,
                  "target file, ours or Kalibr's; once per board where there are several")
      ->allow_extra_args(false);
}

std::vector<CamArg> parse_cams(const std::vector<std::string>& arguments) {
  std::vector<CamArg> cams;
  std::set<std::string> names;
  for (const std::string& argument : arguments) {
    const std::size_t equals = argument.find('=');
    cams.push_back({argument.substr(0, equals), argument.substr(equals + 1)});
    if (!names.insert(cams.back().name).second) {
      usage_error(fmt::format("--cam {}: two cameras have this name", argument));
    }
  }
  return cams;
}

CLI::Option* add_every_option(CLI::App& app, int& every) {
  return app
      .add_option("--every", every,
                  fmt::format("of videos, the sharpest frame of every N (default: {})", every))
      ->check(CLI::Range(1, 1'000'000));
}

CLI::Option* add_thin_option(CLI::App& app, std::optional<double>& thin_px) {
  return app
      .add_option("--thin", thin_px,
                  fmt::format("leave frames out whose corners all lie within PX of an earlier one's; 0: none "
                              "(default: {:g} of the diagonal for videos, none for images)",
                              kThinFraction))
      ->check(between(0.0, 1000.0));
}

Result<std::vector<CameraImages>> find_images(const std::vector<std::string>& cams, bool by_order, int every,
                                              const Common& common) {
  std::vector<CameraImages> all;
  for (const CamArg& cam : parse_cams(cams)) {
    auto matches = glob_files(cam.pattern);
    if (!matches) return matches.error();
    CameraImages images{cam.name, {}, {}, {}};
    std::set<std::string> keys;
    for (std::size_t i = 0; i < matches->size(); ++i) {
      const GlobMatch& match = (*matches)[i];
      std::string key = by_order ? fmt::format("{}", i) : match.key;
      if (!keys.insert(key).second) {
        return Error{
            ErrorCode::kInvalidData,
            fmt::format("two images of camera {} give the frame '{}'; use --pair-by order or another pattern",
                        cam.name, key),
            match.name};
      }
      images.files.push_back(match.file);
      images.names.push_back(match.name);
      images.frames.push_back(std::move(key));
    }
    all.push_back(std::move(images));
  }
  Progress progress("reading videos, frame", common);
  VideoOptions options;
  options.every = every;
  options.n_threads = common.n_threads;
  options.progress = [&](int done, int n) { progress(done, n); };
  return sample_videos(std::move(all), options);
}

std::string text_of_notes(const std::vector<std::string>& notes) {
  std::string text;
  for (const std::string& note : notes) text += "note: " + note + "\n";
  return text;
}

namespace {
// Reads and parses one file; the file's name stands in front of what is wrong with it.
template <class T>
Result<T> load(const fs::path& file, Result<T> (*parse)(std::string_view)) {
  auto text = read_file(file);
  if (!text) return text.error();
  auto parsed = parse(*text);
  if (parsed) return parsed;
  Error error = parsed.error();
  error.where = file.string() + (error.where.empty() ? "" : ": " + error.where);
  return error;
}
}  // namespace

Result<Target> load_target(const fs::path& file) { return load(file, parse_target); }

Result<std::vector<Target>> load_targets(const std::vector<std::string>& files) {
  std::vector<Target> targets;
  std::map<std::string, int> n_of_name;
  for (const std::string& file : files) {
    auto target = load_target(file);
    if (!target) return target.error();
    ++n_of_name[target->name];
    targets.push_back(*std::move(target));
  }
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (n_of_name[targets[i].name] > 1) targets[i].name += "_" + fs::path(files[i]).stem().string();
  }
  return targets;
}

Result<Dataset> load_corners_yaml(const fs::path& file) { return load(file, parse_corners); }

Result<std::vector<VnlImage>> load_vnl_file(const fs::path& file) { return load(file, parse_vnl); }

Result<Calibration> load_calibration(const fs::path& file) {
  return load(fs::is_directory(file) ? file / "calibration.yaml" : file, parse_calibration);
}

Result<Rig> load_rig(const std::vector<std::string>& paths, const std::string& format) {
  std::vector<fs::path> files;
  for (const std::string& path : paths) {
    if (!fs::is_directory(path)) {
      files.emplace_back(path);
      continue;
    }
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(path)) {
      const std::string name = entry.path().filename().string();
      // corners.yaml and rectification.yaml lie beside calibrations and hold no camera of their own.
      if (entry.is_regular_file() && name.front() != '.' && name != "corners.yaml" &&
          name != "rectification.yaml") {
        names.push_back(name);
      }
    }
    std::sort(names.begin(), names.end(), natural_less);
    for (const std::string& name : names) files.push_back(fs::path(path) / name);
    if (names.empty()) return Error{ErrorCode::kIo, "the folder holds no camera file", path};
  }
  std::vector<NamedBytes> contents;
  for (const fs::path& file : files) {
    auto bytes = read_file(file);
    if (!bytes) return bytes.error();
    contents.push_back({file.filename().string(), *std::move(bytes)});
  }
  auto rig = read_rig(contents, format);
  if (rig) return rig;
  Error error = rig.error();
  if (error.where.empty() && !paths.empty()) error.where = paths.front();
  return error;
}

Status check_output(const fs::path& output, const Common& common) {
  std::error_code ignored;
  if (common.force || !fs::exists(fs::symlink_status(output, ignored))) return {};
  return Error{ErrorCode::kIo, "this exists already; choose another -o, or give --force to replace it",
               output.string()};
}

Status check_parent(const fs::path& file) {
  std::error_code ignored;
  if (file.empty() || !file.has_parent_path() || fs::is_directory(file.parent_path(), ignored)) return {};
  return Error{ErrorCode::kIo, "the folder of this file does not exist; make it first", file.string()};
}

CLI::Validator positive() {
  return {[](const std::string& text) {
            const auto value = parse_double(text);
            return value && *value > 0 ? std::string()
                                       : fmt::format("{} is not a finite number above 0", text);
          },
          "POSITIVE"};
}

CLI::Validator between(double low, double high) {
  return {[low, high](const std::string& text) {
            const auto value = parse_double(text);
            return value && *value >= low && *value <= high
                       ? std::string()
                       : fmt::format("{} is not a number from {} to {}", text, low, high);
          },
          fmt::format("{}..{}", low, high)};
}

namespace {
std::optional<ImageSize> two_numbers(const std::string& text) {
  const auto pieces = split(text, 'x');
  if (pieces.size() != 2) return std::nullopt;
  const auto width = parse_int(pieces[0]), height = parse_int(pieces[1]);
  if (!width || !height || *width <= 0 || *height <= 0 || *width > 100000 || *height > 100000)
    return std::nullopt;
  return ImageSize{*width, *height};
}
}  // namespace

ImageSize parse_size(const std::string& text, const std::string& option) {
  if (const auto size = two_numbers(text)) return *size;
  usage_error(fmt::format("{} {}: WIDTHxHEIGHT in pixels is needed, for example 640x480", option, text));
}

ImageSize parse_counts(const std::string& text, const std::string& option) {
  if (const auto counts = two_numbers(text)) return *counts;
  usage_error(fmt::format("{} {}: COLUMNSxROWS is needed, for example 9x6", option, text));
}

namespace {
// While a folder is being filled, an interrupt only sets this; the folder is then removed on the way out.
volatile std::sig_atomic_t g_interrupted = 0;
extern "C" void note_interrupt(int) { g_interrupted = 1; }

struct InterruptGuard {
  InterruptGuard()
      : old_int(std::signal(SIGINT, note_interrupt)), old_term(std::signal(SIGTERM, note_interrupt)) {}
  ~InterruptGuard() {
    std::signal(SIGINT, old_int);
    std::signal(SIGTERM, old_term);
  }
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;
  void (*old_int)(int);
  void (*old_term)(int);
};
}  // namespace

Status write_folder(const fs::path& folder, bool force, const std::function<Status(const fs::path&)>& fill) {
  const InterruptGuard guard;
  auto output = OutputDir::create(folder, force);
  if (!output) return output.error();
  if (Status filled = fill(output->path()); !filled) return filled;
  if (g_interrupted) return Error{ErrorCode::kIo, "interrupted; nothing was written", folder.string()};
  return output->commit();
}

struct Progress::State {
  std::string what;
  bool terminal = false, silent = false;
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  std::chrono::steady_clock::time_point last_line = start;
  bool shown = false;
};

Progress::Progress(std::string what, const Common& common) : state_(std::make_unique<State>()) {
  state_->what = std::move(what);
  state_->terminal = isatty(STDERR_FILENO) != 0;
  state_->silent = common.json && !state_->terminal;
}

Progress::~Progress() {
  if (state_->terminal && state_->shown) fmt::print(stderr, "\r\033[K");
}

void Progress::operator()(int done, int all) {
  if (state_->silent || all <= 0) return;
  const double elapsed_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - state_->start).count();
  const double left_s = done > 0 ? elapsed_s / done * (all - done) : 0;
  if (state_->terminal) {
    fmt::print(stderr, "\r\033[K{}: {} of {} ({:.0f} s left)", state_->what, done, all, left_s);
    std::fflush(stderr);
    state_->shown = true;
    return;
  }
  // Into a file or a pipe: a line every ten seconds, and none for what is quickly done.
  const auto now = std::chrono::steady_clock::now();
  if (now - state_->last_line < std::chrono::seconds(10)) return;
  fmt::print(stderr, "{}: {} of {}, about {:.0f} s left\n", state_->what, done, all, left_s);
  state_->last_line = now;
}

Status print_result(const Common& common, const Json& json, const std::string& text) {
  const std::string bytes = common.json ? json.dump(2) + "\n" : text;
  const bool written =
      std::fwrite(bytes.data(), 1, bytes.size(), stdout) == bytes.size() && std::fflush(stdout) == 0;
  if (!written) return Error{ErrorCode::kIo, "standard output cannot be written (is the disc full?)", ""};
  return {};
}

Json json_of(const SE3& T) {
  const Mat4 M = T.matrix();
  Json numbers = Json::array();
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) numbers.push_back(M(r, c));
  return numbers;
}

}  // namespace plumbline::apps

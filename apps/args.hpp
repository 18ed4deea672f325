// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "plumbline/core/result.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/rig/calibration.hpp"

/// What the subcommands share: reading their inputs, printing results, errors and progress.
namespace plumbline::apps {

using Json = nlohmann::ordered_json;

/// Runs `body` when the subcommand is chosen and keeps its exit code; an Error is printed as one line on
/// stderr.
void on_run(CLI::App& app, int& exit_code, std::function<Result<int>()> body);

/// Wrong usage that CLI11 cannot see: exit code 2 with this text.
[[noreturn]] void usage_error(const std::string& message);

/// A --cam argument NAME=GLOB. Names are letters, digits, '_', '-' and '.', because they become file names.
struct CamArg {
  std::string name, pattern;
};
std::vector<CamArg> parse_cams(const std::vector<std::string>& arguments);

/// Declares --cam, once per camera, on a subcommand; malformed ones are wrong usage before any file is
/// touched.
CLI::Option* add_cam_option(CLI::App& app, std::vector<std::string>& cams);

/// Declares --target, which may be repeated where several boards are in the images.
CLI::Option* add_target_option(CLI::App& app, std::vector<std::string>& targets);

/// Declares --every, which frames of videos are taken.
CLI::Option* add_every_option(CLI::App& app, int& every);

/// Declares --thin, which frames are near-duplicates (thin_near_duplicates()).
CLI::Option* add_thin_option(CLI::App& app, std::optional<double>& thin_px);

/// The images of --cam arguments with their frame keys; `by_order` matches frames of several cameras by
/// position. Of videos the sharpest frame of each window of `every` (sample_videos()).
Result<std::vector<CameraImages>> find_images(const std::vector<std::string>& cams, bool by_order, int every,
                                              const Common& common);

/// One line of text for each note.
std::string text_of_notes(const std::vector<std::string>& notes);

/// A target file (ours or Kalibr's).
Result<Target> load_target(const std::filesystem::path& file);
/// Several; names that are there twice get the name of their file added.
Result<std::vector<Target>> load_targets(const std::vector<std::string>& files);

/// A corners.yaml of ours, and the images of a corners.vnl.
Result<Dataset> load_corners_yaml(const std::filesystem::path& file);
Result<std::vector<VnlImage>> load_vnl_file(const std::filesystem::path& file);

/// A calibration.yaml with everything in it.
Result<Calibration> load_calibration(const std::filesystem::path& file);

/// The rig in any readable camera files: one file, several, or a folder of them.
Result<Rig> load_rig(const std::vector<std::string>& paths, const std::string& format = "");

/// Fails early, before hours of work, when -o exists and --force is not given.
Status check_output(const std::filesystem::path& output, const Common& common);

/// Fails early when the folder that a file is to be written into does not exist, so that of two outputs not
/// only one is written. An empty name passes.
Status check_parent(const std::filesystem::path& file);

/// Checks of options: a finite number above 0, and one between two bounds. CLI11's own let NaN through.
CLI::Validator positive();
CLI::Validator between(double low, double high);

/// "640x480" -> size; usage error otherwise.
ImageSize parse_size(const std::string& text, const std::string& option);

/// "9x6" -> columns and rows; usage error otherwise.
ImageSize parse_counts(const std::string& text, const std::string& option);

/// Writes files into a folder that appears whole or not at all.
Status write_folder(const std::filesystem::path& folder, bool force,
                    const std::function<Status(const std::filesystem::path&)>& fill);

/// Progress on stderr: one line that is rewritten on a terminal, a plain line every few seconds otherwise;
/// nothing with
/// --json off a terminal.
class Progress {
 public:
  Progress(std::string what, const Common& common);
  ~Progress();
  void operator()(int done, int all);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Prints `json` on stdout if --json, else `text`; kIo when stdout cannot be written (a full disc).
Status print_result(const Common& common, const Json& json, const std::string& text);

/// T as 16 numbers, row by row.
Json json_of(const SE3& T);

}  // namespace plumbline::apps

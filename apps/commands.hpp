// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/App.hpp>
#include <span>
#include <string_view>

namespace plumbline::apps {

/// What every subcommand shares.
struct Common {
  bool json = false;   ///< --json: one JSON object on stdout and nothing else
  int n_threads = 0;   ///< --threads; 0: all cores
  int seed = 0;        ///< --seed
  bool force = false;  ///< --force: replace earlier results
};

/// Exit codes of the program; part of its contract.
enum ExitCode { kDone = 0, kFailed = 1, kUsage = 2, kGateMissed = 3 };

/// A subcommand: `add` declares its options on `app` and sets app.callback to do the work; the callback
/// stores the exit code in `exit_code`. One file per subcommand, one line in the table of commands.cpp.
struct Command {
  std::string_view name, summary;
  void (*add)(CLI::App& app, const Common& common, int& exit_code);
};

/// All subcommands in the order of the pipeline.
std::span<const Command> commands();

void add_target(CLI::App& app, const Common& common, int& exit_code);
void add_detect(CLI::App& app, const Common& common, int& exit_code);
void add_calibrate(CLI::App& app, const Common& common, int& exit_code);
void add_crosscheck(CLI::App& app, const Common& common, int& exit_code);
void add_rectify(CLI::App& app, const Common& common, int& exit_code);
void add_undistort(CLI::App& app, const Common& common, int& exit_code);
void add_convert(CLI::App& app, const Common& common, int& exit_code);
void add_compare(CLI::App& app, const Common& common, int& exit_code);
void add_simulate(CLI::App& app, const Common& common, int& exit_code);
void add_geometry(CLI::App& app, const Common& common, int& exit_code);
void add_list(CLI::App& app, const Common& common, int& exit_code);

}  // namespace plumbline::apps

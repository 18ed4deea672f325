// SPDX-License-Identifier: Apache-2.0
#include "program.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <exception>
#include <new>
#include <optional>
#include <string>
#include <string_view>

#include "commands.hpp"
#include "geometry.hpp"

namespace plumbline::apps {

namespace {
// The word that should be a command, or a verb of geometry, and is none: CLI11 only says that a subcommand is
// missing.
std::optional<std::string> unknown_word(int argc, char** argv) {
  const auto named = [](const auto& table, std::string_view name) {
    return std::any_of(table.begin(), table.end(), [&](const auto& entry) { return entry.name == name; });
  };
  if (argc < 2 || argv[1][0] == '-') return std::nullopt;
  const std::string_view first = argv[1];
  if (!named(commands(), first)) return fmt::format("command '{}'", first);
  if (first != "geometry" || argc < 3 || argv[2][0] == '-' || named(geometry_verbs(), argv[2]))
    return std::nullopt;
  return fmt::format("verb '{}' of geometry", argv[2]);
}
}  // namespace

int run_program(int argc, char** argv) {
  CLI::App app("Camera calibration and rectification: from photographs of a board to camera files.",
               "plumbline");
  app.set_version_flag("--version", PLUMBLINE_VERSION);
  app.require_subcommand(1);
  app.fallthrough();
  app.footer(
      "Every command has its own --help. Exit codes: 0 done, 1 failed, 2 wrong usage, 3 a quality gate was "
      "missed.");
  Common common;
  app.add_flag("--json", common.json, "print one JSON object on stdout and nothing else");
  app.add_option("--threads", common.n_threads, "threads; results do not depend on it (default: all)")
      ->check(CLI::Range(0, 4096));
  app.add_option("--seed", common.seed, "seed of everything random (default: 0)")
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--force", common.force, "replace an earlier result");
  int exit_code = kDone;
  for (const Command& command : commands()) {
    CLI::App* sub = app.add_subcommand(std::string(command.name), std::string(command.summary));
    sub->fallthrough();
    command.add(*sub, common, exit_code);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    if (const auto word = unknown_word(argc, argv)) {
      fmt::print(stderr, "plumbline: there is no {}. Run with --help for the list.\n", *word);
    } else {
      fmt::print(stderr, "plumbline: {}\nRun with --help for more.\n", error.what());
    }
    return kUsage;
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "plumbline: out of memory; use fewer or smaller images\n");
    return kFailed;
  } catch (const std::exception& error) {
    fmt::print(stderr, "plumbline: internal error: {}; please report it with the command\n", error.what());
    return kFailed;
  }
  return exit_code;
}

}  // namespace plumbline::apps

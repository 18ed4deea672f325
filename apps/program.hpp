// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace plumbline::apps {
/// Parses the command line, runs the subcommand, and returns the exit code.
int run_program(int argc, char** argv);
}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include "commands.hpp"

namespace plumbline::apps {

void add_list(CLI::App& app, const Common&, int& exit_code) {
  app.callback([&exit_code] { exit_code = kDone; });
}

}  // namespace plumbline::apps

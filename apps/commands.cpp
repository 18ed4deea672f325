// SPDX-License-Identifier: Apache-2.0
#include "commands.hpp"

#include <array>

namespace plumbline::apps {
namespace {

constexpr std::array kCommands{
    Command{"list", "lenses, formats and targets that there are", add_list},
};

}  // namespace

std::span<const Command> commands() { return kCommands; }

}  // namespace plumbline::apps

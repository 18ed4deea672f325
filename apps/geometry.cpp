// SPDX-License-Identifier: Apache-2.0
#include "geometry.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <string>

namespace plumbline::apps {
namespace {

constexpr std::array kVerbs{
    GeometryVerb{"transform", "chain, invert and convert rigid transforms", add_geometry_transform},
    GeometryVerb{"bundle", "adjust points, poses and lenses of a COLMAP model or BAL problem",
                 add_geometry_bundle},
};

}  // namespace

std::span<const GeometryVerb> geometry_verbs() { return kVerbs; }

void add_geometry(CLI::App& app, const Common& common, int& exit_code) {
  app.require_subcommand(1);
  for (const GeometryVerb& verb : geometry_verbs()) {
    CLI::App* sub = app.add_subcommand(std::string(verb.name), std::string(verb.summary));
    sub->fallthrough();
    verb.add(*sub, common, exit_code);
  }
}

}  // namespace plumbline::apps

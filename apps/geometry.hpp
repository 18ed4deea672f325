// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <string_view>

#include "commands.hpp"

namespace plumbline::apps {

/// A verb of `plumbline geometry`: `add` declares its options as a Command's does. One file per verb,
/// geometry_NAME.cpp, and one line in the table of geometry.cpp.
struct GeometryVerb {
  std::string_view name, summary;
  void (*add)(CLI::App& app, const Common& common, int& exit_code);
};

/// All verbs, from what needs one view to what needs many.
std::span<const GeometryVerb> geometry_verbs();

void add_geometry_pose(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_decompose(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_homography(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_triangulate(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_fundamental(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_essential(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_rectify(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_transform(CLI::App& app, const Common& common, int& exit_code);
void add_geometry_bundle(CLI::App& app, const Common& common, int& exit_code);

}  // namespace plumbline::apps

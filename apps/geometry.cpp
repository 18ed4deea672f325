// SPDX-License-Identifier: Apache-2.0
#include "geometry.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <string>

namespace plumbline::apps {
namespace {

constexpr std::array kVerbs{
    GeometryVerb{"pose", "points of the world, their pixels and a camera -> where the camera is",
                 add_geometry_pose},
    GeometryVerb{"decompose", "points and pixels, or P -> P, K, R, t and the centre", add_geometry_decompose},
    GeometryVerb{"triangulate", "pixels of one point in several posed cameras -> the point",
                 add_geometry_triangulate},
    GeometryVerb{"fundamental", "matched pixels -> F and the epipoles", add_geometry_fundamental},
    GeometryVerb{"essential", "matched pixels and cameras -> E and the motion, up to scale",
                 add_geometry_essential},
    GeometryVerb{"homography", "matched pixels of a plane -> H, and with cameras R, t/d and n",
                 add_geometry_homography},
    GeometryVerb{"rectify",
                 "matched pixels -> homographies after which the rows match, without a calibration",
                 add_geometry_rectify},
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

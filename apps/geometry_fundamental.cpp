// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "geometry_views.hpp"
#include "plumbline/linear/fundamental.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string points, output;
  RobustOptions robust;
  RefinementOptions refinement;
};

// An epipole for people: where it is, or in which direction.
std::string text_of_epipole(const Vec3& e) {
  if (std::abs(e.z()) * 1e9 < e.head<2>().norm())
    return fmt::format("at infinity along ({:.6g}, {:.6g})", e.x(), e.y());
  return fmt::format("({:.6g}, {:.6g}) px", e.x() / e.z(), e.y() / e.z());
}

Result<int> run(const Options& o, const Common& common) {
  if (Status s = check_answer(o.output, common); !s) return s.error();
  auto matches = load_matches(o.points);
  if (!matches) return matches.error();
  auto found = estimate_fundamental(*matches, o.robust, o.refinement, common);
  if (!found) return in_file(found.error(), o.points);
  const Epipoles e = epipoles(found->F);
  const auto n_inliers = std::count(found->inlier.begin(), found->inlier.end(), true);
  Json json{{"F", json_of_matrix(found->F)}, {"e1", json_of_vector(e.e1)},
            {"e2", json_of_vector(e.e2)},    {"inliers", n_inliers},
            {"n", matches->px1.size()},      {"outliers", json_of_unset(found->inlier)},
            {"rms_px", found->rms_px}};
  std::string text = text_of_matrix("F", found->F);
  text += fmt::format("epipole of image 1 {}, of image 2 {}\n", text_of_epipole(e.e1), text_of_epipole(e.e2));
  if (found->covariance) {
    json["sigma_px"] = found->sigma_px;
    json["covariance"] = json_of_matrix(*found->covariance);
  }
  if (found->solutions.size() > 1) {
    for (const Mat3& F : found->solutions) json["solutions"].push_back(json_of_matrix(F));
    text += fmt::format("{} matrices go through the seven rows; this is the first (--json has them all)\n",
                        found->solutions.size());
  }
  text += fmt::format("{} of {} rows, rms distance {:.4f} px (Sampson)\n", n_inliers, matches->px1.size(),
                      found->rms_px);
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_fundamental(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_points_option(app, o->points, "u1,v1,u2,v2");
  add_robust_options(app, o->robust, "distance from its epipolar line (Sampson)");
  add_refinement_options(app, o->refinement);
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

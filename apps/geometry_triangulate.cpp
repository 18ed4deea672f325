// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <numbers>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/io/transform_io.hpp"
#include "plumbline/linear/triangulate.hpp"
#include "plumbline/refine/point.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string points, output;
  std::vector<std::string> cameras, poses;
  RefinementOptions refinement;
};

// The cameras with their poses: of the rig, or of --pose files in the order of the cameras.
Result<std::vector<PosedLens>> load_posed(const Options& o) {
  auto rig = load_cameras(o.cameras);
  if (!rig) return rig.error();
  std::vector<PosedLens> posed;
  if (!o.poses.empty()) {
    // One camera that moved, or a pose for each.
    if (rig->cameras.size() != 1 && rig->cameras.size() != o.poses.size()) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("{} cameras and {} --pose files; a pose for each camera is needed",
                               rig->cameras.size(), o.poses.size()),
                   o.cameras.front()};
    }
    for (std::size_t i = 0; i < o.poses.size(); ++i) {
      auto text = read_file(o.poses[i]);
      if (!text) return text.error();
      auto T = parse_transform(*text);
      if (!T) return in_file(T.error(), o.poses[i]);
      posed.push_back({rig->cameras[rig->cameras.size() == 1 ? 0 : i].lens, *T});
    }
    return posed;
  }
  if (rig->cameras.size() < 2 || !poses_known(*rig)) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("{}; give a file of a rig with poses, or --pose T_cam_world.yaml for each view",
                             rig->cameras.size() < 2 ? "one camera, and two views are needed"
                                                     : "the files do not say where the cameras stand"),
                 o.cameras.front()};
  }
  for (std::size_t i = 0; i < rig->cameras.size(); ++i)
    posed.push_back({rig->cameras[i].lens, rig->T_cam_rig[i]});
  return posed;
}

// views[i][row]: where view i saw the point of the row.
Result<std::vector<std::vector<std::optional<Vec2>>>> load_views(const PointTable& table,
                                                                 std::size_t n_views) {
  std::vector<std::vector<std::optional<Vec2>>> views;
  for (std::size_t i = 1; i <= n_views; ++i) {
    auto view = seen_points_2d(table, fmt::format("u{}", i), fmt::format("v{}", i));
    if (!view) return view.error();
    views.push_back(*std::move(view));
  }
  if (table.find(fmt::format("u{}", n_views + 1))) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("there is a column u{}, and only {} cameras", n_views + 1, n_views), ""};
  }
  return views;
}

Result<Triangulated> point_of(const std::vector<PosedLens>& cameras, const std::vector<Vec2>& px,
                              const Options& o) {
  const double sigma = o.refinement.sigma_px > 0 ? o.refinement.sigma_px : 1.0;
  auto start = triangulate(cameras, px, sigma);
  if (!start || o.refinement.linear) return start;
  return refine_point(start->p_world, cameras, px, sigma);
}

// The answer row by row; rows that fail are null and say why.
struct Rows {
  Json points = Json::array(), covariance = Json::array(), sigma = Json::array(), angle = Json::array(),
       rms = Json::array(), reasons = Json::array();
  std::string text;
  int n_done = 0;
  std::optional<Error> first_error;
};

void add_row(Rows& rows, const Result<Triangulated>& point, int line) {
  if (!point) {
    for (Json* list : {&rows.points, &rows.covariance, &rows.sigma, &rows.angle, &rows.rms})
      list->push_back(nullptr);
    rows.reasons.push_back(point.error().text());
    rows.text += fmt::format("line {}: {}\n", line, point.error().text());
    if (!rows.first_error) rows.first_error = point.error();
    return;
  }
  const Vec3 sigma = point->covariance.diagonal().cwiseSqrt();
  const double angle_deg = point->ray_angle_rad * 180 / std::numbers::pi;
  rows.points.push_back(json_of_vector(point->p_world));
  rows.covariance.push_back(json_of_matrix(point->covariance));
  rows.sigma.push_back(json_of_vector(sigma));
  rows.angle.push_back(angle_deg);
  rows.rms.push_back(point->rms_px);
  rows.reasons.push_back(nullptr);
  rows.text += fmt::format("{} +- {}, rays at {:.3g} deg, {:.3g} px\n", text_of_vector(point->p_world),
                           text_of_vector(sigma, 2), angle_deg, point->rms_px);
  ++rows.n_done;
}

Result<int> run(const Options& o, const Common& common) {
  if (Status s = check_answer(o.output, common); !s) return s.error();
  auto cameras = load_posed(o);
  if (!cameras) return cameras.error();
  auto table = load_points(o.points);
  if (!table) return table.error();
  auto views = load_views(*table, cameras->size());
  if (!views) return in_file(views.error(), o.points);
  Rows rows;
  for (std::size_t r = 0; r < table->n_rows(); ++r) {
    std::vector<PosedLens> who;
    std::vector<Vec2> px;
    for (std::size_t i = 0; i < views->size(); ++i) {
      if (!(*views)[i][r]) continue;
      who.push_back((*cameras)[i]);
      px.push_back(*(*views)[i][r]);
    }
    add_row(rows, point_of(who, px, o), table->lines[r]);
  }
  // When no point has an answer, that is a failure; when some have, the others are named.
  if (rows.n_done == 0)
    return in_file(*rows.first_error, fmt::format("{}: line {}", o.points, table->lines[0]));
  const Json json{{"points", rows.points},       {"sigma", rows.sigma}, {"covariance", rows.covariance},
                  {"ray_angle_deg", rows.angle}, {"rms_px", rows.rms},  {"reasons", rows.reasons},
                  {"n_points", rows.n_done},     {"n", table->n_rows()}};
  rows.text += fmt::format("{} of {} points from {} views, sigma for {:g} px\n", rows.n_done, table->n_rows(),
                           views->size(), o.refinement.sigma_px > 0 ? o.refinement.sigma_px : 1.0);
  if (Status s = give_answer(json, rows.text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_triangulate(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_points_option(app, o->points,
                    "u1,v1,u2,v2 and so on, one pair for each view; '-' where it was not seen");
  add_camera_option(app, o->cameras,
                    "the cameras in the order of the columns: one file of a rig, or one each")
      ->required();
  app.add_option("--pose", o->poses,
                 "T_cam_world of each view (an answer of 'pose', or 12 numbers), in place of the rig's poses")
      ->allow_extra_args(false);
  add_refinement_options(app, o->refinement);
  app.get_option("--sigma")->description(
      "standard deviation of a pixel coordinate, for the covariance (default: 1 px)");
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

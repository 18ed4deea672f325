// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "geometry_camera_answer.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/refine/pose.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string points, output;
  std::vector<std::string> cameras;
  RobustOptions robust;
  RefinementOptions refinement;
};

struct Sights {
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;
};

struct Answer {
  SE3 T;
  std::vector<bool> inlier;  // of the sights
  double rms_px = 0, sigma_px = 0;
  std::optional<Mat6> covariance;
  std::optional<RefinedPose> other;  // of a flat target that two poses explain
};

double rms_px(const SE3& T, const Lens& lens, const Sights& s) {
  double sum = 0;
  for (std::size_t i = 0; i < s.px.size(); ++i) {
    const auto px = project(lens, T * s.p_world[i]);
    if (px) sum += (*px - s.px[i]).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(s.px.size()));
}

// The second pose of a flat target, where the image does not tell it from the first: its sum of squares is
// larger by less than nine squared sigmas, which is what three sigmas of one direction make.
std::optional<RefinedPose> other_pose(const RefinedPose& best, const Lens& lens, const Sights& s) {
  std::vector<Vec3> rays;
  for (const Vec2& px : s.px) rays.push_back(*unproject(lens, px));
  const auto planar = pose_planar(s.p_world, rays);
  if (!planar || !planar->other) return std::nullopt;
  const double n = static_cast<double>(s.px.size());
  const double sigma = sigma_of_residuals(n * best.rms_px * best.rms_px, 2 * static_cast<int>(n), 6);
  for (const SE3& start : {planar->best.T_cam_board, planar->other->T_cam_board}) {
    auto refined = refine_pose(start, lens, s.p_world, s.px, 1.0);
    if (!refined || box_minus(refined->T_cam_world, best.T_cam_world).head<3>().norm() < 1e-3) continue;
    const double more = n * (refined->rms_px * refined->rms_px - best.rms_px * best.rms_px);
    if (more < 9 * sigma * sigma) return *refined;
  }
  return std::nullopt;
}

Result<Answer> estimate(const Lens& lens, const Sights& all, const Options& o, const Common& common) {
  Answer answer;
  Sights kept = all;
  if (o.robust.ransac) {
    auto found = pose_ransac(lens, all.p_world, all.px, ransac_options(o.robust, common));
    if (!found) return found.error();
    answer.T = found->model;
    answer.inlier = found->consensus.inlier;
    kept = {chosen(all.p_world, answer.inlier), chosen(all.px, answer.inlier)};
  } else {
    auto T = pose_from_points(lens, all.p_world, all.px);
    if (!T) return T.error();
    answer.T = *T;
    answer.inlier.assign(all.px.size(), true);
  }
  answer.rms_px = rms_px(answer.T, lens, kept);
  if (o.refinement.linear) return answer;
  auto refined = refine_pose(answer.T, lens, kept.p_world, kept.px, 1.0);
  if (!refined) return refined.error();
  const int n = static_cast<int>(kept.px.size());
  answer.T = refined->T_cam_world;
  answer.rms_px = refined->rms_px;
  answer.sigma_px = o.refinement.sigma_px > 0
                        ? o.refinement.sigma_px
                        : sigma_of_residuals(n * refined->rms_px * refined->rms_px, 2 * n, 6);
  if (answer.sigma_px > 0) answer.covariance = refined->covariance * answer.sigma_px * answer.sigma_px;
  answer.other = other_pose(*refined, lens, kept);
  return answer;
}

std::string text_of(const Answer& a, const Camera& camera, std::size_t n_rows) {
  const Vec3 w_deg = so3_log(a.T.R()) * 180 / std::numbers::pi;
  std::string text = text_of_matrix("R", a.T.R());
  text += fmt::format("t = {}\nC = {}\nrotation vector {} deg\n", text_of_vector(a.T.t()),
                      text_of_vector(a.T.centre()), text_of_vector(w_deg));
  if (a.covariance) {
    const Vec6 s = a.covariance->diagonal().cwiseSqrt();
    text += fmt::format("sigma: rotation {} deg, translation {}, for {:.3g} px\n",
                        text_of_vector(s.head<3>() * 180 / std::numbers::pi, 2),
                        text_of_vector(s.tail<3>(), 2), a.sigma_px);
  }
  text += fmt::format("camera {}: {} of {} points, rms {:.4f} px\n", camera.name,
                      std::count(a.inlier.begin(), a.inlier.end(), true), n_rows, a.rms_px);
  if (a.other) {
    text += fmt::format(
        "a second pose explains this flat target nearly as well: rotation vector {} deg, rms "
        "{:.4f} px\n",
        text_of_vector(so3_log(a.other->T_cam_world.R()) * 180 / std::numbers::pi), a.other->rms_px);
  }
  return text;
}

Result<int> run(const Options& o, const Common& common) {
  if (Status s = check_answer(o.output, common); !s) return s.error();
  auto camera = load_camera(o.cameras);
  if (!camera) return camera.error();
  auto table = load_points(o.points);
  if (!table) return table.error();
  auto p_world = points_3d(*table, "X", "Y", "Z");
  if (!p_world) return in_file(p_world.error(), o.points);
  auto px = points_2d(*table, "u", "v");
  if (!px) return in_file(px.error(), o.points);
  std::vector<bool> seen;
  for (const Vec2& p : *px) seen.push_back(unproject(camera->lens, p).has_value());
  auto answer = estimate(camera->lens, {chosen(*p_world, seen), chosen(*px, seen)}, o, common);
  if (!answer) return in_file(answer.error(), o.points);

  Json json = json_of_camera(camera_matrix_k(camera->lens), answer->T);
  json["rms_px"] = answer->rms_px;
  if (answer->covariance) {
    json["sigma"] = json_of_vector(answer->covariance->diagonal().cwiseSqrt());
    json["covariance"] = json_of_matrix(*answer->covariance);
    json["sigma_px"] = answer->sigma_px;
  }
  const auto inlier = spread(answer->inlier, seen);
  json["inliers"] = std::count(inlier.begin(), inlier.end(), true);
  json["n"] = px->size();
  json["outliers"] = json_of_unset(inlier);
  json["outside_lens"] = json_of_unset(seen);
  if (answer->other) {
    json["other"] = {{"R", json_of_matrix(answer->other->T_cam_world.R())},
                     {"t", json_of_vector(answer->other->T_cam_world.t())},
                     {"rms_px", answer->other->rms_px}};
  }
  const std::string text = text_of(*answer, *camera, px->size()) + text_of_outside(seen, table->lines);
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_pose(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_points_option(app, o->points, "X,Y,Z,u,v");
  add_camera_option(app, o->cameras, "the camera that took the pixels")->required();
  add_robust_options(app, o->robust, "reprojection error");
  add_refinement_options(app, o->refinement);
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

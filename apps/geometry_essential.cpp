// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <numbers>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "geometry_camera_answer.hpp"
#include "geometry_views.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/essential.hpp"
#include "plumbline/refine/relative_pose.hpp"

namespace plumbline::apps {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

struct Options {
  std::string points, output;
  std::vector<std::string> cameras;
  RobustOptions robust;
  RefinementOptions refinement;
};

struct Answer {
  SE3 T_2_1;
  std::vector<bool> inlier;
  int n_in_front = 0;
  double rms_px = -1, sigma_px = 0;
  std::optional<Mat6> covariance;
};

Result<Answer> estimate(const Matches& m, const Lens& lens_1, const Lens& lens_2, const Options& o,
                        const Common& common) {
  Answer answer;
  Matches kept = m;
  const std::size_t least = o.robust.ransac ? 6 : 8;
  if (m.px1.size() < least) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("{} rows that both lenses see; at least {} are needed{}", m.px1.size(), least,
                             o.robust.ransac ? "" : " (6 with --ransac)"),
                 ""};
  }
  if (o.robust.ransac) {
    auto found = essential_ransac(lens_1, lens_2, m.px1, m.px2, ransac_options(o.robust, common));
    if (!found) return found.error();
    answer.T_2_1 = found->model.T_2_1;
    answer.n_in_front = found->model.n_in_front;
    answer.inlier = found->consensus.inlier;
    answer.rms_px = found->consensus.rms_px;
    kept = {chosen(m.px1, answer.inlier), chosen(m.px2, answer.inlier)};
  } else {
    std::vector<Vec3> rays_1, rays_2;
    for (std::size_t i = 0; i < m.px1.size(); ++i) {
      rays_1.push_back(*unproject(lens_1, m.px1[i]));
      rays_2.push_back(*unproject(lens_2, m.px2[i]));
    }
    auto E = essential_8point(rays_1, rays_2);
    if (!E) return E.error();
    auto pose = relative_pose_from_essential(*E, rays_1, rays_2);
    if (!pose) return pose.error();
    answer.T_2_1 = pose->T_2_1;
    answer.n_in_front = pose->n_in_front;
    answer.inlier.assign(m.px1.size(), true);
  }
  if (o.refinement.linear) return answer;
  auto refined = refine_relative_pose(answer.T_2_1, lens_1, lens_2, kept.px1, kept.px2, 1.0);
  if (!refined) return refined.error();
  const int n = static_cast<int>(kept.px1.size());
  answer.T_2_1 = refined->T_2_1;
  answer.rms_px = refined->rms_px;
  answer.sigma_px = o.refinement.sigma_px > 0
                        ? o.refinement.sigma_px
                        : sigma_of_residuals(n * refined->rms_px * refined->rms_px, n, 5);
  if (answer.sigma_px > 0) answer.covariance = refined->covariance * answer.sigma_px * answer.sigma_px;
  return answer;
}

std::string text_of(const Answer& a, std::size_t n_rows) {
  const Vec3 w = so3_log(a.T_2_1.R());
  std::string text = text_of_matrix("E", essential_from_pose(a.T_2_1)) + text_of_matrix("R", a.T_2_1.R());
  text += fmt::format(
      "t = {} (its length is not known)\nrotation vector {} deg, {:.6g} deg in all; centre of camera 2 from "
      "camera "
      "1: direction {}\n",
      text_of_vector(a.T_2_1.t()), text_of_vector(w * kDegPerRad), w.norm() * kDegPerRad,
      text_of_vector(a.T_2_1.centre()));
  if (a.covariance) {
    const Vec6 s = a.covariance->diagonal().cwiseSqrt();
    text += fmt::format("sigma: rotation {} deg, direction {} deg, for {:.3g} px\n",
                        text_of_vector(s.head<3>() * kDegPerRad, 2),
                        text_of_vector(s.tail<3>() * kDegPerRad, 2), a.sigma_px);
  }
  text += fmt::format("{} of {} rows", std::count(a.inlier.begin(), a.inlier.end(), true), n_rows);
  if (a.rms_px >= 0) text += fmt::format(", rms {:.4f} px", a.rms_px);
  return text + fmt::format("; {} points in front of both cameras\n", a.n_in_front);
}

Result<int> run(const Options& o, const Common& common) {
  if (Status s = check_answer(o.output, common); !s) return s.error();
  auto cameras = load_camera_pair(o.cameras);
  if (!cameras) return cameras.error();
  auto table = load_points(o.points);
  if (!table) return table.error();
  auto matches = matches_of(*table);
  if (!matches) return in_file(matches.error(), o.points);
  const auto& [camera_1, camera_2] = *cameras;
  const SeenMatches seen = seen_matches(*matches, camera_1.lens, camera_2.lens);
  auto answer = estimate(seen.matches, camera_1.lens, camera_2.lens, o, common);
  if (!answer) return in_file(answer.error(), o.points);
  const auto inlier = spread(answer->inlier, seen.seen);
  Json json{{"E", json_of_matrix(essential_from_pose(answer->T_2_1))},
            {"R", json_of_matrix(answer->T_2_1.R())},
            {"t", json_of_vector(answer->T_2_1.t())},
            {"scale", "unknown: |t| = 1"},
            {"inliers", std::count(inlier.begin(), inlier.end(), true)},
            {"in_front", answer->n_in_front},
            {"n", matches->px1.size()},
            {"outliers", json_of_unset(inlier)},
            {"outside_lens", json_of_unset(seen.seen)}};
  if (answer->rms_px >= 0) json["rms_px"] = answer->rms_px;
  if (answer->covariance) {
    json["sigma_px"] = answer->sigma_px;
    json["sigma"] = json_of_vector(answer->covariance->diagonal().cwiseSqrt());
    json["covariance"] = json_of_matrix(*answer->covariance);
  }
  const std::string text = text_of(*answer, matches->px1.size()) + text_of_outside(seen.seen, table->lines);
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_essential(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_points_option(app, o->points, "u1,v1,u2,v2");
  add_camera_option(app, o->cameras, "both cameras, or the one that took both views")->required();
  add_robust_options(app, o->robust, "distance from its epipolar line (Sampson)");
  add_refinement_options(app, o->refinement);
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

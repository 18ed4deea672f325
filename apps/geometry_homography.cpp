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
#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/plane_motion.hpp"
#include "plumbline/linear/rotation_only.hpp"
#include "plumbline/refine/homography.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string points, output;
  std::vector<std::string> cameras;
  RobustOptions robust;
  RefinementOptions refinement;
};

struct Answer {
  Mat3 H;
  std::vector<bool> inlier;
  double rms_px = 0, sigma_px = 0;
  std::optional<MatX> covariance;
};

double rms_px(const Mat3& H, const Matches& m) {
  double sum = 0;
  for (std::size_t i = 0; i < m.px1.size(); ++i)
    sum += ((H * m.px1[i].homogeneous()).hnormalized() - m.px2[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(m.px1.size()));
}

Result<Answer> estimate(const Matches& m, const Options& o, const Common& common) {
  if (m.px1.size() < 4) {
    return Error{ErrorCode::kDegenerate, fmt::format("{} rows; a homography needs at least 4", m.px1.size()),
                 ""};
  }
  Answer answer;
  Matches kept = m;
  if (o.robust.ransac) {
    auto found = homography_ransac(m.px1, m.px2, ransac_options(o.robust, common));
    if (!found) return found.error();
    answer.H = found->model;
    answer.inlier = found->consensus.inlier;
    kept = {chosen(m.px1, answer.inlier), chosen(m.px2, answer.inlier)};
  } else {
    auto H = homography(m.px1, m.px2);
    if (!H) return H.error();
    answer.H = *H;
    answer.inlier.assign(m.px1.size(), true);
  }
  answer.rms_px = rms_px(answer.H, kept);
  if (o.refinement.linear) return answer;
  auto refined = refine_homography(answer.H, kept.px1, kept.px2, 1.0, HomographyNoise::kBoth);
  if (!refined) return refined.error();
  // Noise in both images: each row has four equations and brings two unknowns, the point itself.
  const int n = static_cast<int>(kept.px1.size());
  answer.H = refined->H;
  answer.rms_px = rms_px(answer.H, kept);
  answer.sigma_px = o.refinement.sigma_px > 0
                        ? o.refinement.sigma_px
                        : sigma_of_residuals(n * refined->rms_px * refined->rms_px, 2 * n, 8);
  if (answer.sigma_px > 0) answer.covariance = refined->covariance * answer.sigma_px * answer.sigma_px;
  return answer;
}

// A pixel as a pinhole of the lens' K shows it, because only those obey a homography; nullopt where that
// pinhole sees nothing.
std::optional<Vec2> undistorted(const Lens& lens, const Vec2& px) {
  const auto ray = unproject(lens, px);
  if (!ray || !(ray->z() > 0)) return std::nullopt;
  return Vec2((camera_matrix_k(lens) * *ray).hnormalized());
}

SeenMatches undistorted(const Matches& all, const std::array<Camera, 2>& cameras) {
  SeenMatches out;
  for (std::size_t i = 0; i < all.px1.size(); ++i) {
    const auto a = undistorted(cameras[0].lens, all.px1[i]), b = undistorted(cameras[1].lens, all.px2[i]);
    out.seen.push_back(a && b);
    if (!a || !b) continue;
    out.matches.px1.push_back(*a);
    out.matches.px2.push_back(*b);
  }
  return out;
}

// The rotation of a camera that only turned, where it leaves no more per degree of freedom than H does: five
// parameters fewer must not cost more than an F-test at one in a thousand allows (its quantiles are near
// `critical`). Without noise both leave nothing, and what is left of rounding does not count.
std::optional<Mat3> turn_alone(const Mat3& H, const Matches& kept, const Mat3& K1, const Mat3& K2) {
  const int n = static_cast<int>(kept.px1.size()), freedom = 2 * n - 8;
  std::vector<Vec3> rays_1, rays_2;
  for (std::size_t i = 0; i < kept.px1.size(); ++i) {
    rays_1.push_back((K1.inverse() * kept.px1[i].homogeneous()).normalized());
    rays_2.push_back((K2.inverse() * kept.px2[i].homogeneous()).normalized());
  }
  const auto turn = rotation_from_rays(rays_1, rays_2);
  if (!turn) return std::nullopt;
  const double rms_turn = rms_px(rotation_homography(K1, K2, turn->R_2_1), kept), rms_h = rms_px(H, kept);
  constexpr double kRounding_px = 1e-6;
  if (rms_turn < kRounding_px) return turn->R_2_1;
  if (freedom <= 0) return std::nullopt;
  const double more = n * (rms_turn * rms_turn - rms_h * rms_h) / 5,
               per_freedom = n * rms_h * rms_h / freedom;
  const double critical = 4.1 * (1 + 13.0 / freedom + 60.0 / (freedom * freedom));
  if (more > critical * per_freedom) return std::nullopt;
  return turn->R_2_1;
}

// What H says of the motion, for people and for programs.
Status add_motion(const Answer& answer, const Matches& kept, const std::array<Camera, 2>& cameras, Json& json,
                  std::string& text) {
  const Mat3 K1 = camera_matrix_k(cameras[0].lens), K2 = camera_matrix_k(cameras[1].lens);
  if (const auto R = turn_alone(answer.H, kept, K1, K2)) {
    json["rotation_only"] = true;
    json["R"] = json_of_matrix(*R);
    text += text_of_matrix("R", *R) +
            fmt::format("the camera only turned, by {:.6g} deg: no plane and no translation follow\n",
                        rotation_angle(*R) * 180 / std::numbers::pi);
    return {};
  }
  auto motions = plane_motions(answer.H, K1, K2);
  if (!motions) return motions.error();
  const auto visible = visible_plane_motions(*motions, K1, kept.px1);
  json["rotation_only"] = false;
  json["motions"] = Json::array();
  for (const PlaneMotion& m : visible) {
    json["motions"].push_back({{"R", json_of_matrix(m.R)},
                               {"t_over_d", json_of_vector(m.t_over_d)},
                               {"n", json_of_vector(m.normal_1)}});
    text += text_of_matrix("R", m.R) +
            fmt::format("t/d = {}, n = {}\n", text_of_vector(m.t_over_d), text_of_vector(m.normal_1));
  }
  text += fmt::format("{} motion{} put{} all points before both cameras\n", visible.size(),
                      visible.size() == 1 ? "" : "s", visible.size() == 1 ? "s" : "");
  if (visible.size() == 1) {
    json["R"] = json["motions"][0]["R"];
    json["t_over_d"] = json["motions"][0]["t_over_d"];
    json["n"] = json["motions"][0]["n"];
  }
  return {};
}

Result<int> run(const Options& o, const Common& common) {
  if (Status s = check_answer(o.output, common); !s) return s.error();
  std::optional<std::array<Camera, 2>> cameras;
  if (!o.cameras.empty()) {
    auto pair = load_camera_pair(o.cameras);
    if (!pair) return pair.error();
    cameras = *pair;
  }
  auto table = load_points(o.points);
  if (!table) return table.error();
  auto all = matches_of(*table);
  if (!all) return in_file(all.error(), o.points);
  const SeenMatches seen =
      cameras ? undistorted(*all, *cameras) : SeenMatches{*all, std::vector<bool>(all->px1.size(), true)};
  auto answer = estimate(seen.matches, o, common);
  if (!answer) return in_file(answer.error(), o.points);
  const auto inlier = spread(answer->inlier, seen.seen);
  const auto n_inliers = std::count(inlier.begin(), inlier.end(), true);
  Json json{{"H", json_of_matrix(answer->H)}, {"inliers", n_inliers},
            {"n", all->px1.size()},           {"outliers", json_of_unset(inlier)},
            {"rms_px", answer->rms_px},       {"undistorted", cameras.has_value()}};
  if (answer->covariance) {
    json["sigma_px"] = answer->sigma_px;
    json["covariance"] = json_of_matrix(*answer->covariance);
  }
  std::string text = text_of_matrix("H", answer->H);
  if (cameras) {
    json["outside_lens"] = json_of_unset(seen.seen);
    const Matches kept{chosen(seen.matches.px1, answer->inlier), chosen(seen.matches.px2, answer->inlier)};
    if (Status s = add_motion(*answer, kept, *cameras, json, text); !s) return in_file(s.error(), o.points);
  }
  text += fmt::format("{} of {} rows, rms distance in image 2 {:.4f} px{}\n", n_inliers, all->px1.size(),
                      answer->rms_px, cameras ? ", of undistorted pixels" : "");
  text += text_of_outside(seen.seen, table->lines);
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_homography(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_points_option(app, o->points, "u1,v1,u2,v2");
  add_camera_option(
      app, o->cameras,
      "both cameras, or the one that took both views; then H is of undistorted pixels and R, t/d, n "
      "follow");
  add_robust_options(app, o->robust, "distance in image 2");
  add_refinement_options(app, o->refinement);
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

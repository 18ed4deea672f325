// SPDX-License-Identifier: Apache-2.0
#include "calibrate_report.hpp"

#include <fmt/format.h>

#include <numbers>

#include "calibrate_effects.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline::apps {
namespace {

int views_used(const Calibration& c, int cam) {
  int n = 0;
  for (std::size_t v = 0; v < c.data.views.size(); ++v)
    n += c.data.views[v].cam == cam && c.view_reason[v].empty();
  return n;
}

int images_of(const Calibration& c, int cam) {
  int n = 0;
  for (const View& view : c.data.views) n += view.cam == cam;
  return n;
}

constexpr double kDegPerRad = 180 / std::numbers::pi;

Json json_of_validity(const Camera& camera) {
  if (!camera.validity) return nullptr;
  return {{"angle_deg", camera.validity->angle_rad * kDegPerRad}, {"radius_px", camera.validity->radius_px}};
}

Json json_of_cameras(const Calibration& c) {
  Json cameras = Json::array();
  for (std::size_t i = 0; i < c.rig.cameras.size(); ++i) {
    const Camera& camera = c.rig.cameras[i];
    Json parameters;
    const auto names = param_names(camera.lens);
    for (std::size_t k = 0; k < names.size(); ++k) parameters[names[k]] = params(camera.lens)[k];
    const int cam = static_cast<int>(i);
    cameras.push_back({{"name", camera.name},
                       {"lens", lens_spec(camera.lens)},
                       {"width", camera.size.width},
                       {"height", camera.size.height},
                       {"params", parameters},
                       {"rms_px", camera_rms_px(c, cam)},
                       {"views_used", views_used(c, cam)},
                       {"images", images_of(c, cam)},
                       {"domain_fraction", domain_fraction(camera)},
                       {"validity", json_of_validity(camera)}});
  }
  return cameras;
}

Json json_of_views(const Calibration& c) {
  Json views = Json::array();
  for (std::size_t v = 0; v < c.data.views.size(); ++v) {
    const View& view = c.data.views[v];
    const bool used = c.view_reason[v].empty();
    Json item{{"camera", c.data.cameras[view.cam].name},
              {"image", view.image},
              {"frame", c.data.frames[view.frame]},
              {"used", used},
              {"corners", view.corners.size()}};
    if (c.data.targets.size() > 1) item["target"] = c.data.targets[view.target].name;
    item["rms_px"] = used ? Json(view_rms_px(c, static_cast<int>(v))) : Json(nullptr);
    item["reason"] = used ? Json(nullptr) : Json(c.view_reason[v]);
    views.push_back(item);
  }
  return views;
}

std::string matrix_text(const char* name, const MatX& M) {
  std::string text;
  for (int r = 0; r < M.rows(); ++r) {
    text += r == 0 ? fmt::format("  {:>2} = ", name) : std::string(7, ' ');
    for (int c = 0; c < M.cols(); ++c) text += fmt::format("{:>16.8g}", M(r, c));
    text += "\n";
  }
  return text;
}

// A target that is a body in space determines the camera matrix in each view alone, and it is what one wants
// to see.
bool shows_camera_matrix(const Calibration& c) {
  return std::any_of(c.data.targets.begin(), c.data.targets.end(),
                     [](const Target& target) { return !target.is_planar; });
}

Json json_of_camera_matrices(const Calibration& c) {
  Json list = Json::array();
  const auto rows = [](const MatX& M) {
    Json matrix = Json::array();
    for (int r = 0; r < M.rows(); ++r) {
      Json row = Json::array();
      for (int k = 0; k < M.cols(); ++k) row.push_back(M(r, k));
      matrix.push_back(row);
    }
    return matrix;
  };
  for (std::size_t v = 0; v < c.data.views.size(); ++v) {
    const View& view = c.data.views[v];
    if (!c.view_reason[v].empty() || !c.T_rig_board[view.frame]) continue;
    const SE3 T_cam_board = c.rig.T_cam_rig[view.cam] * *board_pose(c, view);
    const Mat3 K = camera_matrix_k(c.rig.cameras[view.cam].lens);
    list.push_back({{"camera", c.data.cameras[view.cam].name},
                    {"image", view.image},
                    {"P", rows(K * T_cam_board.matrix34())},
                    {"K", rows(K)},
                    {"R", rows(T_cam_board.R())},
                    {"t", rows(T_cam_board.t().transpose())[0]},
                    {"C", rows(T_cam_board.centre().transpose())[0]}});
  }
  return list;
}

std::string text_of_camera_matrices(const Calibration& c) {
  std::string text;
  for (std::size_t v = 0; v < c.data.views.size(); ++v) {
    const View& view = c.data.views[v];
    if (!c.view_reason[v].empty() || !c.T_rig_board[view.frame]) continue;
    const SE3 T_cam_board = c.rig.T_cam_rig[view.cam] * *board_pose(c, view);
    const Mat3 K = camera_matrix_k(c.rig.cameras[view.cam].lens);
    text += fmt::format(
        "{}, camera {}: P = K [R | t], refined, before distortion; t and the centre C in metres\n",
        view.image, c.data.cameras[view.cam].name);
    text += matrix_text("P", K * T_cam_board.matrix34()) + matrix_text("K", K) +
            matrix_text("R", T_cam_board.R()) + matrix_text("t", T_cam_board.t().transpose()) +
            matrix_text("C", T_cam_board.centre().transpose());
  }
  return text;
}

// An image in which this board was looked for and not found, but another one was used: nothing to report.
bool shows_another_board(const Calibration& c, std::size_t v) {
  const View& view = c.data.views[v];
  if (c.data.targets.size() == 1 || !view.corners.empty()) return false;
  for (std::size_t other = 0; other < c.data.views.size(); ++other) {
    const View& o = c.data.views[other];
    if (o.cam == view.cam && o.frame == view.frame && c.view_reason[other].empty()) return true;
  }
  return false;
}

std::string text_of_pose(const std::string& of, const std::string& from, const SE3& T) {
  const Vec3 w_deg = so3_log(T.R()) * kDegPerRad;
  return fmt::format(
      "{} from {}: rotation vector ({:.4f}, {:.4f}, {:.4f}) deg, translation ({:.6f}, {:.6f}, {:.6f}) m, "
      "distance {:.6f} m\n",
      of, from, w_deg.x(), w_deg.y(), w_deg.z(), T.t().x(), T.t().y(), T.t().z(), T.t().norm());
}

Json json_of_tries(const std::vector<LensTry>& tries) {
  Json list = Json::array();
  for (const LensTry& t : tries) {
    Json row{{"camera", t.camera}, {"lens", t.lens}, {"parameters", t.n_params}, {"chosen", t.chosen}};
    const bool fitted = t.rms_px > 0, compared = t.held_out_px > 0;
    row["rms_px"] = fitted ? Json(t.rms_px) : Json(nullptr);
    row["held_out_px"] = compared ? Json(t.held_out_px) : Json(nullptr);
    row["excess"] = compared ? Json(t.excess) : Json(nullptr);
    row["excess_sigma"] = compared ? Json(t.excess_sigma) : Json(nullptr);
    row["reason"] = t.reason.empty() ? Json(nullptr) : Json(t.reason);
    list.push_back(row);
  }
  return list;
}

std::string text_of_tries(const std::vector<LensTry>& tries) {
  std::string text, camera;
  for (const LensTry& t : tries) {
    if (t.camera != camera || text.empty())
      text += fmt::format("{}: lenses tried (error on views left out; how much more of it than the best)\n",
                          t.camera);
    camera = t.camera;
    text += fmt::format("{} {:<9} {:>2} parameters  ", t.chosen ? " *" : "  ", t.lens, t.n_params);
    if (t.rms_px > 0) text += fmt::format("rms {:.4f} px  ", t.rms_px);
    if (t.held_out_px > 0) {
      text += fmt::format("left out {:.4f} px  {:+.2f} % +- {:.2f} %", t.held_out_px, 100 * t.excess,
                          100 * t.excess_sigma);
    }
    text += t.reason + "\n";
  }
  return text;
}

}  // namespace

Json json_of_calibration(const Calibration& c) {
  Json json{{"rms_px", c.stats.rms_px},           {"rms_xy_px", c.stats.rms_xy_px},
            {"corners", c.stats.n_corners},       {"outliers", c.stats.n_outliers},
            {"converged", c.stats.converged},     {"iterations", c.stats.iterations},
            {"termination", c.stats.termination}, {"cameras", json_of_cameras(c)}};
  json["T_cam_rig"] = Json::array();
  for (std::size_t i = 0; i < c.rig.cameras.size(); ++i) {
    json["T_cam_rig"].push_back({{"camera", c.rig.cameras[i].name}, {"T", json_of(c.rig.T_cam_rig[i])}});
  }
  if (c.data.targets.size() > 1) {
    json["T_board0_board"] = Json::array();
    for (std::size_t i = 0; i < c.data.targets.size(); ++i) {
      json["T_board0_board"].push_back(
          {{"target", c.data.targets[i].name}, {"T", json_of(c.T_board0_board[i])}});
    }
  }
  add_effects(c, json);
  json["views"] = json_of_views(c);
  json["weak"] = Json::array();
  for (const WeakDirection& w : c.stats.weak) {
    json["weak"].push_back(
        {{"parameters", w.parameters}, {"sigma", w.sigma}, {"consequence", w.consequence}});
  }
  if (!c.provenance.lens_tries.empty()) json["lens_tries"] = json_of_tries(c.provenance.lens_tries);
  for (const PriorPull& p : c.stats.priors) {
    json["priors"].push_back(
        {{"parameter", p.parameter}, {"value", p.value}, {"sigma", p.sigma}, {"pull_sigmas", p.pull_sigmas}});
  }
  if (shows_camera_matrix(c)) json["camera_matrices"] = json_of_camera_matrices(c);
  json["detector"] = c.data.detector;
  return json;
}

std::string text_of_calibration(const Calibration& c) {
  std::string text = text_of_tries(c.provenance.lens_tries);
  int k = 0;  // index into the covariance
  for (std::size_t i = 0; i < c.rig.cameras.size(); ++i) {
    const Camera& camera = c.rig.cameras[i];
    const int cam = static_cast<int>(i);
    text +=
        fmt::format("{}: {} {}x{}, {} of {} {} used, rms {:.4f} px\n", camera.name, lens_spec(camera.lens),
                    camera.size.width, camera.size.height, views_used(c, cam), images_of(c, cam),
                    c.data.targets.size() > 1 ? "views of boards" : "images", camera_rms_px(c, cam));
    const auto names = param_names(camera.lens);
    for (std::size_t p = 0; p < names.size(); ++p, ++k) {
      if (p >= 4 && is_sparse(camera.lens)) {
        text += fmt::format("  and {} control points\n", (names.size() - p) / 2);
        k += static_cast<int>(names.size() - p);
        break;
      }
      text += fmt::format("  {:<3} {:>14.8g}", names[p], params(camera.lens)[p]);
      if (c.covariance && (*c.covariance)(k, k) >= 0)
        text += fmt::format("  +- {:.2g}", std::sqrt((*c.covariance)(k, k)));
      text += "\n";
    }
  }
  for (std::size_t i = 1; i < c.rig.cameras.size(); ++i)
    text += text_of_pose(c.rig.cameras[i].name, c.rig.cameras[0].name, c.rig.T_cam_rig[i]);
  if (const auto joined = c.provenance.options.find("joined by motion"); joined != c.provenance.options.end())
    text += fmt::format("joined by motion alone: {}\n", joined->second);
  for (std::size_t i = 1; i < c.data.targets.size(); ++i)
    text += text_of_pose(c.data.targets[i].name, c.data.targets[0].name, c.T_board0_board[i].inverse());
  text += text_of_effects(c);
  for (const Camera& camera : c.rig.cameras) {
    const double fraction = domain_fraction(camera);
    if (camera.validity) {
      text += fmt::format(
          "{}: the calibration holds up to {:.2f} degrees from the axis, {:.0f} px from the centre; {:.1f} % "
          "of "
          "the image lies beyond\n",
          camera.name, camera.validity->angle_rad * kDegPerRad, camera.validity->radius_px,
          100 * (1 - fraction));
    } else if (fraction < 1) {
      text += fmt::format(
          "{}: the lens says nothing about {:.1f} % of the image: its domain ends inside the picture\n",
          camera.name, 100 * (1 - fraction));
    }
  }
  if (shows_camera_matrix(c)) text += text_of_camera_matrices(c);
  for (std::size_t v = 0; v < c.data.views.size(); ++v) {
    if (c.view_reason[v].empty() || shows_another_board(c, v)) continue;
    const View& view = c.data.views[v];
    text += fmt::format("not used: {}{}: {}\n", view.image,
                        c.data.targets.size() > 1 ? ", " + c.data.targets[view.target].name : "",
                        c.view_reason[v]);
  }
  if (!c.data.detector.empty()) text += c.data.detector + "\n";
  text += fmt::format(
      "rms {:.6f} px over {} corners ({:.6f} px per coordinate), {} outliers; {} iterations: {}\n",
      c.stats.rms_px, c.stats.n_corners, c.stats.rms_xy_px, c.stats.n_outliers, c.stats.iterations,
      c.stats.termination);
  for (const PriorPull& p : c.stats.priors)
    text += fmt::format("prior: {} = {:.8g} +- {:.3g}: the estimate is {:+.2f} sigmas from it\n", p.parameter,
                        p.value, p.sigma, p.pull_sigmas);
  for (const WeakDirection& w : c.stats.weak)
    text += fmt::format("WEAK: {}: {}\n", w.parameters, w.consequence);
  return text;
}

}  // namespace plumbline::apps

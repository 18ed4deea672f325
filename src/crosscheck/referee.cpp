// SPDX-License-Identifier: Apache-2.0
#include "crosscheck/referee.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "plumbline/geometry/so3.hpp"

namespace plumbline::detail {
namespace {

// mrcal's poses are a rotation vector and a translation: p_a = exp(r) p_b + t.
mrcal_pose_t to_mrcal(const SE3& T) {
  const Vec3 r = so3_log(T.R()), t = T.t();
  mrcal_pose_t pose{};
  std::copy_n(r.data(), 3, pose.r.xyz);
  std::copy_n(t.data(), 3, pose.t.xyz);
  return pose;
}

SE3 from_mrcal(const mrcal_pose_t& pose) {
  return SE3(so3_exp(Vec3(pose.r.xyz[0], pose.r.xyz[1], pose.r.xyz[2])),
             Vec3(pose.t.xyz[0], pose.t.xyz[1], pose.t.xyz[2]));
}

// Root mean square over the corners that take part, the weights taken out again.
double rms_of(const Problem& problem, const std::vector<double>& x) {
  double sum = 0;
  int n = 0;
  for (std::size_t i = 0; i < problem.pool.size(); ++i) {
    const double weight = problem.pool[i].xyz[2];
    if (!(weight > 0)) continue;
    sum += (x[2 * i] * x[2 * i] + x[2 * i + 1] * x[2 * i + 1]) / (weight * weight);
    ++n;
  }
  return n > 0 ? std::sqrt(sum / n) : 0.0;
}

}  // namespace

std::optional<RefereeLens> same_lens(const Lens& lens) {
  RefereeLens out;
  if (lens_name(lens) == "pinhole")
    out.name = "LENSMODEL_PINHOLE";
  else if (lens_name(lens).starts_with("opencv"))
    out.name = "LENSMODEL_OPENCV" + std::string(lens_name(lens).substr(6));
  else if (const auto* splined = std::get_if<Splined>(&lens))
    out.name = fmt::format("LENSMODEL_SPLINED_STEREOGRAPHIC_order={}_Nx={}_Ny={}_fov_x_deg={}",
                           splined->order, splined->n_x, splined->n_y, splined->fov_x_deg);
  else
    return std::nullopt;
  if (!mrcal_lensmodel_from_name(&out.model, out.name.c_str())) return std::nullopt;
  const auto k = params(lens);
  if (mrcal_lensmodel_num_params(&out.model) != static_cast<int>(k.size())) return std::nullopt;
  out.parameters.assign(k.begin(), k.end());
  return out;
}

Projection projection_of(const RefereeLens& lens) {
  return [&lens](const Vec3& p, Mat23* J) -> std::optional<Vec2> {
    mrcal_point3_t point{}, gradient[2]{};
    mrcal_point2_t px{};
    std::copy_n(p.data(), 3, point.xyz);
    if (!mrcal_project(&px, J ? gradient : nullptr, nullptr, &point, 1, &lens.model,
                       lens.parameters.data())) {
      return std::nullopt;
    }
    if (J) {
      for (int r = 0; r < 2; ++r) {
        for (int c = 0; c < 3; ++c) (*J)(r, c) = gradient[r].xyz[c];
      }
    }
    const Vec2 q(px.xy[0], px.xy[1]);
    if (!q.allFinite()) return std::nullopt;
    return q;
  };
}

std::optional<Lattice> referee_lattice(const Target& target) {
  if (!target.lattice) return std::nullopt;
  const Lattice& lattice = *target.lattice;
  if (static_cast<int>(target.points.size()) != lattice.columns * lattice.rows) return std::nullopt;
  for (int r = 0; r < lattice.rows; ++r) {
    for (int c = 0; c < lattice.columns; ++c) {
      const Vec3 expected(c * lattice.spacing_m, r * lattice.spacing_m, 0);
      if ((target.points[r * lattice.columns + c] - expected).norm() > 1e-9) return std::nullopt;
    }
  }
  return lattice;
}

Problem make_problem(const Calibration& calibration, const Lattice& lattice,
                     const std::vector<RefereeLens>& lenses, bool use_sigma) {
  Problem problem;
  problem.lattice = lattice;
  problem.warp_m = bow_of(calibration, 0);
  problem.model = lenses.front().model;
  const SE3 T_rig_ref = calibration.rig.T_cam_rig.front().inverse();
  for (std::size_t cam = 0; cam < calibration.rig.cameras.size(); ++cam) {
    problem.intrinsics.push_back(lenses[cam].parameters);
    problem.T_cam_ref.push_back(cam == 0 ? SE3() : calibration.rig.T_cam_rig[cam] * T_rig_ref);
    problem.image_sizes.push_back(calibration.rig.cameras[cam].size.width);
    problem.image_sizes.push_back(calibration.rig.cameras[cam].size.height);
  }
  // mrcal wants the observations by frame and then by camera, and frames without gaps.
  std::vector<std::size_t> order;
  for (std::size_t v = 0; v < calibration.data.views.size(); ++v) {
    const View& view = calibration.data.views[v];
    if (!calibration.T_rig_board[view.frame] || calibration.fits[v].size() != view.corners.size()) continue;
    if (std::all_of(calibration.fits[v].begin(), calibration.fits[v].end(),
                    [](const CornerFit& f) { return f.outlier; })) {
      continue;
    }
    order.push_back(v);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const View &x = calibration.data.views[a], &y = calibration.data.views[b];
    return std::pair(x.frame, x.cam) < std::pair(y.frame, y.cam);
  });
  const std::size_t per_view = static_cast<std::size_t>(lattice.columns) * lattice.rows;
  for (std::size_t v : order) {
    const View& view = calibration.data.views[v];
    if (problem.frames.empty() || problem.frames.back() != view.frame) {
      problem.frames.push_back(view.frame);
      problem.T_ref_board.push_back(calibration.rig.T_cam_rig.front() * *calibration.T_rig_board[view.frame]);
    }
    mrcal_observation_board_t observation{};
    observation.icam.intrinsics = view.cam;
    observation.icam.extrinsics = view.cam - 1;  // -1: at the reference
    observation.iframe = static_cast<int>(problem.frames.size()) - 1;
    problem.observations.push_back(observation);
    mrcal_point3_t missing{};
    missing.xyz[2] = -1;
    problem.pool.resize(problem.pool.size() + per_view, missing);
    for (std::size_t c = 0; c < view.corners.size(); ++c) {
      if (calibration.fits[v][c].outlier) continue;
      const Corner& corner = view.corners[c];
      double* xyz = problem.pool[problem.pool.size() - per_view + static_cast<std::size_t>(corner.point)].xyz;
      xyz[0] = corner.px.x(), xyz[1] = corner.px.y(), xyz[2] = use_sigma ? 1 / corner.sigma_px : 1;
    }
  }
  return problem;
}

std::optional<double> optimise(Problem& problem, Solve solve) {
  const int n_cams = static_cast<int>(problem.intrinsics.size()),
            n_frames = static_cast<int>(problem.T_ref_board.size());
  const int n_obs = static_cast<int>(problem.observations.size());
  if (n_obs == 0) return std::nullopt;
  std::vector<double> intrinsics;
  for (const auto& k : problem.intrinsics) intrinsics.insert(intrinsics.end(), k.begin(), k.end());
  std::vector<mrcal_pose_t> extrinsics, frames;
  for (int i = 1; i < n_cams; ++i) extrinsics.push_back(to_mrcal(problem.T_cam_ref[i]));
  for (const SE3& T : problem.T_ref_board) frames.push_back(to_mrcal(T));

  mrcal_problem_selections_t selections{};
  selections.do_optimize_intrinsics_core = solve.core;
  selections.do_optimize_intrinsics_distortions = solve.distortion;
  selections.do_optimize_extrinsics = n_cams > 1;
  selections.do_optimize_frames = true;
  selections.do_apply_regularization = solve.regularise;
  selections.do_optimize_calobject_warp = problem.warp_m.has_value();
  mrcal_calobject_warp_t warp{};
  if (problem.warp_m) std::copy_n(problem.warp_m->data(), 2, warp.values);
  mrcal_problem_constants_t constants{};  // about free points, of which there are none
  constants.point_min_range = 1e-3;
  constants.point_max_range = 1e6;
  const int n_x = mrcal_num_measurements(n_obs, 0, problem.lattice.columns, problem.lattice.rows, n_cams,
                                         n_cams - 1, n_frames, 0, 0, selections, &problem.model);
  std::vector<double> x(n_x);
  double rms = INFINITY, norm = INFINITY;
  for (int round = 0; round < solve.max_rounds; ++round) {
    const mrcal_stats_t stats = mrcal_optimize(
        nullptr, 0, x.data(), n_x * static_cast<int>(sizeof(double)), intrinsics.data(), extrinsics.data(),
        frames.data(), nullptr, problem.warp_m ? &warp : nullptr, n_cams, n_cams - 1, n_frames, 0, 0,
        problem.observations.data(), nullptr, n_obs, 0, problem.pool.data(), &problem.model,
        problem.image_sizes.data(), selections, &constants, problem.lattice.spacing_m,
        problem.lattice.columns, problem.lattice.rows, false, false);
    if (!(stats.rms_reproj_error__pixels >= 0)) return std::nullopt;
    rms = rms_of(problem, x);
    // Of everything that mrcal minimises: with regularisation the corners' share may rise while the sum
    // falls.
    const double next = std::sqrt(std::inner_product(x.begin(), x.end(), x.begin(), 0.0));
    const bool done = !(next < norm * (1 - 1e-12));
    norm = next;
    if (done) break;
  }
  if (problem.warp_m) problem.warp_m = Vec2(warp.values[0], warp.values[1]);
  const std::size_t n_k = problem.intrinsics.front().size();
  for (int i = 0; i < n_cams; ++i)
    problem.intrinsics[i].assign(&intrinsics[i * n_k], &intrinsics[i * n_k] + n_k);
  for (int i = 1; i < n_cams; ++i) problem.T_cam_ref[i] = from_mrcal(extrinsics[i - 1]);
  for (int i = 0; i < n_frames; ++i) problem.T_ref_board[i] = from_mrcal(frames[i]);
  if (!std::isfinite(rms)) return std::nullopt;
  return rms;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <numbers>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "geometry_camera_answer.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/refine/camera_matrix.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string points, matrix, output;
  RefinementOptions refinement;
};

struct Estimate {
  Mat34 P;
  double rms_px = 0, sigma_px = 0;
  std::size_t n = 0;
  std::optional<MatX> covariance;  // of the twelve numbers of P / |P|, row by row
};

double rms_px(const Mat34& P, const std::vector<Vec3>& p_world, const std::vector<Vec2>& px) {
  double sum = 0;
  for (std::size_t i = 0; i < px.size(); ++i)
    sum += ((P * p_world[i].homogeneous()).hnormalized() - px[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(px.size()));
}

Result<Estimate> from_points(const Options& o) {
  auto table = load_points(o.points);
  if (!table) return table.error();
  auto p_world = points_3d(*table, "X", "Y", "Z");
  if (!p_world) return in_file(p_world.error(), o.points);
  auto px = points_2d(*table, "u", "v");
  if (!px) return in_file(px.error(), o.points);
  if (px->size() < 6) {
    return Error{ErrorCode::kDegenerate,
                 fmt::format("{} points; a camera matrix needs at least 6, not in a plane", px->size()),
                 o.points};
  }
  auto P = camera_matrix(*p_world, *px);
  if (!P) return in_file(P.error(), o.points);
  Estimate estimate{*P, rms_px(*P, *p_world, *px), 0, px->size(), {}};
  if (o.refinement.linear) return estimate;
  auto refined = refine_camera_matrix(*P, *p_world, *px, 1.0);
  if (!refined) return in_file(refined.error(), o.points);
  const int n = static_cast<int>(px->size());
  estimate.P = refined->P;
  estimate.rms_px = refined->rms_px;
  estimate.sigma_px = o.refinement.sigma_px > 0
                          ? o.refinement.sigma_px
                          : sigma_of_residuals(n * refined->rms_px * refined->rms_px, 2 * n, 11);
  if (estimate.sigma_px > 0)
    estimate.covariance = refined->covariance * estimate.sigma_px * estimate.sigma_px;
  return estimate;
}

// The largest difference between the three decompositions: of K relative to its focal length, of R, and of
// the two centres relative to the larger of 1 and their distance from the origin.
double disagreement(const CameraMatrixParts& a, const CameraMatrixParts& b, const Vec3& centre) {
  const double K = (a.K - b.K).cwiseAbs().maxCoeff() / a.K(0, 0);
  const double R = (a.R - b.R).cwiseAbs().maxCoeff();
  return std::max({K, R, (a.centre - centre).norm() / std::max(1.0, centre.norm())});
}

Result<int> run(const Options& o, const Common& common) {
  if (o.points.empty() == o.matrix.empty()) usage_error("give either --points or --matrix");
  if (Status s = check_answer(o.output, common); !s) return s.error();
  const std::string where = o.points.empty() ? "--matrix" : o.points;
  Estimate estimate;
  if (o.points.empty()) {
    const auto m = parse_numbers(o.matrix, {12}, "--matrix");
    for (int i = 0; i < 12; ++i) estimate.P(i / 4, i % 4) = m[i];
  } else {
    auto found = from_points(o);
    if (!found) return found.error();
    estimate = *std::move(found);
  }
  auto rq = decompose_camera_matrix(estimate.P);
  if (!rq) return in_file(rq.error(), where);
  auto qr = decompose_camera_matrix_qr(estimate.P);
  if (!qr) return in_file(qr.error(), where);
  auto cholesky = decompose_camera_matrix_cholesky(estimate.P);
  if (!cholesky) return in_file(cholesky.error(), where);
  auto centre = camera_centre_by_inverse(estimate.P);
  if (!centre) return in_file(centre.error(), where);
  const double apart = std::max(disagreement(*rq, *qr, *centre), disagreement(*rq, *cholesky, *centre));

  // P with the scale and the sign of K [R t], whose third row measures depth.
  Json json = json_of_camera(rq->K, rq->T_cam_world());
  json["skew"] = rq->K(0, 1);
  json["roads_differ_by"] = apart;
  std::string text = text_of_matrix("P", rq->K * rq->T_cam_world().matrix34()) + text_of_matrix("K", rq->K) +
                     text_of_matrix("R", rq->R);
  text += fmt::format(
      "t = {}\nC = {}\nrotation vector {} deg\nRQ, QR of the inverse, Cholesky, and both centres "
      "agree to {:.1e}\n",
      text_of_vector(rq->t), text_of_vector(rq->centre),
      text_of_vector(so3_log(rq->R) * 180 / std::numbers::pi), apart);
  if (estimate.n > 0) {
    json["rms_px"] = estimate.rms_px;
    json["n"] = estimate.n;
    text += fmt::format("rms {:.4f} px over {} points\n", estimate.rms_px, estimate.n);
  }
  if (estimate.covariance) {
    json["sigma_px"] = estimate.sigma_px;
    // Of P as printed, with its length |P| held: a camera matrix has a scale of its own choice.
    const double scale = (rq->K * rq->T_cam_world().matrix34()).norm();
    json["covariance_P"] = json_of_matrix(*estimate.covariance * scale * scale);
  }
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_decompose(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("--points", o->points,
                 "CSV or YAML with a header; columns X,Y,Z,u,v; P by DLT and refinement");
  app.add_option("--matrix", o->matrix, "P as 12 numbers, row by row, any scale and sign");
  add_refinement_options(app, o->refinement);
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

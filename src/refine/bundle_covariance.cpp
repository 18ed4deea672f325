// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/bundle_setup.hpp"
#include "refine/reprojection_cost.hpp"
#include "refine/small_solve.hpp"

namespace plumbline::detail {
namespace {

constexpr int kMostCovariance = 6000;  // 288 MB
constexpr int kMostSteps = std::max(6, kMaxLensParams);
using JacSteps = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, kMostSteps>;
using StepsByPoint = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::ColMajor, kMostSteps, 3>;

// One sighting's derivatives by the shared blocks it touches, in sigmas. first = -1: none.
struct SightingRows {
  struct Block {
    int first = -1;
    JacSteps J;
  };
  std::array<Block, 2> shared;  // lens and view
  Mat23 J_point;
};

SightingRows rows_of(const Reconstruction& scene, const BundleSetup& setup, const SharedColumns& columns,
                     const Sighting& s, const BundleOptions& options) {
  const ReconstructionView& view = scene.views[s.view];
  const Vec3 turned = view.T_cam_world.R() * scene.p_world[s.point];
  Mat23 J_px_p;
  JacLens J_px_k;
  SightingRows rows;
  rows.J_point.setZero();
  const auto px = project(scene.cameras[view.camera].lens, turned + view.T_cam_world.t(), &J_px_p, &J_px_k);
  if (!px) return rows;
  double weight = 1 / s.sigma_px;
  const double squared = (weight * (*px - s.px)).squaredNorm();
  weight *= std::sqrt(rho(options.loss, options.loss_scale, squared).derivative);
  rows.J_point = weight * J_px_p * view.T_cam_world.R();
  if (columns.lens[view.camera] >= 0) {
    rows.shared[0].first = columns.lens[view.camera];
    rows.shared[0].J = weight * J_px_k * setup.lens_step[view.camera];
  }
  if (columns.view[s.view] >= 0) {
    Mat26 J;
    J << -J_px_p * skew(turned), J_px_p;
    rows.shared[1].first = columns.view[s.view];
    if (s.view == setup.sphere_view)
      rows.shared[1].J = weight * J * setup.sphere->jacobian(view.T_cam_world);
    else
      rows.shared[1].J = weight * J;
  }
  return rows;
}

// H of one eliminated point and its coupling to the shared blocks.
struct PointSystem {
  struct Coupling {
    int first = 0;
    StepsByPoint W;  // J_shared' J_point
  };
  Mat3 H = Mat3::Zero();
  std::vector<Coupling> couplings;

  void add(const SightingRows& rows) {
    H += rows.J_point.transpose() * rows.J_point;
    for (const auto& block : rows.shared) {
      if (block.first < 0) continue;
      const StepsByPoint W = block.J.transpose() * rows.J_point;
      const auto known = std::find_if(couplings.begin(), couplings.end(),
                                      [&](const Coupling& c) { return c.first == block.first; });
      if (known == couplings.end())
        couplings.push_back({block.first, W});
      else
        known->W += W;
    }
  }
};

struct Reduced {
  MatX S;                           // lower triangle
  std::vector<PointSystem> points;  // kept for those whose covariance is wanted; the others are empty
};

void add_direct(MatX& S, const SightingRows& rows, int point_column) {
  std::array<SightingRows::Block, 3> blocks{rows.shared[0], rows.shared[1], {point_column, rows.J_point}};
  for (const auto& a : blocks) {
    for (const auto& b : blocks) {
      if (a.first < 0 || b.first < 0) continue;
      S.block(a.first, b.first, a.J.cols(), b.J.cols()) += a.J.transpose() * b.J;
    }
  }
}

void add_bars(MatX& S, const Reconstruction& scene, const BundleSetup& setup, const SharedColumns& columns) {
  for (const ScaleBar& bar : setup.bars) {
    const Vec3 u = (scene.p_world[bar.point_a] - scene.p_world[bar.point_b]).normalized() / bar.sigma_m;
    const std::array<std::pair<int, Vec3>, 2> ends{
        {{columns.point[bar.point_a], u}, {columns.point[bar.point_b], -u}}};
    for (const auto& [i, a] : ends) {
      for (const auto& [j, b] : ends)
        if (i >= 0 && j >= 0) S.block<3, 3>(i, j) += a * b.transpose();
    }
  }
}

Result<Reduced> reduce(const Reconstruction& scene, const BundleSetup& setup, const SharedColumns& columns,
                       const Participation& part, const BundleOptions& options,
                       const std::vector<bool>& keep) {
  Reduced reduced{MatX::Zero(columns.total, columns.total), std::vector<PointSystem>(scene.p_world.size())};
  for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
    if (!part.sighting[i]) continue;
    const Sighting& s = scene.sightings[i];
    const SightingRows rows = rows_of(scene, setup, columns, s, options);
    add_direct(reduced.S, rows, columns.point[s.point]);
    if (!setup.point_held[s.point] && columns.point[s.point] < 0) reduced.points[s.point].add(rows);
  }
  add_bars(reduced.S, scene, setup, columns);
  for (std::size_t p = 0; p < reduced.points.size(); ++p) {
    PointSystem& point = reduced.points[p];
    if (point.H.isZero(0)) continue;
    const auto inverse = spd_inverse<3>(point.H);
    if (!inverse) {
      return Error{ErrorCode::kDegenerate,
                   "the sightings do not determine it; leave it out, or see it from farther apart",
                   point_name(scene, static_cast<int>(p))};
    }
    for (const auto& a : point.couplings) {
      const StepsByPoint A = a.W * *inverse;
      for (const auto& b : point.couplings) {
        if (b.first > a.first) continue;
        reduced.S.block(a.first, b.first, a.W.rows(), b.W.rows()).noalias() -= A * b.W.transpose();
      }
    }
    point.H = *inverse;
    if (!keep[p]) point = {};
  }
  reduced.S.triangularView<Eigen::StrictlyUpper>() = reduced.S.transpose();
  return reduced;
}

std::string column_name(const Reconstruction& scene, const BundleSetup& setup, const SharedColumns& columns,
                        int column) {
  int name = 0;
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    const int n = static_cast<int>(setup.lens_step[c].cols());
    if (columns.lens[c] >= 0 && column < columns.lens[c] + n)
      return setup.lens_names[name + column - columns.lens[c]];
    name += n;
  }
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    const int first = columns.view[v];
    if (first >= 0 && column >= first && column < first + setup.view_steps(static_cast<int>(v)))
      return "the pose of " + view_name(scene, static_cast<int>(v));
  }
  for (std::size_t p = 0; p < scene.p_world.size(); ++p) {
    if (columns.point[p] >= 0 && column >= columns.point[p] && column < columns.point[p] + 3)
      return point_name(scene, static_cast<int>(p));
  }
  return "a parameter";
}

// Columns of S^-1 as they are asked for. S is scaled to a unit diagonal, so that radians, metres and pixels
// compare; a first right-hand side of random numbers shows every direction that S nearly loses.
class Inverse {
 public:
  Inverse(const MatX& S, std::vector<int> wanted) : wanted_(std::move(wanted)) {
    const Eigen::Index n = S.rows();
    if (n == 0) return;
    scale_ = S.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    MatX b = MatX::Zero(n, 1 + static_cast<Eigen::Index>(wanted_.size()));
    Rng rng(1);
    for (Eigen::Index i = 0; i < n; ++i) b(i, 0) = rng.normal(1 / std::sqrt(static_cast<double>(n)));
    for (std::size_t j = 0; j < wanted_.size(); ++j) b(wanted_[j], static_cast<Eigen::Index>(j) + 1) = 1;
    solution_ = solve_spd(scale_.asDiagonal() * S * scale_.asDiagonal(), b);
  }
  // The parameter that moves most along the least determined direction when that is lost: an eigenvalue below
  // 1e-13 of the scaled S is rounding.
  std::optional<int> lost() const {
    if (scale_.size() == 0) return std::nullopt;
    if (!solution_) return 0;
    Eigen::Index worst = 0;
    const double largest = solution_->col(0).cwiseAbs().maxCoeff(&worst);
    if (largest < 1e13 / std::sqrt(static_cast<double>(scale_.size()))) return std::nullopt;
    return static_cast<int>(worst);
  }
  // Covariance of n steps from `row` with m steps from `column`. \pre the latter were wanted
  MatX block(int row, int n, int column, int m) const {
    const auto at = std::lower_bound(wanted_.begin(), wanted_.end(), column) - wanted_.begin();
    return scale_.segment(row, n).asDiagonal() * solution_->block(row, 1 + at, n, m) *
           scale_.segment(column, m).asDiagonal();
  }

 private:
  std::vector<int> wanted_;
  VecX scale_;
  std::optional<MatX> solution_;
};

std::vector<std::string> names_of_steps(const BundleSetup& setup, const SharedColumns& columns) {
  std::vector<std::string> names;
  std::size_t next = 0;
  for (std::size_t c = 0; c < columns.lens.size(); ++c) {
    for (Eigen::Index i = 0; i < setup.lens_step[c].cols(); ++i, ++next)
      if (columns.lens[c] >= 0) names.push_back(setup.lens_names[next]);
  }
  return names;
}

struct Request {
  const Bundle& bundle;
  const BundleSetup& setup;
  const SharedColumns& columns;
  const BundleOptions& options;
};

std::vector<int> wanted_columns(const Request& r, const Reduced& reduced) {
  std::vector<int> wanted;
  const auto add = [&](int first, Eigen::Index n) {
    for (int i = 0; first >= 0 && i < n; ++i) wanted.push_back(first + i);
  };
  for (int v : r.options.covariance_of_views) add(r.columns.view[v], r.setup.view_steps(v));
  for (int p : r.options.covariance_of_points) {
    add(r.columns.point[p], 3);
    for (const auto& coupling : reduced.points[p].couplings) add(coupling.first, coupling.W.rows());
  }
  for (std::size_t c = 0; r.options.covariance_of_intrinsics && c < r.columns.lens.size(); ++c)
    add(r.columns.lens[c], r.setup.lens_step[c].cols());
  std::sort(wanted.begin(), wanted.end());
  wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
  return wanted;
}

MatX view_steps_to_pose(const Request& r, int view) {
  if (view == r.setup.sphere_view) return r.setup.sphere->jacobian(r.bundle.scene.views[view].T_cam_world);
  return Mat6::Identity();
}

MatX view_covariance(const Request& r, const Inverse& inverse) {
  const auto& views = r.options.covariance_of_views;
  MatX C =
      MatX::Zero(6 * static_cast<Eigen::Index>(views.size()), 6 * static_cast<Eigen::Index>(views.size()));
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (std::size_t j = 0; j < views.size(); ++j) {
      const int a = r.columns.view[views[i]], b = r.columns.view[views[j]];
      if (a < 0 || b < 0) continue;
      C.block<6, 6>(6 * static_cast<Eigen::Index>(i), 6 * static_cast<Eigen::Index>(j)) =
          view_steps_to_pose(r, views[i]) *
          inverse.block(a, r.setup.view_steps(views[i]), b, r.setup.view_steps(views[j])) *
          view_steps_to_pose(r, views[j]).transpose();
    }
  }
  return C;
}

// H^-1 + H^-1 W' C W H^-1, C the covariance of the shared blocks that the point is coupled to.
Mat3 point_covariance(const Request& r, const Reduced& reduced, const Inverse& inverse, int p) {
  if (r.columns.point[p] >= 0) return inverse.block(r.columns.point[p], 3, r.columns.point[p], 3);
  const PointSystem& point = reduced.points[p];
  Mat3 C = point.H;
  for (const auto& a : point.couplings) {
    for (const auto& b : point.couplings) {
      const MatX shared =
          inverse.block(a.first, static_cast<int>(a.W.rows()), b.first, static_cast<int>(b.W.rows()));
      C += point.H * a.W.transpose() * shared * b.W * point.H;
    }
  }
  return C;
}

void fill_intrinsics(const Request& r, const Inverse& inverse, Bundle& bundle) {
  std::vector<int> columns;
  for (std::size_t c = 0; c < r.columns.lens.size(); ++c) {
    for (int i = 0; i < r.setup.lens_step[c].cols() && r.columns.lens[c] >= 0; ++i)
      columns.push_back(r.columns.lens[c] + i);
  }
  const auto n = static_cast<Eigen::Index>(columns.size());
  bundle.intrinsics_covariance = MatX::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j)
      bundle.intrinsics_covariance(i, j) = inverse.block(columns[i], 1, columns[j], 1)(0, 0);
  }
}

}  // namespace

Status bundle_covariance(Bundle& bundle, const BundleSetup& setup, const Participation& part,
                         const BundleOptions& options, int most_judged) {
  const Reconstruction& scene = bundle.scene;
  const SharedColumns columns = shared_columns(scene, setup, part);
  bundle.intrinsics_names = names_of_steps(setup, columns);
  const bool asked = !options.covariance_of_views.empty() || !options.covariance_of_points.empty() ||
                     options.covariance_of_intrinsics;
  if (!asked && columns.total > most_judged) return {};
  if (columns.total > kMostCovariance) {
    return Error{ErrorCode::kUnsupported,
                 fmt::format("the covariance of {} shared parameters would need a dense matrix; at most {}",
                             columns.total, kMostCovariance),
                 "covariance"};
  }
  const auto must_take_part = [](bool takes_part, const std::string& name) -> Status {
    if (takes_part) return {};
    return Error{ErrorCode::kDegenerate, "it is left out of the adjustment and has no covariance", name};
  };
  for (int v : options.covariance_of_views) {
    if (Status s = must_take_part(part.view[v] || setup.view_held[v], view_name(scene, v)); !s) return s;
  }
  std::vector<bool> keep(scene.p_world.size(), false);
  for (int p : options.covariance_of_points) {
    if (Status s = must_take_part(part.point[p] || setup.point_held[p], point_name(scene, p)); !s) return s;
    keep[p] = true;
  }
  const auto reduced = reduce(scene, setup, columns, part, options, keep);
  if (!reduced) return reduced.error();
  const Request request{bundle, setup, columns, options};
  const Inverse inverse(reduced->S, wanted_columns(request, *reduced));
  if (const auto column = inverse.lost()) {
    return Error{
        ErrorCode::kDegenerate,
        "the sightings do not determine it: the whole can bend along it without a change of the pixels; "
        "hold it, leave it out, or add views that share points with it",
        column_name(scene, setup, columns, *column)};
  }
  bundle.view_covariance = view_covariance(request, inverse);
  for (int p : options.covariance_of_points)
    bundle.point_covariance.push_back(setup.point_held[p] ? Mat3(Mat3::Zero())
                                                          : point_covariance(request, *reduced, inverse, p));
  if (options.covariance_of_intrinsics) fill_intrinsics(request, inverse, bundle);
  return {};
}

}  // namespace plumbline::detail

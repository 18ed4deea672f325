// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/refine/refine.hpp"
#include "plumbline/rig/reconstruction.hpp"

/// Bundle adjustment: points, poses and, where wanted, lenses of a reconstruction refined together. Triggs,
/// McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment - a modern synthesis" (2000).
namespace plumbline {

/// A known distance of two points, a measurement like the pixels: residual (|p_a - p_b| - length) / sigma.
struct ScaleBar {
  int point_a = 0, point_b = 0;  ///< indices into Reconstruction::p_world
  double length_m = 0;           ///< > 0
  double sigma_m = 0;            ///< > 0
};

enum class BundleSolver {
  kAuto,            ///< dense to 900 reduced parameters (6 a view), sparse to 30,000, iterative beyond
  kDenseSchur,      ///< Cholesky of the reduced system, dense
  kSparseSchur,     ///< the same, sparse
  kIterativeSchur,  ///< conjugate gradients on the reduced system, Schur-Jacobi preconditioner
};

struct BundleOptions {
  /// The gauge: pixels alone leave rotation, position and scale of the whole scene free (7 degrees of
  /// freedom). With nothing held, the first view is held, and the scale is fixed by the scale bars or,
  /// without any, by holding the distance from that view's centre to the centre farthest from it. With
  /// anything held, nothing is added, and what stays free is refused.
  std::vector<int> hold_views;   ///< their poses stay as they are
  std::vector<int> hold_points;  ///< their coordinates stay as they are (surveyed points)
  std::vector<ScaleBar> scale_bars;
  /// Lens parameters that are refined, by name: "fx" in every camera, "camera1 fx" in one, "all". The others
  /// are held.
  std::vector<std::string> free_intrinsics;
  bool tie_focal = false;  ///< fx and fy move together, fy / fx stays what it is at the start
  Loss loss = Loss::kSquared;
  double loss_scale = 1.0;  ///< where Huber and Cauchy bend, in sigmas of a sighting
  int max_iterations = 200;
  BundleSolver solver = BundleSolver::kAuto;
  std::vector<int> covariance_of_views;   ///< for Bundle::view_covariance
  std::vector<int> covariance_of_points;  ///< for Bundle::point_covariance
  bool covariance_of_intrinsics = false;  ///< for Bundle::intrinsics_covariance
};

/// What became of one sighting.
struct SightingFit {
  enum class Use {
    kUsed,
    kLeftOut,       ///< its view or its point is left out; the residual is that of the final state
    kNoProjection,  ///< outside its lens' domain (behind the camera): not used, and the residual says nothing
  };
  Use use = Use::kUsed;
  Vec2 residual_px = Vec2::Zero();  ///< projection - measured [px]
};

/// A view or a point that took no part and keeps its start values.
struct LeftOut {
  enum class What { kView, kPoint };
  What what = What::kPoint;
  int index = 0;
  std::string reason;  ///< "it is seen in 1 view, 2 are needed"
};

/// The result of a bundle adjustment.
struct Bundle {
  Reconstruction scene;           ///< refined
  std::vector<SightingFit> fits;  ///< one per sighting
  std::vector<LeftOut> left_out;
  std::string gauge;           ///< what fixed rotation, position and scale, in words
  int n_used = 0;              ///< sightings
  int n_free_parameters = 0;   ///< 3 per point, 6 per view, ... without what is held
  double rms_px_before = 0;    ///< over the same sightings, at the start (of the last round)
  double rms_px = 0;           ///< root of the mean of dx^2 + dy^2 over the sightings used
  double cost_before = 0;      ///< half the sum of rho(|residual|^2 / sigma^2), bars included, at the start
  double cost = 0;             ///< the same at the end
  double variance_factor = 0;  ///< 2 cost / (residuals - free parameters): 1 when the sigmas are right; or 0
  std::vector<double> bar_residual_m;  ///< |p_a - p_b| - length of each scale bar
  int iterations = 0;
  bool converged = false;
  std::string termination;  ///< why the solver stopped, one line
  /// Covariances: the inverse of J'J of the residuals in sigmas (weighted by rho' under a robust loss), in
  /// the gauge of this solve; multiply by variance_factor when the sigmas are only relative. Empty when not
  /// asked for.
  MatX view_covariance;  ///< 6 x 6 for each view asked for, in that order, jointly; steps of box_plus on
                         ///< T_cam_world [rad | unit of length]; zero for held views
  std::vector<Mat3> point_covariance;         ///< one for each point asked for; zero for held points
  MatX intrinsics_covariance;                 ///< over intrinsics_names
  std::vector<std::string> intrinsics_names;  ///< "camera1 fx": the refined ones; a tied fy is not among them
};

/// Minimises the reprojection error over points, poses and the lens parameters that are free. Levenberg and
/// Marquardt by Ceres, points eliminated first, analytic Jacobians, one thread, so that the same input gives
/// the same bytes. A sighting outside the domain of its lens is never a zero residual: a step that puts one
/// there is rejected, and those that are there at the start are left out and tried again after each solve.
/// Points seen in fewer than two views, and views with fewer than three points, are left out and named.
/// \returns kInvalidData: what validate() says, or an index, a bar or a name in the options that makes no
///          sense.
///          kDegenerate: a gauge that leaves any of the 7 degrees of freedom free (says how many); views that
///          fall into groups without common points; nothing left to adjust; parameters that the sightings do
///          not determine (names one; looked for up to 1,500 reduced
///          parameters, and not with kIterativeSchur).
///          kNotConverged: no finite optimum.
Result<Bundle> adjust_bundle(const Reconstruction& start, const BundleOptions& options = {});

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/refine/bundle.hpp"
#include "refine/bundle_cost.hpp"

/// Who takes part in a bundle adjustment, along which steps each block moves, and what fixes the gauge. No
/// Ceres here.
namespace plumbline::detail {

/// The free steps of every block.
struct BundleSetup {
  std::vector<MatX> lens_step;          ///< per camera: parameters x steps; no column where all are held
  std::vector<std::string> lens_names;  ///< "camera1 fx" of what moves, camera by camera
  std::vector<bool> view_held, point_held;
  std::vector<bool> point_shared;  ///< ends of scale bars: a bar ties two points, so that the points
                                   ///< cannot be eliminated one by one
  int sphere_view = -1;            ///< the view whose distance to the anchor is held; -1: none
  std::optional<SphereStep> sphere;
  std::vector<ScaleBar> bars;
  std::string gauge;

  /// Steps of a view: 6, 5 on the sphere, 0 when held.
  int view_steps(int view) const { return view_held[view] ? 0 : view == sphere_view ? 5 : 6; }
};

/// Checks the options against the scene; the gauge is not fixed yet.
Result<BundleSetup> make_setup(const Reconstruction& scene, const BundleOptions& options);

/// Who takes part, in the present state of the scene.
struct Participation {
  std::vector<bool> view, point;  ///< free or held, with at least one sighting in use
  std::vector<bool> sighting;
  std::vector<bool> projects;  ///< per sighting
  std::vector<LeftOut> left_out;
  int n_sightings = 0;
  bool operator==(const Participation& other) const { return sighting == other.sighting; }
};
Participation participation_of(const Reconstruction& scene, const BundleSetup& setup);

/// Counts the degrees of freedom that are left, in every part of the scene that hangs together through free
/// views and points: kDegenerate when there are any.
Status check_gauge(const BundleSetup& setup, const Reconstruction& scene, const Participation& part);

/// Chooses the default gauge where nothing is held (and scales the scene to its bars), then checks.
Status fix_gauge(BundleSetup& setup, Reconstruction& scene, const Participation& part,
                 const BundleOptions& options);

/// Where each block's steps stand among the shared unknowns (all but the points that are eliminated); -1: the
/// block does not move.
struct SharedColumns {
  std::vector<int> lens, view, point;
  int total = 0;
};
SharedColumns shared_columns(const Reconstruction& scene, const BundleSetup& setup,
                             const Participation& part);

/// Free parameters of the solve: the shared ones and three for each eliminated point.
int count_free(const SharedColumns& columns, const BundleSetup& setup, const Participation& part);

/// Fills the covariances that the options ask for, and judges (up to `most_judged` shared unknowns) whether
/// the sightings determine everything: kDegenerate names a parameter that they do not.
Status bundle_covariance(Bundle& bundle, const BundleSetup& setup, const Participation& part,
                         const BundleOptions& options, int most_judged);

}  // namespace plumbline::detail

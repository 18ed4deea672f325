// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/assess/compare.hpp"
#include "plumbline/rig/calibration.hpp"

extern "C" {
#include <mrcal/mrcal.h>
}

/// The bridge to mrcal 2.2: the only files that include its header are in this folder.
namespace plumbline::detail {

/// A lens of mrcal with its parameters (core first, as ours).
struct RefereeLens {
  mrcal_lensmodel_t model{};
  std::string name;  ///< "LENSMODEL_OPENCV5"
  std::vector<double> parameters;
};

/// mrcal's lens of the same definition and parameter order, a splined one included; nullopt where it has none
/// (kb4).
std::optional<RefereeLens> same_lens(const Lens& lens);

/// mrcal_project as a Projection. The lens must outlive it.
Projection projection_of(const RefereeLens& lens);

/// mrcal's splined stereographic lens fitted to the projection of ours over a rectangle of stereographic
/// coordinates around all `rays_cam` (unit vectors): core as ours, control points by linear least squares.
/// nullopt when mrcal refuses the configuration.
std::optional<RefereeLens> fit_splined(const Camera& camera, const std::vector<Vec3>& rays_cam);

/// The uniform grid of a target in mrcal's order, or nullopt when its points are not at (c, r, 0) * spacing.
std::optional<Lattice> referee_lattice(const Target& target);

/// A problem as mrcal_optimize takes it. Its reference frame is camera 0.
struct Problem {
  mrcal_lensmodel_t model{};
  std::vector<std::vector<double>> intrinsics;          ///< per camera
  std::vector<SE3> T_cam_ref;                           ///< per camera; [0] is the identity
  std::vector<SE3> T_ref_board;                         ///< per frame that is used
  std::vector<int> frames;                              ///< index of each in the data set
  std::vector<mrcal_observation_board_t> observations;  ///< by frame, then by camera
  std::vector<mrcal_point3_t> pool;  ///< pixel and weight of every lattice point; weight -1: not seen
  std::vector<int> image_sizes;
  Lattice lattice;
  std::optional<Vec2> warp_m;  ///< calobject_warp, free where it is there
};

/// The inlier corners of a calibration with its poses and these lenses (all of one model, one per camera).
/// \param use_sigma  weight each corner by 1 / sigma_px
Problem make_problem(const Calibration& calibration, const Lattice& lattice,
                     const std::vector<RefereeLens>& lenses, bool use_sigma);

/// What mrcal_optimize may change.
struct Solve {
  bool core = true, distortion = true;
  bool regularise = false;  ///< with mrcal's own terms, which a splined lens needs
  int max_rounds = 8;       ///< mrcal stops on thresholds of its own; the next round starts where it stopped
};

/// Runs mrcal_optimize from the problem's state and leaves the optimum there, without outlier rejection,
/// again and again until the error no longer falls. rms_px over the inlier corners, not weighted; nullopt
/// when mrcal fails.
std::optional<double> optimise(Problem& problem, Solve solve = {});

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/refine/refine.hpp"
#include "refine/constraints.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {

/// The data of one camera as a data set of its own, and where its views stood. Several boards become one
/// target with the points of all, and each frame becomes a frame for each board: a camera alone is seeded
/// without knowing how the boards stand to one another.
struct MonoData {
  Dataset data;
  std::vector<int> view_index;  ///< into the views of the whole data set
};
MonoData mono_data(const Dataset& data, int cam);

/// A calibration of `data` with these lenses, no pose, and no view used.
Calibration empty_calibration(const Dataset& data, const std::vector<Lens>& lenses);

/// Pose of the board in one view for a known lens, refitted once without corners that are far off. nullopt
/// when there is none.
/// \param most_corners  so many of them, spread over the view, give the pose; 0: all
std::optional<SE3> find_pose(const Lens& lens, const Target& target, const View& view, int most_corners = 0);

/// Which views pose_views() looks at again.
enum class Repose {
  kAll,
  kPoor  ///< those without a pose, and those that fit more than twice as badly as the median
};

/// Gives each view of a one-camera calibration the pose that fits better: the one it has or a fresh one for
/// its lens. Views without any stay out.
void pose_views(Calibration& calibration, Repose which = Repose::kAll, int most_corners = 0);

/// Root of the mean over the views with corners of their squared RMS error, each corner's error capped at 5 %
/// of the image's diagonal and lost corners and views counted with the cap. One camera.
double score_px(const Calibration& calibration);

/// Lenses to try: closed forms (Zhang 2000, or DLT and RQ for points in space), and a geometric grid of focal
/// lengths from 0.15 to 8 times the image's longer side. \param subset  a few views of one camera   \param
/// centre_held  leave the centre in the middle
std::vector<Lens> starting_lenses(const Dataset& subset, const std::string& lens_name, Start start,
                                  bool centre_held);

/// The perspective lens whose radial profile is nearest to a fisheye's over the rays at angles `theta` [rad]
/// from the axis, by linear least squares in tan^2(theta); the same centre and focal lengths, no tangential
/// terms. Rays that no lens of this name can follow without folding are left outside its domain.
/// \param held  parameters of the lens that stay as make_lens() gives them, or empty
/// \returns nullopt for an unknown name
std::optional<Lens> perspective_like(const Lens& fisheye, const std::string& lens_name, ImageSize size,
                                     const std::vector<double>& theta, const std::vector<bool>& held);

/// The lens of this spec, with sparse derivatives, that projects as `like` does over the image and a quarter
/// of it around, by linear least squares with a whiff of its own regularisation; core parameters are those of
/// `like`. A spec without options gets them from the view (complete_spec()).
/// \returns an error for a bad spec
Result<Lens> sparse_like(const Lens& like, const std::string& spec, ImageSize size);

/// seed_camera() for a lens with sparse derivatives: by way of kb4 or opencv8, whichever fits better.
Result<Calibration> seed_sparse(const Dataset& mono, const std::string& spec, const RefineOptions& options,
                                const Constraints& constraints);

/// What is said of fx fy cx cy, for another lens with `n` parameters.
Constraints of_matrix_alone(const Constraints& constraints, int n);

/// Scale for a robust loss from the residuals of all corners that take part: three robust standard
/// deviations.
double robust_scale_px(const Calibration& calibration);

/// Unmarks all outliers and evaluates again; corners outside the lens' domain are marked anew.
void bring_back(Calibration& calibration);

/// Seeds one camera without a focal length from the user, and refines it alone under a robust loss.
/// \param constraints  over shared_parameter_names() of the rig of this one camera
Result<Calibration> seed_camera(const Dataset& mono, const std::string& lens_name,
                                const RefineOptions& options, const Constraints& constraints);

/// Places all cameras relative to camera 0 and all boards relative to the first from the frames that they
/// share, or by their motion; renumbers boards that another camera numbered the other way round, and gives
/// each frame a pose. kDegenerate names the groups of cameras that nothing connects (rig_graph.hpp).
Result<Calibration> seed_rig(const Dataset& data, const std::vector<MonoData>& parts,
                             std::vector<Calibration> monos);

/// Permutations of the target's points that its appearance allows; the first is the identity. Each one with
/// the motion T of the board that it stands for: points[permutation[i]] = T * points[i].
struct Symmetry {
  std::vector<int> permutation;
  SE3 T_board_board;
};
std::vector<Symmetry> symmetries(const Target& target);

}  // namespace plumbline::detail

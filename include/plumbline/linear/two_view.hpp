// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/lens/lens.hpp"
#include "plumbline/linear/ransac.hpp"

/// What two views give, and how far: the answer's type is its ambiguity. No type converts to another; the one
/// way from an up-to-scale result to metres is with_baseline(), which asks for the missing length.
/// Camera 1 is the frame of everything, x_2 = R x_1 + t. Hartley & Zisserman (2004), section 10.2.
namespace plumbline {

/// Metres. Ambiguity: none.
struct MetricReconstruction {
  SE3 T_2_1;                               ///< [m]
  std::vector<std::optional<Vec3>> p_1_m;  ///< one per pair, in the frame of camera 1 [m]; nullopt: see
                                           ///< reconstruct()
};

/// The unit of length is the unknown distance between the two cameras. Ambiguity: one number. The pose is not
/// an SE3, which elsewhere in the library is in metres.
struct UpToScaleReconstruction {
  Mat3 R_2_1;
  Vec3 t_2_1_baselines;                            ///< |t| = 1
  std::vector<std::optional<Vec3>> p_1_baselines;  ///< one per pair, in the frame of camera 1 [baselines]
};

/// Neither lengths nor angles, nor parallels: only incidence. Ambiguity: a 4x4 homography G of space, P G^-1
/// and G X being as good.
struct ProjectiveReconstruction {
  Mat34 P1_px_X, P2_px_X;              ///< canonical_cameras() of F: P1 = [I | 0]
  std::vector<std::optional<Vec4>> X;  ///< one per pair, homogeneous, |X| = 1
};

using TwoViewReconstruction =
    std::variant<ProjectiveReconstruction, UpToScaleReconstruction, MetricReconstruction>;

/// "metric", "up to scale" or "up to a projective transform".
std::string_view ambiguity(const TwoViewReconstruction& reconstruction);

/// What is known of the two cameras.
struct NothingKnown {};  ///< lenses without distortion, of unknown K
struct KnownLenses {
  Lens lens_1, lens_2;
};
struct KnownLensesAndBaseline {
  Lens lens_1, lens_2;
  double baseline_m = 0;  ///< distance between the two centres, > 0 [m]
};
struct KnownRig {
  Lens lens_1, lens_2;
  SE3 T_2_1;  ///< [m]
};
using TwoViewKnowledge = std::variant<NothingKnown, KnownLenses, KnownLensesAndBaseline, KnownRig>;

struct TwoViewOptions {
  RansacOptions ransac;   ///< ransac.inlier_px: of the epipolar (Sampson) distance; with a known rig of the
                          ///< reprojection error's root mean square over the two views
  double sigma_px = 0.5;  ///< of a pixel coordinate, for the refusal of parallel rays, > 0
};

/// Cameras and points from n pairs of pixels, as far as the knowledge allows. A pair's point is nullopt when
/// the pair is an outlier, or when triangulation refuses it (rays parallel as far as sigma_px tells, or
/// meeting behind a camera). Unequal numbers throw std::invalid_argument.
/// - KnownRig: each point by triangulate().
/// - KnownLenses: the relative pose by essential_ransac(), then the points.
/// - KnownLensesAndBaseline: the same, times the baseline.
/// - NothingKnown: F by fundamental_ransac(), then triangulate_optimal() with its canonical cameras.
/// \returns the failures of those; kDegenerate for fewer than 6 pairs (8 when nothing is known), and when not
///          one pair gives a point, with the first pair's reason
Result<MetricReconstruction> reconstruct(const KnownRig& known, std::span<const Vec2> px1,
                                         std::span<const Vec2> px2, const TwoViewOptions& options);
Result<MetricReconstruction> reconstruct(const KnownLensesAndBaseline& known, std::span<const Vec2> px1,
                                         std::span<const Vec2> px2, const TwoViewOptions& options);
Result<UpToScaleReconstruction> reconstruct(const KnownLenses& known, std::span<const Vec2> px1,
                                            std::span<const Vec2> px2, const TwoViewOptions& options);
Result<ProjectiveReconstruction> reconstruct(const NothingKnown& known, std::span<const Vec2> px1,
                                             std::span<const Vec2> px2, const TwoViewOptions& options);
Result<TwoViewReconstruction> reconstruct(const TwoViewKnowledge& known, std::span<const Vec2> px1,
                                          std::span<const Vec2> px2, const TwoViewOptions& options);

/// Metres from baselines, given the length of one. \pre baseline_m > 0
MetricReconstruction with_baseline(const UpToScaleReconstruction& reconstruction, double baseline_m);

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "plumbline/linear/hand_eye.hpp"
#include "refine/seed.hpp"

/// How one part of a rig stands to another, from views that know one side of it.
namespace plumbline::detail {

/// A view that ties an unknown pose X between what is known on both sides of it:
/// T_cam_board = left * X * right.
struct Link {
  int view = 0;             ///< of the whole data set
  std::optional<SE3> left;  ///< nothing: the identity
  SE3 right;
  SE3 T_cam_board;  ///< from this view alone
};

/// One pose for all links, and which numbering of each view's board suits it.
struct Placement {
  SE3 X;
  std::vector<int> symmetry;     ///< per link, into the symmetries of its board
  std::vector<double> error_px;  ///< per link: root mean square, capped
  double score = 0;              ///< sum of their squares
};

/// Symmetries of each target of a data set.
using Symmetries = std::vector<std::vector<Symmetry>>;

/// Each link proposes a pose; that with the least capped reprojection error over all of them is averaged with
/// those that agree. The present numbering wins unless another is clearly better. \pre links is not empty
Placement place(const Calibration& calibration, const std::vector<Link>& links, const Symmetries& all);

/// Reprojection error of a link's view with X, capped at 5 % of the image's diagonal.
double error_px(const Calibration& calibration, const Link& link, const SE3& X, const Symmetry& symmetry);

/// A frame in which one part of the rig sees one part of the boards and another part of the rig another.
struct MotionFrame {
  SE3 T_1, T_2;             ///< pose of the boards in each part's own frame
  std::vector<Link> links;  ///< views of the second part, with T_cam_board = left * T_2 * right
};

/// hand_eye() over those frames that agree: all, or those that the best of some triples explains.
Result<HandEye> place_by_motion(const Calibration& calibration, const std::vector<MotionFrame>& frames,
                                const Symmetries& all);

}  // namespace plumbline::detail

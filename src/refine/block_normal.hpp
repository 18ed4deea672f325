// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "refine/solve.hpp"
#include "refine/view_kernel.hpp"

/// The normal equations of a whole calibration in blocks, as block_solve.cpp steps on them.
namespace plumbline::detail {

/// What moves: lenses, rig, board poses.
struct BlockState {
  std::vector<Lens> lenses;
  std::vector<SE3> T_cam_rig, T_rig_board;  ///< the latter one for each BlockFrame
};

struct BlockView {
  int cam = 0;
  ViewCorners corners;
};

/// The views of one frame that take part.
struct BlockFrame {
  int frame = 0;  ///< index into Calibration::T_rig_board
  std::vector<BlockView> views;
  std::vector<int> shared;  ///< the shared parameters that its views depend on, ascending
};

struct BlockProblem {
  Offsets offsets;
  std::vector<BlockFrame> frames;
  Loss loss = Loss::kSquared;
  double loss_scale = 1;
  int n_threads = 1;
};
BlockProblem block_problem(const Calibration& calibration, const SolveSpec& spec);

/// A = J'J and g = J'r of one frame: over its board pose, and between that and BlockFrame::shared.
struct FrameNormal {
  Mat6 A_ff;
  Vec6 g_f;
  MatX A_sf;  ///< shared.size() x 6
};

struct BlockNormal {
  double cost = 0;
  MatX A_ss;  ///< over all shared parameters
  VecX g_s;
  std::vector<FrameNormal> frames;
};

/// nullopt when a corner lies outside its lens' domain or a number is not finite. Sums run in an order that
/// depends on nothing but the number of frames.
std::optional<BlockNormal> block_normal(const BlockProblem& problem, const BlockState& state);

/// A vector over all parameters: a gradient or a step.
struct BlockVector {
  VecX shared;               ///< all shared parameters; a step is zero where they are held
  std::vector<Vec6> boards;  ///< one for each frame
};

/// The damped normal matrix A + lambda diag(A) with the board poses eliminated.
class BlockFactor {
 public:
  /// nullopt when a block is not positive definite. `free` lists the shared parameters that move; boards stay
  /// with hold_boards.
  static std::optional<BlockFactor> make(const BlockProblem& problem, const BlockNormal& normal,
                                         std::vector<int> free, bool hold_boards, double lambda);
  /// The step d with (A + lambda diag(A)) d = -g, or nullopt when the matrix is not positive definite.
  std::optional<BlockVector> step(const BlockVector& g) const;
  /// What the quadratic model without damping promises of the cost for a step by step(gradient).
  double predicted_gain(const BlockVector& g, const BlockVector& d) const;
  /// d' diag(A) d.
  double scaled_square(const BlockVector& d) const;

 private:
  // Of each frame: A_ff + damping = L L', B = A_sf L^-T.
  struct Eliminated {
    Mat6 L;
    MatX B;
    Vec6 D;
  };
  const BlockProblem* problem_ = nullptr;
  std::vector<int> free_;
  std::vector<Eliminated> frames_;
  MatX S_;  // of the free parameters, scaled to a unit diagonal of A
  VecX D_s_, scale_;
  double lambda_ = 0;
};

/// g and A v of the normal equations.
BlockVector gradient(const BlockNormal& normal);
BlockVector times(const BlockProblem& problem, const BlockNormal& normal, const BlockVector& v);

/// J' W r with J and W at `state` and the residuals r at `other`; nullopt outside a lens' domain.
std::optional<BlockVector> mixed_gradient(const BlockProblem& problem, const BlockState& state,
                                          const BlockState& other);

}  // namespace plumbline::detail

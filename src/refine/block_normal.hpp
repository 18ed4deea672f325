// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "plumbline/core/parallel.hpp"
#include "refine/solve.hpp"
#include "refine/view_kernel.hpp"
#include "refine/view_kernel_sets.hpp"

/// The normal equations of a whole calibration in blocks, as block_solve.cpp steps on them.
namespace plumbline::detail {

/// What moves: lenses, rig, boards.
struct BlockState {
  std::vector<Lens> lenses;
  std::vector<SE3> T_cam_rig, T_board0_board;
  std::vector<Vec2> bow_m;       ///< per target; zero where it is no parameter
  std::vector<SE3> T_rig_board;  ///< of the first board, one for each BlockFrame
};

struct BlockView {
  int cam = 0, target = 0;
  ViewCorners corners;
};

/// The views of one frame that take part.
struct BlockFrame {
  int frame = 0;  ///< index into Calibration::T_rig_board
  std::vector<BlockView> views;
  std::vector<Segment> shared;  ///< the shared parameters that its views depend on, ascending
  int n_shared = 0;
  std::size_t at = 0;  ///< where its rows start in the arrays of all frames: 6 columns of n_shared numbers
};

struct BlockProblem {
  Offsets offsets;
  std::vector<BlockFrame> frames;
  std::size_t n_coupling = 0;  ///< numbers in the couplings of all frames
  Loss loss = Loss::kSquared;
  double loss_scale = 1;
  const SolveSpec* spec = nullptr;  ///< of the priors, and of what is held and tied
  Calibration shared_only;          ///< rig and boards without views, for the priors; empty without any
  std::unique_ptr<Workers> workers;
};
/// `spec` must outlive the problem.
BlockProblem block_problem(const Calibration& calibration, const SolveSpec& spec);

/// Sums of one run of frames (block_runs.hpp).
struct BlockSums {
  bool ok = true;
  double cost = 0;
  MatX A;
  VecX g;
};

/// A = J'J and g = J'r: over the shared parameters, over each board pose, and between the two.
struct BlockNormal {
  double cost = 0;
  MatX A_ss;  ///< lower triangle
  VecX g_s;
  std::vector<Mat6> A_ff;
  std::vector<Vec6> g_f;
  std::vector<double> A_sf;     ///< of each frame, from BlockFrame::at: 6 columns of n_shared numbers
  std::vector<BlockSums> runs;  ///< work space
};

/// Fills `normal`, whose memory is used again. False when a corner lies outside its lens' domain or a number
/// is not finite. Sums run in an order that depends on nothing but the number of frames.
bool make_normal(const BlockProblem& problem, const BlockState& state, BlockNormal& normal);

/// A vector over all parameters: a gradient or a step.
struct BlockVector {
  VecX shared;               ///< all shared parameters; a step is zero where they are held
  std::vector<Vec6> boards;  ///< one for each frame
};

/// The damped normal matrix A + lambda diag(A) with the board poses eliminated.
class BlockFactor {
 public:
  /// False when a block is not positive definite. `reduction`: the free numbers behind the shared parameters;
  /// boards stay with hold_boards. The problem must outlive the factor.
  bool make(const BlockProblem& problem, const BlockNormal& normal, Reduction reduction, bool hold_boards,
            double lambda);
  /// The step d with (A + lambda diag(A)) d = -g, or nullopt when the matrix is not positive definite.
  std::optional<BlockVector> step(const BlockVector& g) const;
  /// What the quadratic model without damping promises of the cost for a step by step(gradient).
  double predicted_gain(const BlockVector& g, const BlockVector& d) const;
  /// d' diag(A) d.
  double scaled_square(const BlockVector& d) const;

 private:
  const BlockProblem* problem_ = nullptr;
  bool hold_boards_ = false;
  Reduction reduction_;
  // Of each frame: A_ff + damping = L L', B = A_sf L^-T, and the diagonal that the damping scales with.
  std::vector<Mat6> L_;
  std::vector<double> B_;
  std::vector<Vec6> D_f_;
  std::vector<MatX> runs_;
  MatX S_;            // of the free numbers, scaled to a unit diagonal of A
  VecX scale_, D_s_;  // D_s_: what damps each free number, at the first of the parameters that share it
  double lambda_ = 0;
};

/// g and A v of the normal equations.
BlockVector gradient(const BlockNormal& normal);
BlockVector times(const BlockProblem& problem, const BlockNormal& normal, const BlockVector& v);

/// J' W r with J and W at `state` and the residuals r at `other`; nullopt outside a lens' domain.
std::optional<BlockVector> mixed_gradient(const BlockProblem& problem, const BlockState& state,
                                          const BlockState& other);

}  // namespace plumbline::detail

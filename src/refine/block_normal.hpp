// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "plumbline/core/parallel.hpp"
#include "refine/solve.hpp"
#include "refine/spline_view.hpp"
#include "refine/view_kernel.hpp"
#include "refine/view_kernel_sets.hpp"

/// The normal equations of a whole calibration in blocks, as block_solve.cpp steps on them.
namespace plumbline::detail {

/// What moves: lenses, rig, boards.
struct BlockState {
  std::vector<Lens> lenses;
  std::vector<SE3> T_cam_rig, T_board0_board;
  std::vector<SE3> T_rig_board;  ///< of the first board, one for each BlockFrame
};

struct BlockView {
  int cam = 0, target = 0;
  ViewCorners corners;
  std::size_t knots_at = 0;  ///< of a splined lens: where its corners' first knots lie in BlockNormal::knots
};

/// How the board pose of a frame couples with the shared parameters.
struct Coupling {
  std::vector<Segment> segments;  ///< those that its views depend on, ascending
  int n_rows = 0;
  std::size_t at = 0;  ///< where its rows start in the arrays of all frames: 6 columns of n_rows numbers
  std::vector<SplinePatch> patches;    ///< of splined lenses; their segments are among those
  void finish(std::size_t& n_before);  ///< n_rows and at, from the segments
};

/// The views of one frame that take part.
struct BlockFrame {
  int frame = 0;  ///< index into Calibration::T_rig_board
  std::vector<BlockView> views;
};

/// The regularisation of a splined lens is weighed once, by the corners that are there.
struct BlockSpline {
  int cam = 0, n_columns = 0;  ///< of SplineSums::strip
  double prior_scale = 0;
};

struct BlockProblem {
  Offsets offsets;
  std::vector<BlockFrame> frames;
  /// One for each frame. With a splined lens they hold its first four parameters only, and each linearisation
  /// has its own (coupling_of()).
  std::vector<Coupling> couplings;
  std::size_t n_coupling = 0,
              n_knots = 0;  ///< numbers in the couplings of all frames, and in BlockNormal::knots
  std::vector<BlockSpline> splines;
  /// Each shared parameter's number among the dense ones, which are all but control points (-1); and back.
  std::vector<int> dense, from_dense;
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
  MatX A;  ///< of the dense parameters
  VecX g;
  std::vector<SplineSums> splines;
  MatX control;  ///< work space
};

/// A = J'J and g = J'r: over the shared parameters, over each board pose, and between the two.
struct BlockNormal {
  double cost = 0;
  MatX A_ss;  ///< lower triangle
  VecX g_s;
  std::vector<Mat6> A_ff;
  std::vector<Vec6> g_f;
  std::vector<double> A_sf;         ///< of each frame, from Coupling::at
  std::vector<Coupling> couplings;  ///< empty without a splined lens
  std::vector<int> knots;           ///< first knots of each corner of a splined lens
  std::vector<BlockSums> runs;      ///< work space
};

inline const Coupling& coupling_of(const BlockProblem& problem, const BlockNormal& normal, std::size_t f) {
  return normal.couplings.empty() ? problem.couplings[f] : normal.couplings[f];
}

/// The board's pose in the camera of a view.
SE3 pose_in_camera(const BlockState& state, const BlockView& view, std::size_t frame);

/// Finds the corners' knots of all views of splined lenses, and couples each frame with the control points
/// that they need: fills normal.knots and normal.couplings. False when a corner lies outside its grid.
bool couple_splines(const BlockProblem& problem, const BlockState& state, BlockNormal& normal);

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
  /// boards stay with hold_boards. The problem must outlive the factor, and the normal equations stay what
  /// they are while it is used.
  bool make(const BlockProblem& problem, const BlockNormal& normal, Reduction reduction, bool hold_boards,
            double lambda);
  /// The step d with (A + lambda diag(A)) d = -g, or nullopt when the matrix is not positive definite.
  std::optional<BlockVector> step(const BlockVector& g) const;
  /// What the quadratic model without damping promises of the cost for a step by step(gradient).
  double predicted_gain(const BlockVector& g, const BlockVector& d) const;
  /// d' diag(A) d.
  double scaled_square(const BlockVector& d) const;

 private:
  bool eliminate_boards(MatX& S);
  const Coupling& coupling(std::size_t f) const { return coupling_of(*problem_, *normal_, f); }
  const BlockProblem* problem_ = nullptr;
  const BlockNormal* normal_ = nullptr;
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
/// \pre no splined lens
std::optional<BlockVector> mixed_gradient(const BlockProblem& problem, const BlockState& state,
                                          const BlockState& other);

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <utility>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/parallel.hpp"
#include "refine/block_normal.hpp"
#include "refine/block_runs.hpp"

namespace plumbline::detail {
namespace {

// Below this share of the largest, a diagonal entry of a board's block is damped as if it were so large.
constexpr double kLeastDiagonal = 1e-12;

// A = L L'; false when A is not positive definite.
bool cholesky(const Mat6& A, Mat6& L) {
  L = A;
  for (int j = 0; j < 6; ++j) {
    for (int k = 0; k < j; ++k) L.col(j).tail(6 - j) -= L(j, k) * L.col(k).tail(6 - j);
    if (!(L(j, j) > 0) || !std::isfinite(L(j, j))) return false;
    L.col(j).tail(6 - j) /= std::sqrt(L(j, j));
  }
  return true;
}

// B <- B L^-T, so that B A^-1 B' becomes B B'.
void divide_rows(const Mat6& L, MatX& B) {
  for (int j = 0; j < 6; ++j) {
    for (int k = 0; k < j; ++k) B.col(j) -= L(j, k) * B.col(k);
    B.col(j) /= L(j, j);
  }
}

Vec6 forward(const Mat6& L, Vec6 b) {
  for (int j = 0; j < 6; ++j) {
    b[j] /= L(j, j);
    b.tail(5 - j) -= b[j] * L.col(j).tail(5 - j);
  }
  return b;
}

Vec6 backward(const Mat6& L, Vec6 b) {
  for (int j = 5; j >= 0; --j) b[j] = (b[j] - L.col(j).tail(5 - j).dot(b.tail(5 - j))) / L(j, j);
  return b;
}

}  // namespace

std::optional<BlockFactor> BlockFactor::make(const BlockProblem& problem, const BlockNormal& normal,
                                             std::vector<int> free, bool hold_boards, double lambda) {
  BlockFactor factor;
  factor.problem_ = &problem;
  factor.free_ = std::move(free);
  factor.lambda_ = lambda;
  factor.D_s_ = normal.A_ss.diagonal().cwiseMax(1e-300);
  MatX S = normal.A_ss;
  S.diagonal() += lambda * factor.D_s_;
  if (!hold_boards) {
    factor.frames_.resize(problem.frames.size());
    const Runs runs(problem.frames.size());
    std::vector<MatX> sums(static_cast<std::size_t>(runs.n_runs));
    std::vector<char> ok(sums.size(), 1);
    parallel_for(runs.n_runs, problem.n_threads, [&](int run) {
      MatX& sum = sums[static_cast<std::size_t>(run)];
      sum = MatX::Zero(S.rows(), S.cols());
      for (int i = runs.first(run); i < runs.first(run + 1); ++i) {
        const FrameNormal& frame = normal.frames[static_cast<std::size_t>(i)];
        const std::vector<int>& shared = problem.frames[static_cast<std::size_t>(i)].shared;
        Eliminated& e = factor.frames_[static_cast<std::size_t>(i)];
        e.D = frame.A_ff.diagonal().cwiseMax(kLeastDiagonal * frame.A_ff.diagonal().maxCoeff());
        Mat6 A = frame.A_ff;
        A.diagonal() += lambda * e.D;
        if (!cholesky(A, e.L)) {
          ok[static_cast<std::size_t>(run)] = 0;
          return;
        }
        e.B = frame.A_sf;
        divide_rows(e.L, e.B);
        sum(shared, shared) += e.B * e.B.transpose();
      }
    });
    if (std::find(ok.begin(), ok.end(), 0) != ok.end()) return std::nullopt;
    for (const MatX& sum : sums) S -= sum;
  }
  // To a unit diagonal: parameters of unlike units.
  factor.scale_ = VecX(factor.D_s_(factor.free_)).cwiseSqrt().cwiseInverse();
  factor.S_ = factor.scale_.asDiagonal() * MatX(S(factor.free_, factor.free_)) * factor.scale_.asDiagonal();
  return factor;
}

std::optional<BlockVector> BlockFactor::step(const BlockVector& g) const {
  VecX b = g.shared;
  std::vector<Vec6> y(frames_.size());
  for (std::size_t f = 0; f < frames_.size(); ++f) {
    y[f] = forward(frames_[f].L, g.boards[f]);
    b(problem_->frames[f].shared) -= frames_[f].B * y[f];
  }
  BlockVector d{VecX::Zero(b.size()), std::vector<Vec6>(problem_->frames.size(), Vec6::Zero())};
  if (!free_.empty()) {
    const auto x = solve_spd(S_, scale_.cwiseProduct(VecX(b(free_))));
    if (!x) return std::nullopt;
    d.shared(free_) = -scale_.cwiseProduct(VecX(*x));
  }
  for (std::size_t f = 0; f < frames_.size(); ++f) {
    const Eliminated& e = frames_[f];
    d.boards[f] = -backward(e.L, y[f] + e.B.transpose() * d.shared(problem_->frames[f].shared));
  }
  return d;
}

// -g'd - d'Ad/2, which by (A + lambda D) d = -g is (lambda d'Dd - g'd)/2: written so, it cannot cancel below
// zero.
double BlockFactor::predicted_gain(const BlockVector& g, const BlockVector& d) const {
  double slope = g.shared.dot(d.shared);
  for (std::size_t f = 0; f < frames_.size(); ++f) slope += g.boards[f].dot(d.boards[f]);
  return 0.5 * (lambda_ * scaled_square(d) - slope);
}

double BlockFactor::scaled_square(const BlockVector& d) const {
  double sum = d.shared.cwiseAbs2().dot(D_s_);
  for (std::size_t f = 0; f < frames_.size(); ++f) sum += d.boards[f].cwiseAbs2().dot(frames_[f].D);
  return sum;
}

}  // namespace plumbline::detail

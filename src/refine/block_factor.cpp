// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <utility>

#include "plumbline/core/linalg.hpp"
#include "refine/block_normal.hpp"
#include "refine/block_runs.hpp"

namespace plumbline::detail {
namespace {

// Below this share of the largest, a diagonal entry of a board's block is damped as if it were so large.
constexpr double kLeastDiagonal = 1e-12;

// A matrix of more shared parameters than this is too large to have one for each run of frames; its columns
// are shared out among the threads instead, so many at a time.
constexpr int kMostDense = 250, kPanel = 64;

Vec6 forward(const Mat6& L, Vec6 b) {
  for (int j = 0; j < 6; ++j) {
    b[j] /= L(j, j);
    for (int i = j + 1; i < 6; ++i) b[i] -= b[j] * L(i, j);
  }
  return b;
}

Vec6 backward(const Mat6& L, Vec6 b) {
  for (int j = 5; j >= 0; --j) {
    for (int i = j + 1; i < 6; ++i) b[j] -= L(i, j) * b[i];
    b[j] /= L(j, j);
  }
  return b;
}

// b(shared) -= B y
void subtract_product(const Coupling& coupling, const double* B, const Vec6& y, VecX& b) {
  const int n = coupling.n_rows;
  int row = 0;
  for (const Segment& s : coupling.segments) {
    for (int i = 0; i < s.n; ++i, ++row) {
      const double* r = B + row;
      b[s.first + i] -= (r[0] * y[0] + r[n] * y[1]) + (r[2 * n] * y[2] + r[3 * n] * y[3]) +
                        (r[4 * n] * y[4] + r[5 * n] * y[5]);
    }
  }
}

// y += B' d(shared)
void add_transposed_product(const Coupling& coupling, const double* B, const VecX& d, Vec6& y) {
  const int n = coupling.n_rows;
  for (int k = 0; k < 6; ++k) {
    const double* r = B + k * n;
    double sum = 0;
    for (const Segment& s : coupling.segments) {
      for (int i = 0; i < s.n; ++i) sum += r[i] * d[s.first + i];
      r += s.n;
    }
    y[k] += sum;
  }
}

// The matrix over the free numbers: rows and columns that share one are summed. \param A  lower triangle
MatX reduced(const MatX& A, const Reduction& reduction) {
  MatX out = MatX::Zero(reduction.n_free, reduction.n_free);
  for (int j = 0; j < A.cols(); ++j) {
    const int b = reduction.column[j];
    if (b < 0) continue;
    for (int i = j; i < A.rows(); ++i) {
      const int a = reduction.column[i];
      if (a < 0) continue;
      out(a, b) += A(i, j);
      if (i != j) out(b, a) += A(i, j);
    }
  }
  return out;
}

}  // namespace

bool BlockFactor::eliminate_boards(MatX& S) {
  const std::size_t n_frames = problem_->frames.size();
  L_ = normal_->A_ff;
  B_ = normal_->A_sf;
  D_f_.resize(n_frames);
  const Runs runs(n_frames);
  const bool in_panels = S.rows() > kMostDense;
  const KernelSet& kernels = best_kernels();
  runs_.resize(in_panels ? 1 : static_cast<std::size_t>(runs.n_runs));
  const auto add_outer = [&](std::size_t f, MatX& sum, int first, int end) {
    const Coupling& c = coupling(f);
    kernels.add_outer(B_.data() + c.at, c.n_rows, c.segments.data(), static_cast<int>(c.segments.size()),
                      sum.data(), static_cast<int>(sum.rows()), first, end);
  };
  std::vector<char> ok(static_cast<std::size_t>(runs.n_runs), 1);
  problem_->workers->run(runs.n_runs, [&](int run) {
    if (!in_panels) runs_[static_cast<std::size_t>(run)].setZero(S.rows(), S.cols());
    for (int i = runs.first(run); i < runs.first(run + 1); ++i) {
      const auto f = static_cast<std::size_t>(i);
      D_f_[f] = L_[f].diagonal().cwiseMax(kLeastDiagonal * L_[f].diagonal().maxCoeff());
      L_[f].diagonal() += lambda_ * D_f_[f];
      if (!kernels.eliminate(L_[f].data(), B_.data() + coupling(f).at, coupling(f).n_rows)) {
        ok[static_cast<std::size_t>(run)] = 0;
        return;
      }
      if (!in_panels) add_outer(f, runs_[static_cast<std::size_t>(run)], 0, static_cast<int>(S.cols()));
    }
  });
  if (std::find(ok.begin(), ok.end(), 0) != ok.end()) return false;
  if (in_panels) {
    const int n = static_cast<int>(S.cols());
    runs_[0].setZero(n, n);
    problem_->workers->run((n + kPanel - 1) / kPanel, [&](int panel) {
      for (std::size_t f = 0; f < n_frames; ++f)
        add_outer(f, runs_[0], panel * kPanel, std::min(n, (panel + 1) * kPanel));
    });
  }
  for (const MatX& sum : runs_) S -= sum;
  return true;
}

bool BlockFactor::make(const BlockProblem& problem, const BlockNormal& normal, Reduction reduction,
                       bool hold_boards, double lambda) {
  problem_ = &problem;
  normal_ = &normal;
  reduction_ = std::move(reduction);
  lambda_ = lambda;
  hold_boards_ = hold_boards;
  MatX S = normal.A_ss;
  if (!hold_boards && !eliminate_boards(S)) return false;
  const VecX D = reduced(normal.A_ss, reduction_).diagonal().cwiseMax(1e-300);
  S_ = reduced(S, reduction_);
  S_.diagonal() += lambda * D;
  scale_ = D.cwiseSqrt().cwiseInverse();  // to a unit diagonal: parameters of unlike units
  S_ = (scale_.asDiagonal() * S_ * scale_.asDiagonal()).eval();
  D_s_ = VecX::Zero(S.rows());
  std::vector<bool> counted(static_cast<std::size_t>(reduction_.n_free), false);
  for (int i = 0; i < S.rows(); ++i) {
    const int column = reduction_.column[i];
    if (column < 0 || counted[column]) continue;
    counted[column] = true;
    D_s_[i] = D[column];
  }
  return true;
}

std::optional<BlockVector> BlockFactor::step(const BlockVector& g) const {
  const std::size_t n_frames = problem_->frames.size();
  BlockVector d{VecX::Zero(g.shared.size()), std::vector<Vec6>(n_frames, Vec6::Zero())};
  VecX b = g.shared;
  if (!hold_boards_) {
    for (std::size_t f = 0; f < n_frames; ++f) {
      d.boards[f] = forward(L_[f], g.boards[f]);
      subtract_product(coupling(f), B_.data() + coupling(f).at, d.boards[f], b);
    }
  }
  if (reduction_.n_free > 0) {
    VecX b_free = VecX::Zero(reduction_.n_free);
    for (int i = 0; i < b.size(); ++i) {
      if (reduction_.column[i] >= 0) b_free[reduction_.column[i]] += b[i];
    }
    const auto x = solve_spd(S_, scale_.cwiseProduct(b_free));
    if (!x) return std::nullopt;
    for (int i = 0; i < b.size(); ++i) {
      const int column = reduction_.column[i];
      if (column >= 0) d.shared[i] = -scale_[column] * (*x)(column, 0);
    }
  }
  if (!hold_boards_) {
    for (std::size_t f = 0; f < n_frames; ++f) {
      add_transposed_product(coupling(f), B_.data() + coupling(f).at, d.shared, d.boards[f]);
      d.boards[f] = -backward(L_[f], d.boards[f]);
    }
  }
  return d;
}

// -g'd - d'Ad/2, which by (A + lambda D) d = -g is (lambda d'Dd - g'd)/2: written so, it cannot cancel below
// zero.
double BlockFactor::predicted_gain(const BlockVector& g, const BlockVector& d) const {
  double slope = g.shared.dot(d.shared);
  for (std::size_t f = 0; f < D_f_.size(); ++f) slope += g.boards[f].dot(d.boards[f]);
  return 0.5 * (lambda_ * scaled_square(d) - slope);
}

double BlockFactor::scaled_square(const BlockVector& d) const {
  double sum = d.shared.cwiseAbs2().dot(D_s_);
  for (std::size_t f = 0; f < D_f_.size(); ++f) sum += d.boards[f].cwiseAbs2().dot(D_f_[f]);
  return sum;
}

}  // namespace plumbline::detail

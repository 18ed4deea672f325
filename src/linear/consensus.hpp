// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "plumbline/core/check.hpp"
#include "plumbline/core/parallel.hpp"
#include "plumbline/core/random.hpp"
#include "plumbline/linear/ransac.hpp"

/// The search that every robust estimator of the module shares. Private to the module.
namespace plumbline::detail {

/// Throws std::invalid_argument when an option is out of its range.
void check_options(const RansacOptions& options);

/// `size` different indices below n, the same for the same seed and hypothesis.
void draw_sample(std::uint64_t seed, int hypothesis, int n, std::span<int> sample);

/// Samples to draw so that one holds inliers only with the wanted probability.
int hypotheses_needed(int n_inliers, int n, int sample_size, double confidence, int most);

template <class Model>
struct Scored {
  Model model;
  double score = std::numeric_limits<double>::infinity();  // sum of min(e^2 / inlier_px^2, 1)
};

/// Score of a model, or anything at least `bound` as soon as it is known to reach that.
template <class Model, class Errors>
double score_of(const Model& model, int n, Errors&& errors, double inlier_px, double bound) {
  constexpr int kBlock = 128;
  double e2[kBlock], score = 0;
  const double unit = 1 / (inlier_px * inlier_px);
  for (int first = 0; first < n && score < bound; first += kBlock) {
    const int count = std::min(kBlock, n - first);
    errors(model, first, std::span<double>(e2, static_cast<std::size_t>(count)));
    for (int i = 0; i < count; ++i) {
      const double e = e2[i] * unit;
      score += e < 1 ? e : 1.0;  // NaN counts as an outlier
    }
  }
  return score;
}

template <class Model, class Errors>
Consensus consensus_of(const Model& model, int n, Errors&& errors, double inlier_px) {
  Consensus c;
  std::vector<double> e2(static_cast<std::size_t>(n));
  errors(model, 0, std::span<double>(e2));
  double sum = 0;
  c.inlier.reserve(e2.size());
  for (double e : e2) {
    const bool is_inlier = e <= inlier_px * inlier_px;
    c.inlier.push_back(is_inlier);
    c.n_inliers += is_inlier;
    if (is_inlier) sum += e;
  }
  c.rms_px = c.n_inliers > 0 ? std::sqrt(sum / c.n_inliers) : 0.0;
  return c;
}

/// Indices of the inliers.
std::vector<int> inlier_indices(const Consensus& consensus);

/// The model with the best score over samples, nullopt when no sample gives one.
/// - solve(sample indices, std::vector<Model>& out) appends the models of a minimal sample (none:
/// degenerate);
/// - errors(model, first, span out) writes the squared errors [px^2] of correspondences first, first + 1, ...
///   (infinity for one that the model cannot see);
/// - refit(model, inlier indices) gives a model fitted to them, or nullopt; called without threads.
/// Hypotheses are drawn in rounds whose sizes depend on nothing but the round, and within a round the
/// smallest index wins a draw, so that neither the answer nor n_hypotheses depends on the number of threads.
template <class Model, class Solve, class Errors, class Refit>
std::optional<Found<Model>> find_consensus(int n, int sample_size, const RansacOptions& options,
                                           Solve&& solve, Errors&& errors, Refit&& refit) {
  check_options(options);
  PLUMBLINE_CHECK(sample_size >= 1 && n >= sample_size,
                  "find_consensus needs as many points as a sample has");
  constexpr int kFirstRound = 16, kLargestRound = 512, kMostRefits = 5;
  std::optional<Scored<Model>> best;
  int drawn = 0, needed = options.max_hypotheses, round = kFirstRound;
  while (drawn < needed) {
    const int count = std::min(round, options.max_hypotheses - drawn);
    const double bound = best ? best->score : std::numeric_limits<double>::infinity();
    std::vector<std::optional<Scored<Model>>> found(static_cast<std::size_t>(count));
    parallel_for(count, options.n_threads, [&](int k) {
      std::vector<int> sample(static_cast<std::size_t>(sample_size));
      draw_sample(options.seed, drawn + k, n, sample);
      std::vector<Model> models;
      solve(std::span<const int>(sample), models);
      auto& mine = found[static_cast<std::size_t>(k)];
      for (Model& model : models) {
        const double limit = mine ? mine->score : bound;
        const double score = score_of(model, n, errors, options.inlier_px, limit);
        if (score < limit) mine = Scored<Model>{std::move(model), score};
      }
    });
    drawn += count;
    round = std::min(2 * round, kLargestRound);
    bool improved = false;
    for (auto& candidate : found) {
      if (!candidate || (best && !(candidate->score < best->score))) continue;
      best = std::move(candidate);
      improved = true;
    }
    if (!improved) continue;
    for (int k = 0; k < kMostRefits; ++k) {
      const std::vector<int> inliers =
          inlier_indices(consensus_of(best->model, n, errors, options.inlier_px));
      std::optional<Model> model = refit(best->model, std::span<const int>(inliers));
      if (!model) break;
      const double score = score_of(*model, n, errors, options.inlier_px, best->score);
      if (!(score < best->score)) break;
      best = Scored<Model>{std::move(*model), score};
    }
    const Consensus c = consensus_of(best->model, n, errors, options.inlier_px);
    needed = hypotheses_needed(c.n_inliers, n, sample_size, options.confidence, options.max_hypotheses);
  }
  if (!best) return std::nullopt;
  Found<Model> result{std::move(best->model), {}};
  result.consensus = consensus_of(result.model, n, errors, options.inlier_px);
  result.consensus.n_hypotheses = drawn;
  return result;
}

}  // namespace plumbline::detail

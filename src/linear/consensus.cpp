// SPDX-License-Identifier: Apache-2.0
#include "linear/consensus.hpp"

namespace plumbline::detail {

void check_options(const RansacOptions& o) {
  PLUMBLINE_CHECK(o.inlier_px > 0 && std::isfinite(o.inlier_px), "RansacOptions::inlier_px must be above 0");
  PLUMBLINE_CHECK(o.confidence > 0 && o.confidence < 1, "RansacOptions::confidence must be in (0, 1)");
  PLUMBLINE_CHECK(o.max_hypotheses >= 1, "RansacOptions::max_hypotheses must be 1 or more");
}

void draw_sample(std::uint64_t seed, int hypothesis, int n, std::span<int> sample) {
  // One step of the generator between the two, so that seeds and hypotheses do not run into one another.
  Rng rng(Rng(seed).bits() + static_cast<std::uint64_t>(hypothesis));
  for (std::size_t k = 0; k < sample.size(); ++k) {
    const auto drawn = sample.first(k);
    do {
      sample[k] = rng.index(n);
    } while (std::find(drawn.begin(), drawn.end(), sample[k]) != drawn.end());
  }
}

int hypotheses_needed(int n_inliers, int n, int sample_size, double confidence, int most) {
  double all_inliers = 1;  // probability, without replacement
  for (int k = 0; k < sample_size; ++k) all_inliers *= std::max(0.0, double(n_inliers - k) / (n - k));
  if (all_inliers >= 1) return 1;
  if (!(all_inliers > 0)) return most;
  const double needed = std::ceil(std::log1p(-confidence) / std::log1p(-all_inliers));
  return needed < most ? std::max(1, static_cast<int>(needed)) : most;
}

std::vector<int> inlier_indices(const Consensus& consensus) {
  std::vector<int> indices;
  indices.reserve(static_cast<std::size_t>(consensus.n_inliers));
  for (std::size_t i = 0; i < consensus.inlier.size(); ++i) {
    if (consensus.inlier[i]) indices.push_back(static_cast<int>(i));
  }
  return indices;
}

}  // namespace plumbline::detail

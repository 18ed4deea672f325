// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <vector>

namespace plumbline {

/// How an estimator looks for the answer that most correspondences agree on: RANSAC (Fischler & Bolles 1981)
/// with the truncated squared error as its score (MSAC, Torr & Zisserman 2000) and a refit to the inliers of
/// every new best answer (LO-RANSAC, Chum, Matas & Kittler 2003). The same seed gives the same answer for any
/// number of threads.
struct RansacOptions {
  double inlier_px = 2.0;  ///< a correspondence is an inlier when its error is at most this [px]; which error
                           ///< is meant each estimator says. > 0
  double confidence =
      0.9999;  ///< stop when an outlier-free sample has been drawn with this probability. In (0, 1)
  int max_hypotheses = 20000;  ///< samples drawn at most. >= 1
  std::uint64_t seed = 0;
  int n_threads = 1;  ///< <= 0: all cores
};

/// Who agrees with an answer.
struct Consensus {
  std::vector<bool> inlier;  ///< one per correspondence
  int n_inliers = 0;
  double rms_px = 0;     ///< root mean square error of the inliers, in the estimator's own error [px]
  int n_hypotheses = 0;  ///< samples drawn
};

template <class Model>
struct Found {
  Model model;
  Consensus consensus;
};

}  // namespace plumbline

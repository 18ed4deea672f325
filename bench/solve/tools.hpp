// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <ctime>
#include <optional>

#include "solve/sets.hpp"

namespace bench {

struct Outcome {
  plumbline::Rig rig;
  double seconds = 0;  ///< CPU time of the process, all threads
  double wall_s = 0;
  double rms_xy_px = 0;  ///< as the tool's own residuals say, per coordinate
  int iterations = 0;
};

inline double clock_s(clockid_t which) {
  timespec t{};
  clock_gettime(which, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Runs from construction to stop(): what counts as the tool's time.
class Stopwatch {
 public:
  void stop(Outcome& outcome) const {
    outcome.seconds = clock_s(CLOCK_PROCESS_CPUTIME_ID) - cpu_;
    outcome.wall_s = clock_s(CLOCK_MONOTONIC) - wall_;
  }

 private:
  double cpu_ = clock_s(CLOCK_PROCESS_CPUTIME_ID), wall_ = clock_s(CLOCK_MONOTONIC);
};

/// Each solves the set from its start (OpenCV makes its own), which it may overwrite; nullopt when the tool
/// cannot or fails.
std::optional<Outcome> run_plumbline(SolveSet& set, int n_threads);
/// calibrate() from the corners alone: seed, outliers, solve, covariance.
std::optional<Outcome> run_procedure(SolveSet& set, int n_threads);
std::optional<Outcome> run_our_ceres(SolveSet& set);  ///< our reference: an analytic cost for each view
std::optional<Outcome> run_autodiff(SolveSet& set, bool tight);  ///< Ceres as a user would write it
std::optional<Outcome> run_opencv(SolveSet& set,
                                  bool use_lu);   ///< calibrateCamera, stereoCalibrate, fisheye
std::optional<Outcome> run_mrcal(SolveSet& set);  ///< mrcal_optimize without extras

}  // namespace bench

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "plumbline/rig/dataset.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline::bench {

/// A rendered photograph; no corners: there is no board in it.
struct Shot {
  cv::Mat grey;
  std::vector<Corner> truth;  ///< all corners in the image by 2 px, exactly projected
  std::vector<Corner> rim;    ///< those nearer to its border: neither asked for nor wrong
};

/// How the photographs of one kind are made. Grey levels are 0..255.
struct Kind {
  std::string name;
  ImageSize size{1920, 1200};
  double blur_px = 0.7, noise = 3, contrast = 170;
  double fov_deg = 70;
  std::string lens = "opencv5";
  double tilt_low_deg = 0, tilt_high_deg = 40;
  double vignetting = 0;
  int jpeg_quality = 0;  ///< 0: not compressed
  bool is_partial = false;
  bool is_small = false;
};

/// Boards that the renders show: their name in the table, and how large a square (tag) is drawn [px].
struct Subject {
  std::string name;
  TargetSpec spec;
  double low_px, high_px, small_low_px, small_high_px;
};

std::vector<Subject> subjects();
std::vector<Kind> kinds();

/// n photographs of the board, the same for the same seed. Rendered by plumbline::render, which knows nothing
/// of the detectors: each pixel's corners are traced through the lens to the board and the black area between
/// them is exact. Halved sizes when `is_quick`.
std::vector<Shot> shots(const Subject& subject, const Kind& kind, int n, std::uint64_t seed, bool is_quick);

/// Images without the board: "noise", "stripes", "text", "other board", "mirrored".
std::vector<std::string> empty_kinds();
/// nullopt-like: an empty list where a mirrored board cannot be told from the board (chessboards).
std::vector<Shot> empty_shots(const Subject& subject, const std::string& kind, int n, std::uint64_t seed,
                              bool is_quick);

}  // namespace plumbline::bench

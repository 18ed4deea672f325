// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "detect/finders.hpp"
#include "detect/lattice_order.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Larger images are searched at this size first: the finder's time grows with the pixels, its reach does
/// not.
constexpr int kSearchSize = 1400;
/// Smaller ones are also searched at twice their size: the finder erodes the squares by whole pixels.
constexpr int kUpscaleBelow = 1500;
/// Fraction of the distance to the nearest other corner that a window may cover.
constexpr double kWindowFraction = 0.38;

cv::Mat scaled(const cv::Mat& grey, double scale) {
  cv::Mat out;
  cv::resize(grey, out, cv::Size(), scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
  return out;
}

enum class Finder { kClassic, kSectorBased };

/// The lattice as the finder gives it, in pixels of `grey`, searched at `scale`; empty px when it is not
/// found.
LatticePoints find(const cv::Mat& grey, const Chessboard& board, double scale, Finder finder) {
  const cv::Mat image = scale == 1.0 ? grey : scaled(grey, scale);
  const cv::Size size(board.columns, board.rows);
  std::vector<cv::Point2f> corners;
  bool found = false;
  try {
    if (finder == Finder::kClassic) {
      found = cv::findChessboardCorners(image, size, corners,
                                        cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE);
    } else {
      // Without NORMALIZE_IMAGE: on six dark photographs of screens it finds six boards instead of two.
      found = cv::findChessboardCornersSB(image, size, corners, 0);
    }
  } catch (const cv::Exception&) {
    found = false;  // the finders assert on some images without structure; to the user that is "not found"
  }
  LatticePoints out{board.columns, board.rows, {}};
  if (!found || corners.size() != static_cast<std::size_t>(board.columns * board.rows)) return out;
  const double sx = static_cast<double>(grey.cols) / image.cols,
               sy = static_cast<double>(grey.rows) / image.rows;
  for (const cv::Point2f& p : corners) out.px.emplace_back((p.x + 0.5) * sx - 0.5, (p.y + 0.5) * sy - 0.5);
  return out;
}

/// Mean difference between the cells (squares between four corners) whose c + r is even and the others.
double even_minus_odd(const cv::Mat& grey, const LatticePoints& p) {
  double sum[2] = {0, 0};
  int n[2] = {0, 0};
  for (int r = 0; r + 1 < p.rows; ++r) {
    for (int c = 0; c + 1 < p.columns; ++c) {
      sum[(c + r) % 2] +=
          sample(grey, (p.at(c, r) + p.at(c + 1, r) + p.at(c, r + 1) + p.at(c + 1, r + 1)) / 4);
      ++n[(c + r) % 2];
    }
  }
  if (n[1] == 0) return 0;  // 2 x 2 corners have one cell only
  return sum[0] / n[0] - sum[1] / n[1];
}

/// Board's own numbering: the square diagonal to point 0 is black where the colours can tell, see
/// docs/detect.md.
std::optional<LatticePoints> number(const cv::Mat& grey, const LatticePoints& found) {
  const auto black_first = [&](const LatticePoints& p) { return even_minus_odd(grey, p) < 0; };
  if (auto oriented = orient(found, black_first)) return oriented;
  // A board whose every numbering begins at a white square (both counts even, or colours exchanged on a
  // screen).
  return orient(found, [](const LatticePoints&) { return true; });
}

std::vector<CornerStart> starts_of(const LatticePoints& points, double search_scale) {
  std::vector<CornerStart> starts;
  for (int r = 0; r < points.rows; ++r) {
    for (int c = 0; c < points.columns; ++c) {
      const double reach = kWindowFraction * neighbour_distance(points, c, r);
      // A corner found at reduced size may be off by a pixel of that size.
      starts.push_back(
          {points.at(c, r), half_window(reach), std::max({2.0, 0.75 * reach, 1.5 / search_scale})});
    }
  }
  return starts;
}

struct Refined {
  LatticePoints points;
  std::vector<double> sigma;
};

/// All corners refined, or what is wrong with them.
std::variant<Refined, std::string> refine(const cv::Mat& grey, const LatticePoints& found,
                                          double search_scale) {
  if (const auto broken = broken_lattice(found)) return *broken;
  const double noise = noise_level(grey, bounding_box(found.px, grey));
  Refined out{found, {}};
  const auto refined = refine_corners(grey, starts_of(found, search_scale), noise);
  for (std::size_t i = 0; i < refined.size(); ++i) {
    // At the image's border no window fits: the finder's own refinement (5x5 pixels) stays, with an error to
    // match.
    if (refined[i]) out.points.px[i] = refined[i]->px;
    out.sigma.push_back(refined[i] ? refined[i]->sigma_px : 0.5 / std::min(1.0, search_scale));
  }
  if (const auto broken = broken_lattice(out.points)) return *broken;
  const auto unrefined = std::count(refined.begin(), refined.end(), std::nullopt);
  if (4 * unrefined > static_cast<long>(refined.size())) {
    return fmt::format("{} of {} corners have no edges around them", unrefined, refined.size());
  }
  return out;
}

struct Attempt {
  Finder finder;
  double scale;
};

std::vector<Attempt> attempts(const cv::Mat& grey) {
  const int longest = std::max(grey.cols, grey.rows);
  std::vector<Attempt> list;
  const bool is_large = longest > 1.5 * kSearchSize;
  if (is_large) list.push_back({Finder::kClassic, static_cast<double>(kSearchSize) / longest});
  list.push_back({Finder::kClassic, 1.0});
  list.push_back({Finder::kSectorBased, is_large ? static_cast<double>(kSearchSize) / longest : 1.0});
  if (longest < kUpscaleBelow) list.push_back({Finder::kClassic, 2.0});
  return list;
}

}  // namespace

Detection detect_chessboard(const cv::Mat& grey, const Chessboard& board) {
  Detection out;
  out.reason = fmt::format("no {}x{} chessboard found in {}x{} pixels", board.columns, board.rows, grey.cols,
                           grey.rows);
  if (board.columns < 3 || board.rows < 3) {
    out.reason = fmt::format("a chessboard needs at least 3x3 inner corners to be found, this one has {}x{}",
                             board.columns, board.rows);
    return out;
  }
  for (const Attempt& attempt : attempts(grey)) {
    const LatticePoints found = find(grey, board, attempt.scale, attempt.finder);
    if (found.px.empty()) continue;
    const auto refined = refine(grey, found, attempt.scale);
    if (const auto* why = std::get_if<std::string>(&refined)) {
      out.reason =
          fmt::format("what looked like a {}x{} chessboard is none: {}", board.columns, board.rows, *why);
      continue;
    }
    const Refined& good = std::get<Refined>(refined);
    const auto numbered = number(grey, good.points);
    if (!numbered) continue;
    // The numbering is a permutation of the refined points: carry each point's sigma along.
    for (std::size_t i = 0; i < numbered->px.size(); ++i) {
      const auto from =
          std::find(good.points.px.begin(), good.points.px.end(), numbered->px[i]) - good.points.px.begin();
      out.corners.push_back(
          {static_cast<int>(i), numbered->px[i], good.sigma[static_cast<std::size_t>(from)]});
    }
    out.method = attempt.finder == Finder::kClassic ? "cornerSubPix" : kFoundBySb;
    out.reason.clear();
    return out;
  }
  return out;
}

}  // namespace plumbline::detail

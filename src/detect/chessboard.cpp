// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "detect/chess_search.hpp"
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

cv::Mat scaled(const cv::Mat& grey, double scale) {
  cv::Mat out;
  cv::resize(grey, out, cv::Size(), scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
  return out;
}

/// Lattices with a smaller share of the board's corners are taken for none: the borrowed finders need seconds
/// to see that there is no board.
constexpr double kMinEvidence = 2.0;

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

ChessGrid grid_of(const LatticePoints& points) {
  ChessGrid grid(points.columns, points.rows);
  for (std::size_t i = 0; i < points.px.size(); ++i) grid.px[i] = points.px[i];
  return grid;
}

/// The corners that a borrowed finder gives, or what is wrong with them: it finds whole boards only.
std::variant<std::vector<ChessCorner>, std::string> refine_whole(const cv::Mat& grey,
                                                                 const LatticePoints& points, double scale) {
  const double noise = noise_level(grey, bounding_box(points.px, grey));
  auto corners = refine_grid(grey, grid_of(points), scale, noise);
  const std::size_t all = points.px.size();
  if (4 * (all - corners.size()) > all)
    return fmt::format("{} of {} corners have no edges around them", all - corners.size(), all);
  return corners;
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

Detection found(const std::vector<ChessCorner>& corners, const char* method) {
  Detection out;
  for (const ChessCorner& c : corners) out.corners.push_back({c.point, c.px, c.sigma_px});
  out.method = method;
  return out;
}

/// OpenCV's finders, where ours sees a lattice but not the board.
Detection by_borrowed_finders(const cv::Mat& grey, const Chessboard& board) {
  Detection out;
  for (const Attempt& attempt : attempts(grey)) {
    const LatticePoints points = find(grey, board, attempt.scale, attempt.finder);
    if (points.px.empty()) continue;
    if (const auto broken = broken_lattice(points)) {
      out.reason =
          fmt::format("what looked like a {}x{} chessboard is none: {}", board.columns, board.rows, *broken);
      continue;
    }
    const auto numbered = number(grey, points);
    if (!numbered) continue;
    const auto refined = refine_whole(grey, *numbered, attempt.scale);
    if (const auto* why = std::get_if<std::string>(&refined)) {
      out.reason =
          fmt::format("what looked like a {}x{} chessboard is none: {}", board.columns, board.rows, *why);
      continue;
    }
    return found(std::get<std::vector<ChessCorner>>(refined),
                 attempt.finder == Finder::kClassic ? "saddle fit" : kFoundBySb);
  }
  return out;
}

}  // namespace

Detection detect_chessboard(const cv::Mat& grey, const Chessboard& board) {
  Detection out;
  if (board.columns < 3 || board.rows < 3) {
    out.reason = fmt::format("a chessboard needs at least 3x3 inner corners to be found, this one has {}x{}",
                             board.columns, board.rows);
    return out;
  }
  const ChessSearch search = search_chessboard(grey, board);
  if (search.grid.count() > 0) {
    std::vector<Vec2> px;
    for (const auto& p : search.grid.px) {
      if (p) px.push_back(*p);
    }
    const double noise = noise_level(grey, bounding_box(px, grey));
    const auto corners = refine_grid(grey, search.grid, search.scale, noise);
    if (5 * corners.size() >= 4 * px.size()) return found(corners, "saddle fit");
  }
  if (out.corners.empty() && out.reason.empty()) {
    out.reason = fmt::format("no {}x{} chessboard found in {}x{} pixels", board.columns, board.rows,
                             grey.cols, grey.rows);
    if (!search.reason.empty()) out.reason += ": " + search.reason;
  }
  return out;
}

}  // namespace plumbline::detail

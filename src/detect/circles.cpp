// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "detect/disc_fit.hpp"
#include "detect/finders.hpp"
#include "detect/lattice_order.hpp"
#include "detect/median.hpp"
#include "detect/outline.hpp"
#include "detect/planar.hpp"
#include "detect/subpixel.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {
namespace {

constexpr double kAlike = 0.6;  ///< of the usual contrast: a circle beyond the grid is one of a larger grid

Vec2 board_point(const Circles& b, int i) {
  const int c = i % b.columns, r = i / b.columns;
  return b.asymmetric ? Vec2(2 * c + r % 2, r) : Vec2(c, r);
}

cv::Ptr<cv::SimpleBlobDetector> blob_detector(const cv::Mat& image, int n_circles) {
  cv::SimpleBlobDetector::Params p;
  const auto pixels = static_cast<float>(image.total());
  p.minThreshold = 10;
  p.maxThreshold = 240;
  p.thresholdStep = 10;
  p.minArea = 12;
  p.maxArea = pixels / static_cast<float>(
                           n_circles);  // the circles of a board that fills the image cover a third of it
  p.minDistBetweenBlobs = std::max(3.0F, std::sqrt(pixels) / 200);
  p.minCircularity = 0.5F;
  p.filterByCircularity = true;
  p.minConvexity = 0.85F;
  p.minInertiaRatio = 0.05F;
  return cv::SimpleBlobDetector::create(p);
}

/// Blobs found beforehand. findCirclesGrid's search grows without bound on the thousands of blobs of a noisy
/// picture, so it is given no more than three for each circle: the largest, since what is not a circle is
/// mostly small.
class GivenBlobs : public cv::Feature2D {
 public:
  GivenBlobs(const cv::Mat& image, int n_circles) {
    blob_detector(image, n_circles)->detect(image, blobs_);
    std::stable_sort(blobs_.begin(), blobs_.end(),
                     [](const auto& a, const auto& b) { return a.size > b.size; });
    blobs_.resize(std::min(blobs_.size(), static_cast<std::size_t>(3 * n_circles)));
  }
  std::size_t size() const { return blobs_.size(); }
  void detect(cv::InputArray, std::vector<cv::KeyPoint>& keypoints, cv::InputArray) override {
    keypoints = blobs_;
  }

 private:
  std::vector<cv::KeyPoint> blobs_;
};

LatticePoints find(const cv::Mat& grey, const Circles& board, double scale, int flags) {
  cv::Mat image = grey;
  if (scale != 1.0)
    cv::resize(grey, image, cv::Size(), scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
  std::vector<cv::Point2f> centres;
  bool found = false;
  try {
    flags |= board.asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
    const int n = board.columns * board.rows;
    const auto blobs = cv::makePtr<GivenBlobs>(image, n);
    if (blobs->size() < static_cast<std::size_t>(n)) return {board.columns, board.rows, {}};
    found = cv::findCirclesGrid(image, cv::Size(board.columns, board.rows), centres, flags, blobs);
  } catch (const cv::Exception&) {
    found = false;  // the finder asserts where blobs do not form what it expects
  }
  LatticePoints out{board.columns, board.rows, {}};
  if (!found || centres.size() != static_cast<std::size_t>(board.columns * board.rows)) return out;
  const double sx = static_cast<double>(grey.cols) / image.cols,
               sy = static_cast<double>(grey.rows) / image.rows;
  for (const cv::Point2f& p : centres) out.px.emplace_back((p.x + 0.5) * sx - 0.5, (p.y + 0.5) * sy - 0.5);
  return out;
}

/// The homography of the circles around circle i (its two rings at most), as board and image points.
std::optional<Mat3> local_plane(const Circles& board, const std::vector<Vec2>& px, int i, double reach) {
  std::vector<Vec2> from, to;
  const Vec2 centre = board_point(board, i);
  for (std::size_t k = 0; k < px.size(); ++k) {
    const Vec2 p = board_point(board, static_cast<int>(k));
    if ((p - centre).lpNorm<Eigen::Infinity>() > reach) continue;
    from.push_back(p - centre);
    to.push_back(px[k]);
  }
  return fit_plane(from, to);
}

/// Largest distance of a circle from where its neighbours put it, in lattice spacings of the image.
double misfit(const Circles& board, const std::vector<Vec2>& px) {
  double worst = 0;
  for (std::size_t i = 0; i < px.size(); ++i) {
    const auto H = local_plane(board, px, static_cast<int>(i), 2);
    if (!H) return 1e9;
    const auto predicted = map_point(*H, Vec2(0, 0));
    if (!predicted) return 1e9;
    worst = std::max(
        worst, (*predicted - px[i]).norm() / std::sqrt(std::abs(map_jacobian(*H, Vec2(0, 0)).determinant())));
  }
  return worst;
}

/// The image of the board around circle i: the plane of its neighbours, and a quadratic for what that leaves,
/// since a lens is no homography. Neighbours within two steps, or more where that is less than a dozen.
struct LocalMap {
  Mat3 H;
  Eigen::Matrix<double, 2, 6> q = Eigen::Matrix<double, 2, 6>::Zero();  ///< of 1, x, y, x^2, xy, y^2
};

std::optional<LocalMap> local_map(const Circles& board, const std::vector<Vec2>& px, int i) {
  const Vec2 centre = board_point(board, i);
  std::vector<Vec2> from, to;
  for (double reach = 2; reach < 5 && from.size() < 12; ++reach) {
    from.clear(), to.clear();
    for (std::size_t k = 0; k < px.size(); ++k) {
      const Vec2 p = board_point(board, static_cast<int>(k)) - centre;
      if (p.lpNorm<Eigen::Infinity>() <= reach) from.push_back(p), to.push_back(px[k]);
    }
  }
  const auto H = fit_plane(from, to);
  if (!H) return std::nullopt;
  LocalMap out{*H};
  const int n = static_cast<int>(from.size());
  if (n < 9) return out;
  MatX A(n, 6), rest(n, 2);
  for (int k = 0; k < n; ++k) {
    const Vec2& p = from[k];
    A.row(k) << 1, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y();
    rest.row(k) = (to[k] - map_point(*H, p).value_or(to[k])).transpose();
  }
  for (int axis = 0; axis < 2; ++axis) {
    if (const auto x = solve_least_squares(A, rest.col(axis))) out.q.row(axis) = x->transpose();
  }
  return out;
}

/// Where the centre of a circle is, relative to the centroid of its image: a perspective view maps the circle
/// to an ellipse about another point (Heikkila 2000, section 2.2), and a lens adds to that. After a
/// calibration circle_bias.hpp knows it better.
Vec2 centre_shift(const LocalMap& map, double radius) {
  constexpr int kPoints = 24;
  const auto at = [&](const Vec2& p) {
    Eigen::Matrix<double, 6, 1> terms;
    terms << 1, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y();
    return Vec2(map_point(map.H, p).value_or(Vec2::Zero()) + map.q * terms);
  };
  const Vec2 centre = at(Vec2::Zero());
  OutlineSum sum(kPoints);
  for (int i = 0; i < kPoints; ++i) {
    const double angle = 2 * std::numbers::pi * i / kPoints;
    const Vec2 p = radius * Vec2(std::cos(angle), std::sin(angle)), t(-p.y(), p.x());
    Eigen::Matrix<double, 6, 1> d;
    d << 0, t.x(), t.y(), 2 * p.x() * t.x(), p.x() * t.y() + p.y() * t.x(), 2 * p.y() * t.y();
    sum.add(at(p) - centre, map_jacobian(map.H, p) * t + map.q * d);
  }
  return -sum.centroid();
}

double radius_of(double area_px2, const Mat2& J) {
  return std::sqrt(area_px2 / (std::numbers::pi * std::abs(J.determinant())));
}

/// What was measured of a grid, and what its discs look like.
struct Measured {
  std::vector<Corner> corners;
  std::vector<Vec2> px;  ///< centroids
  double radius = 0;     ///< [board units]
  double contrast = 0;
  int n_discs = 0;  ///< those with a clear outline
};

/// Centroids of the numbered circles, with what makes centres of them. `coarse_px`: what the finder's own
/// centres are good to, for those that have no clear outline.
Measured measure(const cv::Mat& grey, const Circles& board, std::vector<Vec2> px, double coarse_px) {
  const double noise = noise_level(grey, bounding_box(px, grey));
  const double nearest = board.asymmetric ? std::numbers::sqrt2 : 1;  // board units
  const int n = static_cast<int>(px.size());
  std::vector<std::optional<Mat2>> J(px.size());
  std::vector<double> radii;
  for (int i = 0; i < n; ++i) {
    const auto H = local_plane(board, px, i, 2);
    if (!H) continue;
    J[i] = map_jacobian(*H, Vec2(0, 0));
    const DarkBlob blob = dark_blob(grey, px[i], 0.5 * nearest * least_stretch(*J[i]));
    if (blob.area_px2 > 0) radii.push_back(radius_of(blob.area_px2, *J[i]));
  }
  double radius = std::min(median(radii), 0.45 * nearest);  // all circles of a board have one size
  std::vector<std::optional<DiscFit>> fits(px.size());
  radii.clear();
  for (int i = 0; i < n && radius > 0; ++i) {
    if (!J[i]) continue;
    const double stretch = least_stretch(*J[i]);
    fits[i] = fit_disc(
        grey, {px[i], *J[i], radius, (nearest / 2 - radius) * stretch, 0.2 * nearest * stretch}, noise);
    if (!fits[i]) continue;
    px[i] = fits[i]->centroid;
    radii.push_back(radius_of(fits[i]->area_px2, *J[i]));
  }
  radius = median(radii);
  Measured out;
  std::vector<double> contrasts;
  for (const auto& fit : fits) {
    if (fit) contrasts.push_back(fit->contrast);
  }
  out.n_discs = static_cast<int>(contrasts.size());
  out.contrast = median(std::move(contrasts));
  out.radius = radius;
  for (int i = 0; i < n; ++i) {
    const auto map = fits[i] && radius > 0 ? local_map(board, px, i) : std::nullopt;
    const Vec2 shift = map ? centre_shift(*map, radius) : Vec2::Zero();
    out.corners.push_back({i, px[i] + shift, fits[i] ? fits[i]->sigma_px : coarse_px});
  }
  out.px = std::move(px);
  return out;
}

/// Whether the lattice of a grid has a circle at `p` [board units] beyond circle i, as it has on the board.
/// nullopt where that is not all in the image.
std::optional<bool> has_circle_beyond(const cv::Mat& grey, const Circles& board, const Measured& grid, int i,
                                      const Vec2& step, double noise) {
  const auto H = local_plane(board, grid.px, i, 2);
  const auto at = H ? map_point(*H, step) : std::nullopt;
  if (!at) return std::nullopt;
  const Mat2 J = map_jacobian(*H, step);
  const double nearest = board.asymmetric ? std::numbers::sqrt2 : 1;
  const double reach = grid.radius * std::max(J.col(0).norm(), J.col(1).norm()) + 2;
  if (at->x() < reach || at->y() < reach || at->x() > grey.cols - 1 - reach ||
      at->y() > grey.rows - 1 - reach)
    return std::nullopt;
  const double stretch = least_stretch(J);
  const auto fit = fit_disc(
      grey, {*at, J, grid.radius, (nearest / 2 - grid.radius) * stretch, 0.2 * nearest * stretch}, noise);
  return fit && fit->contrast > kAlike * grid.contrast;
}

/// Whether circles go on beyond one of the grid's four sides: then it is a part of a larger one.
bool goes_on(const cv::Mat& grey, const Circles& board, const Measured& grid) {
  const double noise = noise_level(grey, bounding_box(grid.px, grey));
  const double across = board.asymmetric ? 2 : 1;  // board units from circle to circle within a row
  struct Side {
    bool is_row;
    int at, sense;
  };
  for (const Side side :
       {Side{true, 0, -1}, {true, board.rows - 1, 1}, {false, 0, -1}, {false, board.columns - 1, 1}}) {
    int asked = 0, there = 0;
    for (int k = 0; k < (side.is_row ? board.columns : board.rows); ++k) {
      const int c = side.is_row ? k : side.at, r = side.is_row ? side.at : k;
      // Of an asymmetric grid the next row is half a step aside, on one side of the first row and the other
      // of the second.
      const double aside = board.asymmetric && side.is_row ? (r % 2 == 0 ? 1 : -1) : 0;
      const Vec2 step = side.is_row ? Vec2(aside, side.sense) : Vec2(side.sense * across, 0);
      const auto found = has_circle_beyond(grey, board, grid, r * board.columns + c, step, noise);
      asked += found ? 1 : 0;
      there += found && *found ? 1 : 0;
    }
    if (asked >= 2 && 2 * there > asked) return true;
  }
  return false;
}

std::optional<LatticePoints> number(const Circles& board, const LatticePoints& found) {
  return orient(found, [&](const LatticePoints& p) { return misfit(board, p.px) < 0.3; });
}

}  // namespace

Detection detect_circles(const cv::Mat& grey, const Circles& board) {
  Detection out;
  const std::string name = fmt::format("{}x{} {} grid of circles", board.columns, board.rows,
                                       board.asymmetric ? "asymmetric" : "symmetric");
  out.reason = fmt::format("no {} found in {}x{} pixels", name, grey.cols, grey.rows);
  const double longest = std::max(grey.cols, grey.rows);
  std::vector<double> scales = {1.0};
  if (longest > 2000) scales = {1400 / longest, 1.0};
  if (longest < 1000) scales = {1.0, 2.0};
  for (double scale : scales) {
    for (int flags : {0, static_cast<int>(cv::CALIB_CB_CLUSTERING)}) {
      const LatticePoints found = find(grey, board, scale, flags);
      if (found.px.empty()) continue;
      const auto numbered = number(board, found);
      if (!numbered) {
        out.reason =
            fmt::format("what looked like a {} is none: neighbouring circles do not fit the grid", name);
        continue;
      }
      Measured grid = measure(grey, board, numbered->px, 0.5 / std::min(1.0, scale));
      if (2 * grid.n_discs < static_cast<int>(grid.px.size())) {
        out.reason = fmt::format("what looked like a {} is none: {} of {} look like circles", name,
                                 grid.n_discs, grid.px.size());
        continue;
      }
      if (goes_on(grey, board, grid)) {
        out.reason = fmt::format("part of a larger grid of circles than {}x{}", board.columns, board.rows);
        continue;
      }
      out.corners = std::move(grid.corners);
      out.method = flags == 0 ? "findCirclesGrid, centroids" : "findCirclesGrid (clustering), centroids";
      out.reason.clear();
      return out;
    }
  }
  return out;
}

}  // namespace plumbline::detail

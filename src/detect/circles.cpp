// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "detect/finders.hpp"
#include "detect/lattice_order.hpp"
#include "detect/planar.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// The centroid of n = pi r^2 pixels of noise s / contrast has the error s / contrast sqrt(n r^2 / 4) / n =
/// s / contrast / (2 sqrt pi), whatever the radius; times two for the blurred rim, set like kSystematic on
/// rendered boards (docs/detect.md).
constexpr double kNoiseGain = 0.56, kSystematic = 0.015;

/// Grey-level moments of a dark disc.
struct Disc {
  Vec2 centre;
  double area = 0;      ///< [px^2]
  double contrast = 0;  ///< grey levels between paper and ink
};

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

/// The disc about `start`: area-weighted mean of the ink, where each pixel counts by how dark it is between
/// the local paper and ink. A blurred edge keeps its first moment, so blur and sampling do not move the
/// centre.
std::optional<Disc> measure(const cv::Mat& grey, const Vec2& start, double radius) {
  const int n = static_cast<int>(std::ceil(radius)) + 1;
  if (start.x() < n || start.y() < n || start.x() > grey.cols - 1 - n || start.y() > grey.rows - 1 - n)
    return std::nullopt;
  const int x0 = static_cast<int>(std::lround(start.x())), y0 = static_cast<int>(std::lround(start.y()));
  std::vector<int> inner, outer;
  for (int y = y0 - n; y <= y0 + n; ++y) {
    if (y < 0 || y >= grey.rows) return std::nullopt;
    for (int x = x0 - n; x <= x0 + n; ++x) {
      if (x < 0 || x >= grey.cols) return std::nullopt;
      const double d = (Vec2(x, y) - start).norm();
      if (d <= radius) (d > radius - 2 ? outer : inner).push_back(grey.at<unsigned char>(y, x));
    }
  }
  if (inner.size() < 9 || outer.empty()) return std::nullopt;
  std::sort(inner.begin(), inner.end());
  std::sort(outer.begin(), outer.end());
  const double ink = inner[inner.size() / 20], paper = outer[outer.size() / 2];
  Disc disc{Vec2::Zero(), 0, paper - ink};
  if (disc.contrast < 8) return std::nullopt;
  for (int y = y0 - n; y <= y0 + n; ++y) {
    for (int x = x0 - n; x <= x0 + n; ++x) {
      const double d = (Vec2(x, y) - start).norm();
      if (d > radius) continue;
      // Below a fifth of the contrast it is the paper's noise, which far from the disc has the longest lever.
      const double cover = (paper - grey.at<unsigned char>(y, x)) / disc.contrast;
      const double w = cover < 0.2 ? 0 : std::min(cover, 1.0);
      disc.area += w;
      disc.centre += w * Vec2(x, y);
    }
  }
  if (disc.area < 4) return std::nullopt;
  disc.centre /= disc.area;
  return disc;
}

/// Where the centre of a circle of `area` px^2 at the plane's origin is, relative to the centroid of its
/// image: a perspective view maps the circle to an ellipse about another point (Heikkila 2000, section 2.2).
/// Third order in the radius, from four points of the circle's rim... solved exactly through the dual conic H
/// diag(r^2, r^2, -1) H'.
Vec2 perspective_shift(const Mat3& H, double area) {
  const double r2 = area / (std::numbers::pi * std::abs(map_jacobian(H, Vec2(0, 0)).determinant()));
  const Mat3 dual = H * Vec3(r2, r2, -1).asDiagonal() * H.transpose();
  const Vec2 ellipse_centre = dual.col(2).head<2>() / dual(2, 2);
  return Vec2(H.col(2).hnormalized()) - ellipse_centre;
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
      std::vector<Vec2> centres = numbered->px;
      std::vector<double> sigma(centres.size(), 0.5 / std::min(1.0, scale)), area(centres.size(), 0);
      const double noise = noise_level(grey, bounding_box(centres, grey));
      for (std::size_t i = 0; i < centres.size(); ++i) {
        double nearest = 1e9;
        for (std::size_t k = 0; k < centres.size(); ++k)
          if (k != i) nearest = std::min(nearest, (numbered->px[k] - numbered->px[i]).norm());
        const auto disc = measure(grey, numbered->px[i], nearest / 2);
        if (!disc || (disc->centre - numbered->px[i]).norm() > 0.2 * nearest) continue;
        centres[i] = disc->centre;
        area[i] = disc->area;
        sigma[i] = std::hypot(kNoiseGain * noise / disc->contrast, kSystematic);
      }
      for (std::size_t i = 0; i < centres.size(); ++i) {
        const auto H = area[i] > 0 ? local_plane(board, numbered->px, static_cast<int>(i), 2) : std::nullopt;
        const Vec2 shift = H ? perspective_shift(*H, area[i]) : Vec2::Zero();
        out.corners.push_back({static_cast<int>(i), centres[i] + shift, sigma[i]});
      }
      out.method =
          flags == 0 ? "findCirclesGrid, grey moments" : "findCirclesGrid (clustering), grey moments";
      out.reason.clear();
      return out;
    }
  }
  return out;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include "detect/disc_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace plumbline::detail {
namespace {

constexpr double kBandBlurs = 3,
                 kBandSlack = 0.5;  ///< half width of the band that is measured: blurs, and px
constexpr double kFirstBlur = 1.2;  ///< px
constexpr double kMinContrast = 8;  ///< grey levels
constexpr double kLeastError =
    0.0015;  ///< px; what the model is worth, set on rendered boards (docs/detect.md)
constexpr int kMinPaper = 12, kMinInk = 8;  ///< pixels for a level
constexpr double kRing = 4;                 ///< px of paper beyond the band

struct Pixel {
  Vec2 at;              ///< from the middle
  double beyond, grey;  ///< beyond the outline [px]
};

/// Pixels up to `reach` beyond the ellipse {J u : |u| < radius} about `middle`; empty when some are not in
/// the image.
std::vector<Pixel> collect(const cv::Mat& grey, const Vec2& middle, const DiscWindow& w, double reach) {
  const Mat2 board_from_px = w.J.inverse();
  const Vec2 half = w.radius * w.J.rowwise().norm() + Vec2::Constant(reach + 1);
  const int x0 = static_cast<int>(std::ceil(middle.x() - half.x())),
            x1 = static_cast<int>(std::floor(middle.x() + half.x())),
            y0 = static_cast<int>(std::ceil(middle.y() - half.y())),
            y1 = static_cast<int>(std::floor(middle.y() + half.y()));
  std::vector<Pixel> out;
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const Vec2 at = Vec2(x, y) - middle, p = board_from_px * at / w.radius;
      const double rho = p.norm();
      // Distance from the outline to first order: (rho - 1) over the length of rho's gradient.
      const Vec2 gradient = board_from_px.transpose() * p / (w.radius * std::max(rho, 1e-6));
      const double beyond = (rho - 1) / std::max(gradient.norm(), 1e-9);
      if (beyond > reach) continue;
      if (x < 0 || y < 0 || x >= grey.cols || y >= grey.rows) return {};
      out.push_back({at, beyond, static_cast<double>(grey.ptr<unsigned char>(y)[x])});
    }
  }
  return out;
}

/// Paper under sloping light: level[0] + level[1] x + level[2] y; ink is `ink_ratio` of that.
struct Levels {
  Vec3 paper = Vec3::Zero();
  Mat3 covariance = Mat3::Zero();  ///< of `paper` for unit noise
  double ink_ratio = 0;
  double rms = 0;  ///< what they leave [grey levels]
  bool has_ink = false;
  double paper_at(const Vec2& p) const { return paper.dot(Vec3(1, p.x(), p.y())); }
};

std::optional<Levels> levels(const std::vector<Pixel>& pixels, double band) {
  Levels out;
  Mat3 A = Mat3::Zero();
  Vec3 b = Vec3::Zero();
  int n_paper = 0, n_ink = 0;
  double ink = 0;
  for (const Pixel& p : pixels) {
    const Vec3 row(1, p.at.x(), p.at.y());
    if (p.beyond > band) A += row * row.transpose(), b += row * p.grey, ++n_paper;
  }
  if (n_paper < kMinPaper) return std::nullopt;
  out.covariance = A.inverse();
  if (!out.covariance.allFinite()) return std::nullopt;
  out.paper = out.covariance * b;
  double square = 0, darkest = 255;
  for (const Pixel& p : pixels) {
    darkest = std::min(darkest, p.grey);
    if (p.beyond > band) square += std::pow(p.grey - out.paper_at(p.at), 2);
    if (p.beyond < -band) ink += p.grey / out.paper_at(p.at), ++n_ink;
  }
  out.has_ink = n_ink >= kMinInk;
  // A disc without a middle free of blur: its level cancels, since no pixel counts whole.
  out.ink_ratio = out.has_ink ? ink / n_ink : darkest / out.paper[0];
  if (out.has_ink) {
    for (const Pixel& p : pixels)
      if (p.beyond < -band) square += std::pow(p.grey - out.ink_ratio * out.paper_at(p.at), 2);
  }
  out.rms = std::sqrt(square / std::max(1, n_paper - 3 + (out.has_ink ? n_ink - 1 : 0)));
  if (out.paper[0] * (1 - out.ink_ratio) < kMinContrast) return std::nullopt;
  return out;
}

struct Sum {
  double area = 0, edge = 0, n_band = 0;  ///< edge: of cover (1 - cover)
  Vec2 first = Vec2::Zero();
};

double cover_of(const Pixel& p, const Levels& l, double band) {
  if (p.beyond > band) return 0;
  if (l.has_ink && p.beyond < -band) return 1;
  const double paper = l.paper_at(p.at);
  return (paper - p.grey) / (paper * (1 - l.ink_ratio));
}

Sum sum_up(const std::vector<Pixel>& pixels, const Levels& l, double band) {
  Sum out;
  for (const Pixel& p : pixels) {
    const double cover = cover_of(p, l, band);
    out.area += cover;
    out.first += cover * p.at;
    if (std::abs(p.beyond) <= band) out.edge += cover * (1 - cover), ++out.n_band;
  }
  return out;
}

/// Variance of the centroid (mean of both axes): each measured pixel's noise, and that of the paper's level
/// through all of them.
double variance(const std::vector<Pixel>& pixels, const Levels& l, double band, const Sum& sum,
                double noise) {
  const Vec2 centre = sum.first / sum.area;
  Eigen::Matrix<double, 2, 3> D = Eigen::Matrix<double, 2, 3>::Zero();
  double pixels_part = 0;
  for (const Pixel& p : pixels) {
    if (p.beyond > band || (l.has_ink && p.beyond < -band)) continue;
    const double paper = l.paper_at(p.at), contrast = paper * (1 - l.ink_ratio);
    const Vec2 lever = (p.at - centre) / sum.area;
    pixels_part += lever.squaredNorm() / (contrast * contrast);
    D += lever * (p.grey / paper / contrast) * Eigen::RowVector3d(1, p.at.x(), p.at.y());
  }
  return noise * noise * (pixels_part + (D * l.covariance * D.transpose()).trace()) / 2;
}

}  // namespace

std::optional<DiscFit> fit_disc(const cv::Mat& grey, const DiscWindow& start, double noise) {
  DiscWindow w = start;
  double blur = kFirstBlur;
  const Mat2& J = w.J;
  if (!(std::abs(J.determinant()) > 0) || w.reach_px < 1) return std::nullopt;
  const double expected = std::numbers::pi * w.radius * w.radius * std::abs(J.determinant());
  const double perimeter =
      std::numbers::pi * w.radius * std::sqrt(2 * J.squaredNorm());  // good to a tenth, up to 3:1
  for (int round = 0; round < 4; ++round) {
    const double band = std::min(kBandBlurs * blur + kBandSlack, 0.75 * w.reach_px);
    const auto pixels = collect(grey, w.px, w, std::min(w.reach_px, band + kRing));
    const auto level = levels(pixels, band);
    if (!level) return std::nullopt;
    const double s = std::max(noise, level->rms), contrast = level->paper[0] * (1 - level->ink_ratio);
    if (s > 0.35 * contrast) return std::nullopt;
    const Sum sum = sum_up(pixels, *level, band);
    if (!(sum.area > 0.4 * expected && sum.area < 2.2 * expected)) return std::nullopt;
    const Vec2 move = sum.first / sum.area;
    if ((w.px + move - start.px).norm() > start.max_move_px) return std::nullopt;
    // Over a Gaussian edge the integral of cover (1 - cover) is blur / sqrt pi.
    const double edge = sum.edge + sum.n_band * s * s / (contrast * contrast);
    blur = std::clamp(edge / perimeter * std::sqrt(std::numbers::pi), 0.4, 5.0);
    const double scale = std::sqrt(sum.area / expected) * start.radius;
    const bool is_done = round > 1 && move.norm() < 0.3 && std::abs(scale / w.radius - 1) < 0.05;
    if (is_done || round == 3) {
      return DiscFit{w.px + move, std::hypot(std::sqrt(variance(pixels, *level, band, sum, s)), kLeastError),
                     sum.area, contrast, blur};
    }
    w.px += move;
    w.radius = scale;
  }
  return std::nullopt;
}

double least_stretch(const Mat2& J) {
  const double square = J.squaredNorm(), det = J.determinant();
  return std::sqrt(std::max(0.0, (square - std::sqrt(std::max(0.0, square * square - 4 * det * det))) / 2));
}

DarkBlob dark_blob(const cv::Mat& grey, const Vec2& start, double radius) {
  const int x0 = std::max(0, static_cast<int>(std::ceil(start.x() - radius))),
            x1 = std::min(grey.cols - 1, static_cast<int>(start.x() + radius)),
            y0 = std::max(0, static_cast<int>(std::ceil(start.y() - radius))),
            y1 = std::min(grey.rows - 1, static_cast<int>(start.y() + radius));
  std::vector<double> inner, outer;
  const auto each = [&](const auto& body) {
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const double d = (Vec2(x, y) - start).norm();
        if (d <= radius) body(Vec2(x, y), d, static_cast<double>(grey.ptr<unsigned char>(y)[x]));
      }
    }
  };
  each([&](const Vec2&, double d, double g) { (d > radius - 2 ? outer : inner).push_back(g); });
  if (inner.size() < 9 || outer.empty()) return {};
  std::sort(inner.begin(), inner.end());
  std::sort(outer.begin(), outer.end());
  const double ink = inner[inner.size() / 20], paper = outer[outer.size() / 2];
  if (paper - ink < kMinContrast) return {};
  DarkBlob out;
  each([&](const Vec2& p, double, double g) {
    // Below a fifth of the contrast it is the paper's noise, which far from the disc has the longest lever.
    const double cover = (paper - g) / (paper - ink), weight = cover < 0.2 ? 0 : std::min(cover, 1.0);
    out.area_px2 += weight;
    out.centre += weight * p;
  });
  if (out.area_px2 < 4) return {};
  out.centre /= out.area_px2;
  return out;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include "detect/chess_fit.hpp"

#include <algorithm>
#include <cmath>

#include "detect/bends.hpp"
#include "detect/median.hpp"
#include "detect/planar.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// What the lattice confirms may look less like the model: binary scans, corners whose squares do not touch.
constexpr double kMaxMisfit = 0.9;
constexpr double kFineScale = 0.5;  ///< corners found there are good starts
constexpr double kLeastHoleMisfit = 0.4, kMoreMisfit = 2.5;
constexpr double kFirstPx = 0.05;  ///< last step of the first fits, which say how the edges bend
constexpr double kStray = 0.16;    ///< of the way between two neighbours: off their middle
constexpr double kFaint = 0.35;    ///< of the median contrast

struct Fitted {
  ChessGrid grid;
  GridFit how;
  std::vector<std::optional<SaddleFit>> fits;
  double blur_px = 0;  ///< of the last corner that was fitted
  /// What a corner that the search missed may leave of its contrast, by what the others leave.
  double hole_misfit = kLeastHoleMisfit;
};

SaddleWindow window_at(const ChessGrid& grid, const GridFit& how, const Mat2& J, int c, int r, double scale,
                       bool is_seen, bool with_bend) {
  SaddleWindow window{J};
  window.across = how.across;
  window.max_misfit = is_seen ? kMaxMisfit : window.max_misfit;
  const double least = std::min(J.col(0).norm(), J.col(1).norm());
  window.max_move_px = std::min(std::max({2.0, 0.25 * least, 1.5 / scale}), 0.45 * least);
  if (!with_bend) {
    window.enough_px = kFirstPx;
    return window;
  }
  set_bends(curvature_at(grid, c, r), window);
  return window;
}

void fit(const cv::Mat& grey, int c, int r, const Vec2& start, double scale, bool is_seen, double noise,
         Fitted& out) {
  const auto J = steps_at(out.grid, c, r);
  auto& to = out.fits[static_cast<std::size_t>(r) * out.grid.columns + c];
  to.reset();
  if (!J || out.how.across * narrow_height(*J) < out.how.least_across_px) return;
  SaddleWindow window = window_at(out.grid, out.how, *J, c, r, scale, is_seen, false);
  if (!is_seen) window.max_misfit = out.hole_misfit;
  if (scale >= kFineScale && is_seen) window.usual_blur_px = out.blur_px;
  to = fit_saddle(grey, start, window, noise);
  if (!to && window.usual_blur_px > 0) {
    window.usual_blur_px = 0;  // it looks otherwise than those beside it
    to = fit_saddle(grey, start, window, noise);
  }
  if (to) out.blur_px = to->blur_px;
  if (to || out.how.across >= 1) return;
  // Glare, a strong bend, markers close by: nearer to the corner there is less of it.
  window.max_arm_px = kShortArmPx;
  window.long_arm_px = 0;
  to = fit_saddle(grey, start, window, noise);
}

/// Sides alternate from corner to corner, and no corner is much fainter than the others.
void drop_misfits(Fitted& out) {
  std::vector<double> contrast;
  double side = 0;
  const auto sign = [&](std::size_t i) {
    return (i % out.grid.columns + i / out.grid.columns) % 2 == 0 ? 1.0 : -1.0;
  };
  for (std::size_t i = 0; i < out.fits.size(); ++i) {
    if (!out.fits[i]) continue;
    contrast.push_back(std::abs(out.fits[i]->contrast));
    side += sign(i) * out.fits[i]->contrast;
  }
  const double least = kFaint * median(contrast) * (side > 0 ? 1 : -1);
  for (std::size_t i = 0; i < out.fits.size(); ++i) {
    auto& f = out.fits[i];
    if (f && sign(i) * f->contrast / least < 1) f.reset();
    if (!f) out.grid.px[i].reset();
  }
}

/// Where the blur fills what is clean beside the edges nothing tells a corner from what lies beyond.
void drop_blurred(Fitted& out) {
  if (out.how.least_blurs <= 0) return;
  std::vector<double> blur;
  for (const auto& f : out.fits) {
    if (f) blur.push_back(f->blur_px);
  }
  const double least = out.how.least_blurs * median(blur) / out.how.across;
  for (int i = 0; i < static_cast<int>(out.fits.size()); ++i) {
    auto& f = out.fits[static_cast<std::size_t>(i)];
    const auto J = f ? steps_at(out.grid, i % out.grid.columns, i / out.grid.columns) : std::nullopt;
    if (!J || narrow_height(*J) >= least) continue;
    f.reset();
  }
  for (std::size_t i = 0; i < out.fits.size(); ++i) {
    if (!out.fits[i]) out.grid.px[i].reset();
  }
}

/// A corner lies between its neighbours; the one that lies worst goes, until all do.
void drop_strays(Fitted& out) {
  const auto off = [&](int c, int r) {
    double worst = 0;
    for (const auto& [dc, dr] : {std::pair{1, 0}, {0, 1}}) {
      const auto a = out.grid.get(c - dc, r - dr), b = out.grid.get(c + dc, r + dr);
      if (a && b) worst = std::max(worst, ((*a + *b) / 2 - *out.grid.at(c, r)).norm() / (*b - *a).norm());
    }
    return worst;
  };
  while (true) {
    double worst = kStray;
    std::size_t at = out.fits.size();
    for (int r = 0; r < out.grid.rows; ++r) {
      for (int c = 0; c < out.grid.columns; ++c) {
        if (!out.grid.at(c, r)) continue;
        const double here = off(c, r);
        if (here > worst) worst = here, at = static_cast<std::size_t>(r) * out.grid.columns + c;
      }
    }
    if (at == out.fits.size()) return;
    out.fits[at].reset();
    out.grid.px[at].reset();
  }
}
}  // namespace

std::vector<ChessCorner> refine_grid(const cv::Mat& grey, const ChessGrid& grid, double scale, double noise,
                                     const GridFit& how) {
  Fitted out{grid, how, std::vector<std::optional<SaddleFit>>(grid.px.size())};
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      if (grid.at(c, r)) fit(grey, c, r, *grid.at(c, r), scale, true, noise, out);
    }
  }
  for (std::size_t i = 0; i < out.fits.size(); ++i)
    out.grid.px[i] = out.fits[i] ? std::optional(out.fits[i]->px) : std::nullopt;
  drop_blurred(out);
  drop_misfits(out);
  drop_strays(out);
  std::vector<double> misfits;
  for (const auto& f : out.fits) {
    if (f) misfits.push_back(f->misfit / std::abs(f->contrast));
  }
  out.hole_misfit = std::clamp(kMoreMisfit * median(std::move(misfits)), kLeastHoleMisfit, kMaxMisfit);
  // What the search missed: holes, and corners at the image's border.
  for (int round = 0; round < how.rounds; ++round) {
    bool is_new = false;
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        if (out.grid.at(c, r)) continue;
        const auto start = foretold(out.grid, c, r);
        if (!start || start->x() < 1 || start->y() < 1 || start->x() > grey.cols - 2 ||
            start->y() > grey.rows - 2)
          continue;
        out.grid.at(c, r) = start;
        fit(grey, c, r, *start, 1, false, noise, out);
        const auto& found = out.fits[static_cast<std::size_t>(r) * grid.columns + c];
        out.grid.at(c, r) = found ? std::optional(found->px) : std::nullopt;
        is_new = is_new || found.has_value();
      }
    }
    if (!is_new) break;
    drop_blurred(out);
    drop_misfits(out);
    drop_strays(out);
  }
  std::vector<ChessCorner> corners;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const auto& first = out.fits[static_cast<std::size_t>(r) * grid.columns + c];
      if (!first) continue;
      SaddleFit best = *first;
      if (const auto J = steps_at(out.grid, c, r)) {
        const SaddleWindow window = window_at(out.grid, how, *J, c, r, 1, true, true);
        if (const auto better = fit_saddle(grey, best.px, window, noise, &best)) best = *better;
      }
      corners.push_back({r * grid.columns + c, best.px, best.sigma_px, best.contrast,
                         best.misfit / std::abs(best.contrast)});
    }
  }
  return corners;
}

}  // namespace plumbline::detail

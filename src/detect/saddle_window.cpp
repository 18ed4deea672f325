// SPDX-License-Identifier: Apache-2.0
#include "detect/saddle_window.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace plumbline::detail {
namespace {

constexpr double kShare = 0.5;      ///< of the way to the next corner, which has the rest
constexpr double kEdgeReach = 3.5;  ///< an edge is flat beyond so many blurs

/// A band along each edge [board units]: from low to high along it and `side` to both sides.
struct Bands {
  double low[2], high[2], side[2];
};

Bands bands_of(const SaddleWindow& w, double arm_px, double blur) {
  Bands out{};
  const double length[2] = {w.J.col(0).norm(), w.J.col(1).norm()};
  // Heights: the distance between neighbouring lines of the lattice.
  const double height = std::abs(w.J.determinant());
  const double across_px[2] = {height / length[0], height / length[1]};  // of one unit beside edge 0, edge 1
  for (int k = 0; k < 2; ++k) {
    // What bounds the arm along axis k is the next line across it, at a distance measured across it.
    const double leak = w.leak_blurs * blur / across_px[1 - k];
    out.low[k] = -std::min({-w.low[k] - leak, kShare, arm_px / length[k]});
    out.high[k] = std::min({w.high[k] - leak, kShare, arm_px / length[k]});
    out.side[k] = std::min(
        {w.across - w.leak_blurs * blur / across_px[k], kShare, (kEdgeReach * blur + 0.5) / across_px[k]});
    // At the least a pixel to each side, or nothing is left to fit.
    out.side[k] = std::max(out.side[k], std::min(w.across, 1.2 / across_px[k]));
    out.low[k] = std::min(out.low[k], -1.5 / length[k]);
    out.high[k] = std::max(out.high[k], 1.5 / length[k]);
  }
  return out;
}

/// Pixels of one image row: from first to last, none when last < first.
struct Span {
  int first, last;
};
constexpr Span kNone{0, -1};
bool is_empty(const Span& span) { return span.last < span.first; }

/// A coordinate along image rows: slope x + offset.
struct Along {
  double slope, inverse;
  explicit Along(double per_px) : slope(per_px), inverse(std::abs(per_px) < 1e-12 ? 0 : 1 / per_px) {}
  /// The x at which low <= slope x + offset <= high, within the span.
  Span cut(const Span& span, double offset, double low, double high) const {
    if (inverse == 0) return offset >= low && offset <= high ? span : kNone;
    const double x0 = (low - offset) * inverse, x1 = (high - offset) * inverse;
    // Clamped before rounding: a band that runs nearly along the row reaches far.
    const double least = std::clamp(std::min(x0, x1), span.first - 1.0, span.last + 1.0);
    const double most = std::clamp(std::max(x0, x1), span.first - 1.0, span.last + 1.0);
    return {std::max(span.first, static_cast<int>(std::ceil(least))),
            std::min(span.last, static_cast<int>(std::floor(most)))};
  }
};

void append(const cv::Mat& grey, int y, Span span, WindowPixels& out) {
  if (is_empty(span)) return;
  out.places += span.last - span.first + 1;
  if (y < 0 || y >= grey.rows) return;
  span = {std::max(span.first, 0), std::min(span.last, grey.cols - 1)};
  if (is_empty(span)) return;
  const auto* row = grey.ptr<unsigned char>(y);
  const auto x0 = static_cast<int>(out.origin.x());
  const auto down = static_cast<float>(y - static_cast<int>(out.origin.y()));
  auto at = static_cast<std::size_t>(out.n);
  for (int x = span.first; x <= span.last; ++x, ++at) {
    out.x[at] = static_cast<float>(x - x0);
    out.y[at] = down;
    out.grey[at] = static_cast<float>(row[x]);
  }
  out.n = static_cast<int>(at);
}

}  // namespace

void collect_window(const cv::Mat& grey, const Vec2& q, const SaddleWindow& w, double arm_px, double blur,
                    WindowPixels& out) {
  out.origin = q.array().round();
  out.places = out.n = 0;
  const Bands bands = bands_of(w, arm_px, blur);
  const Mat2 board_from_px = w.J.inverse();
  Vec2 reach = Vec2::Zero();
  for (int k = 0; k < 2; ++k) {
    const double a = std::max(-bands.low[k], bands.high[k]), b = bands.side[k];
    reach = reach.cwiseMax((w.J.col(k) * a).cwiseAbs() + (w.J.col(1 - k) * b).cwiseAbs());
  }
  const Span all{static_cast<int>(std::ceil(q.x() - reach.x())),
                 static_cast<int>(std::floor(q.x() + reach.x()))};
  const int y0 = static_cast<int>(std::ceil(q.y() - reach.y()));
  const int y1 = static_cast<int>(std::floor(q.y() + reach.y()));
  const std::size_t most = static_cast<std::size_t>(std::max(0, all.last - all.first + 1)) *
                               static_cast<std::size_t>(std::max(0, y1 - y0 + 1)) +
                           kSaddlePad;
  for (auto* column : {&out.x, &out.y, &out.grey}) column->resize(std::max(column->size(), most));
  const std::array<Along, 2> along{Along(board_from_px(0, 0)), Along(board_from_px(1, 0))};
  for (int y = y0; y <= y1; ++y) {
    const Vec2 offset = board_from_px.col(1) * (y - q.y()) - board_from_px.col(0) * q.x();
    std::array<Span, 2> spans{};
    for (std::size_t k = 0; k < 2; ++k) {
      spans[k] = along[k].cut(all, offset[static_cast<int>(k)], bands.low[k], bands.high[k]);
      if (!is_empty(spans[k]))
        spans[k] = along[1 - k].cut(spans[k], offset[static_cast<int>(1 - k)], -bands.side[k], bands.side[k]);
    }
    auto [a, b] = spans;
    if (a.first > b.first) std::swap(a, b);
    if (!is_empty(a) && !is_empty(b) && b.first <= a.last + 1) a.last = std::max(a.last, b.last), b = kNone;
    append(grey, y, a, out);
    append(grey, y, b, out);
  }
  const auto n = static_cast<std::size_t>(out.n);
  out.n_padded = static_cast<int>((n + kSaddlePad - 1) / kSaddlePad * kSaddlePad);
  out.weight.assign(n, 1.0F);
  out.weight.resize(static_cast<std::size_t>(out.n_padded), 0.0F);
  for (auto* column : {&out.x, &out.y, &out.grey})
    std::fill(column->begin() + out.n, column->begin() + out.n_padded, 0.0F);
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include "detect/tag_bits.hpp"

#include <apriltag/apriltag.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>

#include "detect/planar.hpp"
#include "detect/subpixel.hpp"

namespace plumbline::detail {
namespace {

/// Of a module: where its grey levels are taken, away from its blurred edges.
constexpr std::array<double, 3> kPlaces{0.27, 0.5, 0.73};
/// A blur carries a share of each neighbour's light into a module; so much of the difference is given back.
constexpr float kSharpen = 0.2F;
constexpr double kMinContrast = 8;  ///< [grey levels] between the levels
constexpr double kMostSlope =
    0.6;  ///< of the contrast: from side to side of a border that is dark all around
constexpr double kBrightBorder = 0.1;  ///< share of the border's modules that may look white

using Create = apriltag_family_t* (*)();
using Destroy = void (*)(apriltag_family_t*);

TagBook make_book(Create create, Destroy destroy) {
  const std::unique_ptr<apriltag_family_t, Destroy> family(create(), destroy);
  TagBook book;
  book.n = static_cast<int>(std::lround(std::sqrt(family->nbits)));
  book.distance = static_cast<int>(family->h);
  for (std::uint32_t id = 0; id < family->ncodes; ++id) {
    std::uint64_t code = 0;
    // bit_x and bit_y count from the outer edge of a border one module wide; the first bit is the highest.
    for (std::uint32_t i = 0; i < family->nbits; ++i) {
      const std::uint64_t white = (family->codes[id] >> (family->nbits - 1 - i)) & 1;
      code |= white << ((family->bit_y[i] - 1) * static_cast<std::uint32_t>(book.n) + family->bit_x[i] - 1);
    }
    book.codes.push_back(code);
  }
  return book;
}

/// The bits of a marker that was read after a quarter turn more, back by that turn.
std::uint64_t turned(std::uint64_t bits, int n) {
  std::uint64_t out = 0;
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) out |= ((bits >> (c * n + n - 1 - r)) & 1) << (r * n + c);
  }
  return out;
}

struct Turns {
  std::array<std::uint64_t, 4> white{}, is_inside{};
};

Turns turns_of(const TagBits& bits) {
  Turns out;
  out.white[0] = bits.white, out.is_inside[0] = bits.is_inside;
  for (std::size_t t = 1; t < 4; ++t) {
    out.white[t] = turned(out.white[t - 1], bits.n);
    out.is_inside[t] = turned(out.is_inside[t - 1], bits.n);
  }
  return out;
}

/// The plane through the border's grey levels: dark under the light of each place.
struct Plane {
  double at_middle = 0, per_column = 0, per_row = 0, middle = 0;
  double at(int r, int c) const { return at_middle + per_column * (c - middle) + per_row * (r - middle); }
};

bool is_border(int r, int c, int n, int border) {
  return r < border || c < border || r >= n - border || c >= n - border;
}

std::optional<Plane> dark_plane(const TagCells& cells, int border) {
  Plane plane;
  plane.middle = (cells.n - 1) / 2.0;
  Mat3 A = Mat3::Zero();
  Vec3 b = Vec3::Zero();
  for (int r = 0; r < cells.n; ++r) {
    for (int c = 0; c < cells.n; ++c) {
      const auto i = static_cast<std::size_t>(r * cells.n + c);
      if (cells.is_inside[i] == 0 || !is_border(r, c, cells.n, border)) continue;
      const Vec3 g(1, c - plane.middle, r - plane.middle);
      A += g * g.transpose();
      b += g * cells.grey[i];
    }
  }
  if (A(0, 0) < 3) return std::nullopt;
  // A border of which one side is seen tells no slope across it.
  A(1, 1) += 1e-3 * A(0, 0);
  A(2, 2) += 1e-3 * A(0, 0);
  const Vec3 x = A.inverse() * b;
  if (!x.allFinite()) return std::nullopt;
  plane.at_middle = x[0], plane.per_column = x[1], plane.per_row = x[2];
  return plane;
}

/// Between the means of two groups of levels, each nearer to its own mean.
std::optional<float> two_levels(const std::vector<float>& levels, double& contrast) {
  const auto [low, high] = std::minmax_element(levels.begin(), levels.end());
  float limit = (*low + *high) / 2;
  for (int round = 0; round < 10; ++round) {
    double sum[2] = {0, 0}, n[2] = {0, 0};
    for (const float v : levels) {
      sum[v > limit ? 1 : 0] += v;
      n[v > limit ? 1 : 0] += 1;
    }
    if (n[0] < 1 || n[1] < 1) return std::nullopt;
    const double dark = sum[0] / n[0], bright = sum[1] / n[1];
    contrast = bright - dark;
    const auto next = static_cast<float>((dark + bright) / 2);
    if (std::abs(next - limit) < 0.01F) break;
    limit = next;
  }
  return limit;
}

/// Levels above the dark plane, sharpened.
std::vector<float> levels_of(const TagCells& cells, const Plane& dark) {
  std::vector<float> flat(cells.grey.size()), out(cells.grey.size());
  for (int r = 0; r < cells.n; ++r) {
    for (int c = 0; c < cells.n; ++c) {
      const auto i = static_cast<std::size_t>(r * cells.n + c);
      flat[i] = cells.grey[i] - static_cast<float>(dark.at(r, c));
    }
  }
  for (int r = 0; r < cells.n; ++r) {
    for (int c = 0; c < cells.n; ++c) {
      const auto i = static_cast<std::size_t>(r * cells.n + c);
      out[i] = flat[i];
      for (const auto& [dr, dc] : {std::pair{0, 1}, {1, 0}, {0, -1}, {-1, 0}}) {
        const int y = r + dr, x = c + dc;
        if (y < 0 || x < 0 || y >= cells.n || x >= cells.n) continue;
        const auto k = static_cast<std::size_t>(y * cells.n + x);
        if (cells.is_inside[k] != 0) out[i] += kSharpen * (flat[i] - flat[k]);
      }
    }
  }
  return out;
}

}  // namespace

const TagBook* april_book(std::string_view family) {
  static const TagBook k36h11 = make_book(tag36h11_create, tag36h11_destroy);
  static const TagBook k25h9 = make_book(tag25h9_create, tag25h9_destroy);
  if (family == "36h11") return &k36h11;
  if (family == "25h9") return &k25h9;
  return nullptr;
}

TagCells read_cells(const cv::Mat& grey, const Mat3& H, int n) {
  TagCells out;
  out.n = n;
  out.grey.resize(static_cast<std::size_t>(n * n));
  out.is_inside.assign(static_cast<std::size_t>(n * n), 1);
  for (int r = 0; r < n; ++r) {
    for (int c = 0; c < n; ++c) {
      const auto i = static_cast<std::size_t>(r * n + c);
      double sum = 0;
      for (const double y : kPlaces) {
        for (const double x : kPlaces) {
          const auto px = map_point(H, Vec2((c + x) / n, (r + y) / n));
          if (!px || px->x() < 0 || px->y() < 0 || px->x() > grey.cols - 1 || px->y() > grey.rows - 1)
            out.is_inside[i] = 0;
          else
            sum += sample(grey, *px);
        }
      }
      out.grey[i] = static_cast<float>(sum / (kPlaces.size() * kPlaces.size()));
    }
  }
  return out;
}

std::optional<TagBits> threshold_cells(const TagCells& cells, int border) {
  const auto dark = dark_plane(cells, border);
  if (!dark) return std::nullopt;
  const std::vector<float> level = levels_of(cells, *dark);
  std::vector<float> known;
  for (std::size_t i = 0; i < level.size(); ++i) {
    if (cells.is_inside[i] != 0) known.push_back(level[i]);
  }
  TagBits out;
  const auto limit = two_levels(known, out.contrast);
  if (!limit || out.contrast < kMinContrast) return std::nullopt;
  const double slope = std::max(std::abs(dark->per_column), std::abs(dark->per_row)) * (cells.n - 1);
  if (slope > kMostSlope * out.contrast) return std::nullopt;
  out.n = cells.n - 2 * border;
  int n_border = 0, n_bright = 0;
  for (int r = 0; r < cells.n; ++r) {
    for (int c = 0; c < cells.n; ++c) {
      const auto i = static_cast<std::size_t>(r * cells.n + c);
      if (cells.is_inside[i] == 0) continue;
      const bool is_white = level[i] > *limit;
      if (is_border(r, c, cells.n, border)) {
        ++n_border;
        n_bright += is_white ? 1 : 0;
        continue;
      }
      const int bit = (r - border) * out.n + c - border;
      out.is_inside |= std::uint64_t{1} << bit;
      if (is_white) out.white |= std::uint64_t{1} << bit;
    }
  }
  if (n_bright > kBrightBorder * n_border) return std::nullopt;
  return out;
}

TagReading match_code(const TagBits& bits, const TagBook& book) {
  TagReading out{-1, 0, 65, 65};
  if (bits.n != book.n) return out;
  const Turns turns = turns_of(bits);
  for (std::size_t id = 0; id < book.codes.size(); ++id) {
    for (std::size_t t = 0; t < 4; ++t) {
      const int errors = std::popcount((turns.white[t] ^ book.codes[id]) & turns.is_inside[t]);
      if (errors < out.errors) {
        out.next = out.errors;
        out.id = static_cast<int>(id), out.turn = static_cast<int>(t), out.errors = errors;
      } else {
        out.next = std::min(out.next, errors);
      }
    }
  }
  return out;
}

int count_errors(const TagBits& bits, const TagBook& book, int id, int turn) {
  const Turns turns = turns_of(bits);
  const auto t = static_cast<std::size_t>(turn);
  return std::popcount((turns.white[t] ^ book.codes[static_cast<std::size_t>(id)]) & turns.is_inside[t]);
}

}  // namespace plumbline::detail

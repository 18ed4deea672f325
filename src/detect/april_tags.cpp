// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "detect/markers.hpp"
#include "detect/planar.hpp"
#include "detect/pyramid.hpp"
#include "detect/saddles.hpp"
#include "detect/subpixel.hpp"
#include "detect/tag_bits.hpp"
#include "detect/tag_quads.hpp"

namespace plumbline::detail {
namespace {

/// Images are halved until no side is longer than this: blur and noise shrink with them.
constexpr int kCoarsest = 500;
constexpr double kMostSidePx = 170;  ///< of a tag; larger ones are met in the next smaller image
constexpr double kLeastSidePx = 12;  ///< [px of the whole image] narrower tags are not read
constexpr double kModulePx = 4;      ///< bits are read in the smallest image in which a module has as much
/// The strongest are looked at: a tag has some twenty saddles between its modules and four at its corners,
/// and other things have some, too.
constexpr int kSaddlesOfTag = 40, kOtherSaddles = 1000;

/// An image and its halves.
struct Level {
  cv::Mat grey;
  Vec2 ratio;  ///< of the whole image to it
  Vec2 up(const Vec2& p) const { return (p + Vec2(0.5, 0.5)).cwiseProduct(ratio) - Vec2(0.5, 0.5); }
  Vec2 down(const Vec2& p) const { return (p + Vec2(0.5, 0.5)).cwiseQuotient(ratio) - Vec2(0.5, 0.5); }
};

std::vector<Level> levels_of(const cv::Mat& grey) {
  const std::vector<cv::Mat> pyramid = pyramid_of(grey, kCoarsest);
  std::vector<Level> out;
  for (std::size_t k = pyramid.size(); k-- > 0;)
    out.push_back({pyramid[k], Vec2::Constant(pyramid_ratio(pyramid.size(), k))});
  return out;
}

/// The tag in a dark field of the whole image (corners clockwise), or nullopt.
std::optional<Marker> read_tag(const std::vector<Level>& levels, const std::array<Vec2, 4>& px,
                               const TagBook& book, int first_border) {
  const double side = side_px(px);
  if (side < kLeastSidePx) return std::nullopt;
  std::size_t at = levels.size() - 1;
  while (at > 0 && side / levels[at].ratio.x() < kModulePx * (book.n + 4)) --at;
  std::array<Vec2, 4> local = px;
  for (Vec2& p : local) p = levels[at].down(p);
  const auto H = square_to_quad(local);
  if (!H) return std::nullopt;
  for (const int border : {first_border, 3 - first_border}) {
    const auto bits = threshold_cells(read_cells(levels[at].grey, *H, book.n + 2 * border), border);
    if (!bits) continue;
    const TagReading reading = match_code(*bits, book);
    if (reading.errors > most_errors(book)) continue;
    // The upright tag's top left is corner `turn`.
    const auto k = static_cast<std::size_t>(reading.turn);
    return Marker{reading.id, {px[(k + 3) % 4], px[(k + 2) % 4], px[(k + 1) % 4], px[k]}, border};
  }
  return std::nullopt;
}

}  // namespace

std::vector<Marker> find_april_tags(const cv::Mat& grey, std::string_view family, int border, int n_tags,
                                    const std::function<bool(const std::vector<Marker>&)>& is_enough) {
  std::vector<Marker> markers;
  const TagBook* book = april_book(family);
  if (book == nullptr) return markers;
  const std::vector<Level> levels = levels_of(grey);
  for (std::size_t i = levels.size(); i-- > 0;) {
    const Level& level = levels[i];
    const double noise = noise_level(level.grey, {0, 0, level.grey.cols, level.grey.rows});
    const auto saddles = find_saddles(level.grey, noise, kOtherSaddles + kSaddlesOfTag * n_tags);
    const bool is_coarsest = i + 1 == levels.size();
    for (const DarkQuad& quad : find_dark_quads(level.grey, saddles, is_coarsest ? kCoarsest : kMostSidePx)) {
      std::array<Vec2, 4> px;
      for (std::size_t k = 0; k < 4; ++k) px[k] = level.up(saddles[static_cast<std::size_t>(quad[k])].px);
      if (const auto tag = read_tag(levels, px, *book, border)) markers.push_back(*tag);
    }
    if (is_enough(markers)) break;
  }
  return markers;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include "plumbline/detect/detect.hpp"
#include "plumbline/image/video.hpp"

namespace plumbline {
namespace {

constexpr std::string_view kReason = "near-duplicate of frame ";

/// The largest distance of a corner from the same one of an earlier view; nullopt when there is none of it,
/// or it is more than `most_px` away.
std::optional<double> largest_move_px(const View& view, const View& earlier, double most_px) {
  double largest = 0;
  auto other = earlier.corners.begin();
  for (const Corner& corner : view.corners) {  // both ascend by point
    while (other != earlier.corners.end() && other->point < corner.point) ++other;
    if (other == earlier.corners.end() || other->point != corner.point) return std::nullopt;
    largest = std::max(largest, (corner.px - other->px).norm());
    if (!(largest <= most_px)) return std::nullopt;
  }
  return largest;
}

/// The views of a frame that have corners.
using FrameViews = std::vector<View*>;

std::optional<double> largest_move_px(const Dataset& data, const FrameViews& frame, const FrameViews& earlier,
                                      std::optional<double> thin_px) {
  double largest = 0;
  for (const View* view : frame) {
    const auto same = std::find_if(earlier.begin(), earlier.end(), [&](const View* other) {
      return other->cam == view->cam && other->target == view->target;
    });
    if (same == earlier.end()) return std::nullopt;
    const ImageSize size = data.cameras[static_cast<std::size_t>(view->cam)].size;
    const auto move =
        largest_move_px(*view, **same, thin_px.value_or(kThinFraction * std::hypot(size.width, size.height)));
    if (!move) return std::nullopt;
    largest = std::max(largest, *move);
  }
  return largest;
}

}  // namespace

void thin_near_duplicates(Dataset& data, std::optional<double> thin_px) {
  if (thin_px && !(*thin_px > 0)) return;
  std::vector<FrameViews> frames(data.frames.size());
  for (View& view : data.views) {
    if (!view.corners.empty()) frames[static_cast<std::size_t>(view.frame)].push_back(&view);
  }
  std::vector<std::size_t> kept;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    if (frames[f].empty()) continue;
    const bool may_go = thin_px || std::all_of(frames[f].begin(), frames[f].end(), [](const View* view) {
                          return parse_frame_path(view->image).has_value();
                        });
    bool is_new = true;
    // The latest first: it is the likeliest to be the same.
    for (auto earlier = kept.rbegin(); may_go && is_new && earlier != kept.rend(); ++earlier) {
      const auto move = largest_move_px(data, frames[f], frames[*earlier], thin_px);
      if (!move) continue;
      is_new = false;
      for (View* view : frames[f]) {
        view->corners.clear();
        view->reason =
            fmt::format("{}{}: corners moved by {:.1f} px at most", kReason, data.frames[*earlier], *move);
      }
    }
    if (is_new) kept.push_back(f);
  }
}

bool is_near_duplicate(const View& view) { return view.reason.starts_with(kReason); }

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "detect/charuco.hpp"
#include "detect/finders.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline::detail {

Result<Detection> detect_rig(const cv::Mat& grey, const BoardRig& rig, const Target& target) {
  bool has_tags = false;
  for (const BoardPart& part : rig.parts) {
    if (std::holds_alternative<AprilGrid>(part.board)) {
      has_tags = true;
    } else if (!std::holds_alternative<Charuco>(part.board)) {
      return Error{ErrorCode::kUnsupported,
                   fmt::format("a part of kind '{}' cannot be told from the others in an image; ChArUco "
                               "boards and AprilGrids can",
                               target_type(part.board)),
                   target.name};
    }
  }
  LatticePyramid lattices(grey);  // shared by all parts
  std::vector<CharucoFind> finds(rig.parts.size());
  const std::vector<Marker> tags = has_tags ? find_april_tags(grey) : std::vector<Marker>{};

  Detection out;
  bool has_open = false;
  for (std::size_t i = 0; i < rig.parts.size(); ++i) {
    const auto* charuco = std::get_if<Charuco>(&rig.parts[i].board);
    if (charuco == nullptr) continue;
    finds[i] = find_charuco(lattices, *charuco);
    has_open = has_open || has_open_layout(*charuco);
    out.layout_vote += finds[i].reading.layout_vote;
  }
  const auto layout = out.layout_vote < 0 ? Charuco::Layout::kLegacy : Charuco::Layout::kCurrent;
  std::vector<std::string> reasons;
  int offset = 0, part_number = 0;
  for (const BoardPart& part : rig.parts) {
    Detection found;
    int n_points = 0;
    if (const auto* charuco = std::get_if<Charuco>(&part.board)) {
      const CharucoFind& find = finds[static_cast<std::size_t>(part_number)];
      const bool is_legacy = layout == Charuco::Layout::kLegacy;
      found = find.detection;
      if (has_open_layout(*charuco) && (find.reading.layout_vote < 0) != is_legacy)
        found = charuco_from_reading(grey, *charuco, find.reading, is_legacy);
      n_points = (charuco->columns - 1) * (charuco->rows - 1);
    } else if (const auto* grid = std::get_if<AprilGrid>(&part.board)) {
      found = aprilgrid_from_tags(grey, *grid, tags);
      n_points = grid->columns * grid->rows * 4;
    }
    ++part_number;
    for (Corner corner : found.corners) {
      corner.point += offset;
      out.corners.push_back(corner);
    }
    if (found.corners.empty()) reasons.push_back(fmt::format("part {}: {}", part_number, found.reason));
    offset += n_points;
  }
  if (!out.corners.empty()) {
    const std::string_view open = layout == Charuco::Layout::kLegacy ? ", layout legacy" : ", layout current";
    out.method = fmt::format("markers{}, saddle fit", has_open ? open : "");
  }
  if (out.corners.empty())
    out.reason = fmt::format("none of {} parts found: {}", rig.parts.size(), join(reasons, "; "));
  return out;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/core/types.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {

/// One target point seen in an image.
struct Corner {
  int point = -1;          ///< index into Target::points of the view's target
  Vec2 px = Vec2::Zero();  ///< [px], pixel centres at integers
  double sigma_px = 1.0;   ///< expected error of each coordinate
};

/// One board in one image of one camera. Views of one frame were taken at the same time, so that the rig and
/// the boards stood in the same places; an image that was searched for several boards gives a view for each.
struct View {
  int cam = 0;                  ///< index into Dataset::cameras
  int frame = 0;                ///< index into Dataset::frames
  std::string image;            ///< file name as the user gave it, never absolute
  std::vector<Corner> corners;  ///< ascending by point, each at most once; empty when nothing was found
  std::string reason;           ///< why there are no corners; empty when there are
  int target = 0;               ///< index into Dataset::targets
  std::optional<double> time_s =
      std::nullopt;  ///< by its camera's clock [s], when its middle row was exposed
};

struct CameraInfo {
  std::string name;
  ImageSize size;
};

/// What was measured, and nothing estimated.
struct Dataset {
  /// The boards. Where there are several, they stand still relative to one another; the first one's frame is
  /// the world's.
  std::vector<Target> targets;
  std::vector<CameraInfo> cameras;
  std::vector<std::string> frames;  ///< the text that matched the wildcards: "01"
  std::vector<View> views;          ///< by camera, then by natural order of the image's name, then by target
  std::string detector;  ///< how the corners were found ("chessboard: saddle fit"); a remark, may be empty
};

/// kInvalidData when an index, a pixel or a sigma of the data set makes no sense (names the view), two
/// corners of a view have the same point, a camera has no size, there is no target, or two targets, or a
/// target and a camera, have one name where there are several targets.
Status validate(const Dataset& data);

}  // namespace plumbline

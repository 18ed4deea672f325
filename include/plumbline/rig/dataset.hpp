// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/core/types.hpp"
#include "plumbline/target/target.hpp"

namespace plumbline {

/// One target point seen in an image.
struct Corner {
  int point = -1;          ///< index into Target::points
  Vec2 px = Vec2::Zero();  ///< [px], pixel centres at integers
  double sigma_px = 1.0;   ///< expected error of each coordinate
};

/// One image of one camera. Views of different cameras with the same frame saw the board in the same place.
struct View {
  int cam = 0;                  ///< index into Dataset::cameras
  int frame = 0;                ///< index into Dataset::frames
  std::string image;            ///< file name as the user gave it, never absolute
  std::vector<Corner> corners;  ///< ascending by point, each at most once; empty when nothing was found
  std::string reason;           ///< why there are no corners; empty when there are
};

struct CameraInfo {
  std::string name;
  ImageSize size;
};

/// What was measured, and nothing estimated.
struct Dataset {
  Target target;
  std::vector<CameraInfo> cameras;
  std::vector<std::string> frames;  ///< the text that matched the wildcards: "01"
  std::vector<View> views;          ///< by camera, then by natural order of the image's name
  std::string detector;  ///< how the corners were found ("chessboard: cornerSubPix"); a remark, may be empty
};

/// kInvalidData when an index, a pixel or a sigma of the data set makes no sense (names the view), two
/// corners of a view have the same point, or a camera has no size.
Status validate(const Dataset& data);

}  // namespace plumbline

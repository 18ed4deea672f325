// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "detect/point_features.hpp"
#include "plumbline/rig/dataset.hpp"
#include "plumbline/rig/rig.hpp"

/// One image of one board once more, now that lens and pose are known.
namespace plumbline::detail {

/// What is known before.
struct ViewBefore {
  const Camera* camera = nullptr;
  const std::vector<Vec3>* p_target = nullptr;  ///< with the bow, where one is known
  const std::vector<PointFeature>* features = nullptr;
  SE3 T_cam_target;             ///< good to a quarter of a square where there are no corners
  std::vector<Corner> corners;  ///< found at the first look; may be empty
  double usual_rms_px = 0.3;    ///< of a coordinate, in views of this camera
};

struct ViewAfter {
  std::vector<Corner> corners;  ///< ascending by point, the old ones among them
  SE3 T_cam_target;             ///< that fits them
  int n_new = 0;
};

/// Corners of squares and tags: where the lens puts each missing one, moved by what it is off at its
/// neighbours, the saddle is fitted with the lens' own local map and bend. It stays when its fields are dark
/// and bright as on the board and as strong as in the others, the model leaves no more than there, it lies
/// where it was foretold (half a pixel and five sigmas), and it fits the pose through all. A view without
/// corners needs six that agree and a third of those in the image. nullopt: nothing new.
std::optional<ViewAfter> look_for_saddles(const cv::Mat& grey, const ViewBefore& before);

/// A disc as it was measured: its centroid, which is not yet the circle's centre.
struct MeasuredDisc {
  int point = 0;
  Vec2 centroid_px;
  double sigma_px = 0;
  double diameter = 0;  ///< [board units], by its area
};

/// Circles, all measured anew: centroids where the image shows a disc as large as the others where it was
/// foretold. Empty: fewer than six, or than a third of those in the image.
std::vector<MeasuredDisc> look_for_discs(const cv::Mat& grey, const ViewBefore& before);

/// Median diameter [board units] of the dark blobs at these corners, of whatever size; 0: none is clear.
double disc_diameter(const cv::Mat& grey, const ViewBefore& before);

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "detect/markers.hpp"

namespace plumbline::detail {
namespace {

/// Kalibr prints 36h11 with a black border of two modules where the family has one: the code moves one module
/// in.
apriltag_family_t* wide_border_family() {
  apriltag_family_t* family = tag36h11_create();
  family->width_at_border = 10;
  family->total_width = 12;
  for (uint32_t i = 0; i < family->nbits; ++i) {
    ++family->bit_x[i];
    ++family->bit_y[i];
  }
  return family;
}

/// A detector and its family. The library's detector is not re-entrant, so each call makes its own.
class TagDetector {
 public:
  TagDetector() : family_(wide_border_family()), detector_(apriltag_detector_create()) {
    detector_->nthreads = 1;
    detector_->debug = false;
    detector_->refine_edges = true;
    apriltag_detector_add_family_bits(detector_, family_, 2);
  }
  ~TagDetector() {
    apriltag_detector_destroy(detector_);
    tag36h11_destroy(family_);
  }
  TagDetector(const TagDetector&) = delete;
  TagDetector& operator=(const TagDetector&) = delete;

  void find(const cv::Mat& grey, float decimate, std::vector<Marker>& markers) {
    detector_->quad_decimate = decimate;
    image_u8_t image{grey.cols, grey.rows, static_cast<int32_t>(grey.step), grey.data};
    zarray_t* found = apriltag_detector_detect(detector_, &image);
    for (int i = 0; i < zarray_size(found); ++i) {
      apriltag_detection_t* tag = nullptr;
      zarray_get(found, i, static_cast<void*>(&tag));
      Marker marker{tag->id, {}};
      // The library's pixel (0, 0) is the top-left pixel's corner. Its first corner is the tag's bottom left.
      for (std::size_t k = 0; k < 4; ++k) marker.px[k] = Vec2(tag->p[k][0] - 0.5, tag->p[k][1] - 0.5);
      markers.push_back(marker);
    }
    apriltag_detections_destroy(found);
  }

 private:
  apriltag_family_t* family_;
  apriltag_detector_t* detector_;
};

}  // namespace

std::vector<Marker> find_april_tags(const cv::Mat& grey) {
  // On wide lenses the small black squares grow together with the tags they touch; each of these views parts
  // another share of them (measured in docs/detect.md).
  const cv::Mat contiguous = grey.isContinuous() ? grey : grey.clone();
  cv::Mat dilated, brighter;
  cv::dilate(contiguous, dilated, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  contiguous.convertTo(brighter, CV_8U, 2.0);
  std::vector<Marker> markers;
  TagDetector detector;
  // Large photographs show large tags: they are looked for at a reduced size (corners are refined at full
  // size later).
  const float base = std::max(1.0F, std::round(static_cast<float>(std::max(grey.cols, grey.rows)) / 1600));
  detector.find(contiguous, base, markers);
  detector.find(contiguous, 2 * base, markers);
  detector.find(dilated, base, markers);
  detector.find(brighter, base, markers);
  cv::Mat reduced = contiguous;
  if (base > 1) cv::resize(contiguous, reduced, cv::Size(), 1 / base, 1 / base, cv::INTER_AREA);
  const Vec2 scale(static_cast<double>(grey.cols) / reduced.cols,
                   static_cast<double>(grey.rows) / reduced.rows);
  for (const Marker& found : find_aruco(reduced, "APRILTAG_36h11", 0, 2)) {
    // OpenCV numbers clockwise and has this family turned by half a turn against Kalibr: BR, BL, TL, TR.
    Marker tag{found.id, {found.px[1], found.px[0], found.px[3], found.px[2]}};
    for (Vec2& p : tag.px) p = (p + Vec2(0.5, 0.5)).cwiseProduct(scale) - Vec2(0.5, 0.5);
    markers.push_back(tag);
  }
  return markers;
}

}  // namespace plumbline::detail

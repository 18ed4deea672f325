// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <span>
#include <string>
#include <vector>

#include "plumbline/detect/detect.hpp"

namespace plumbline::apps {

/// What became of an image.
enum class Outcome {
  kFound,     ///< each board with all its points
  kPartial,   ///< some points
  kThinned,   ///< an earlier frame shows the same
  kRejected,  ///< no corners
};

/// Of the views of one image.
Outcome outcome_of(std::span<const View* const> views, const Dataset& data);

/// "54 of 54 corners", "13 of 54, 20 of 24 corners" or the reason why there are none.
std::string text_of_outcome(std::span<const View* const> views, const Dataset& data);

/// Green, yellow, blue and red, as BGR.
cv::Scalar colour_of(Outcome outcome);

/// All images of a run as small pictures with their names, on pages contact_sheet.png, contact_sheet_2.png
/// and so on. A page is in memory from its first picture until its last, and is then written.
class ContactSheet {
 public:
  /// \param views  those of each image of each camera
  ContactSheet(std::filesystem::path folder, const std::vector<CameraImages>& images, const Dataset& data,
               const std::vector<std::vector<std::vector<const View*>>>& views);

  /// Puts in one picture (8-bit BGR); from any thread. kIo when a page that is now full cannot be written.
  Status add(std::size_t cam, std::size_t image, const cv::Mat& picture);

 private:
  struct Cell {
    std::size_t page = 0;
    cv::Rect picture;
  };
  struct Heading {
    std::size_t page = 0;
    int top = 0;
    std::string text;
  };
  void lay_out();
  void open_page(std::size_t page);
  void draw_cell(cv::Mat& sheet, std::size_t cam, std::size_t image, const cv::Mat& small) const;

  std::filesystem::path folder_;
  const std::vector<CameraImages>& images_;
  const Dataset& data_;
  const std::vector<std::vector<std::vector<const View*>>>& views_;
  std::vector<std::vector<Cell>> cells_;  ///< by camera and image
  std::vector<Heading> headings_;
  std::vector<int> n_left_, height_;  ///< by page: pictures still to come, height [px]
  std::vector<cv::Mat> sheets_;       ///< by page; empty before its first picture and after its last
  std::mutex lock_;
};

}  // namespace plumbline::apps

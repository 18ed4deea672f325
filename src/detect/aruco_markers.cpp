// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <opencv2/aruco.hpp>
#include <set>
#include <string>
#include <utility>

#include "detect/markers.hpp"
#include "plumbline/core/check.hpp"

namespace plumbline::detail {
namespace {

cv::Ptr<cv::aruco::Dictionary> dictionary_of(std::string_view name) {
  using namespace cv::aruco;
  static constexpr std::pair<std::string_view, PREDEFINED_DICTIONARY_NAME> kNames[] = {
      {"4X4_50", DICT_4X4_50},
      {"4X4_100", DICT_4X4_100},
      {"4X4_250", DICT_4X4_250},
      {"4X4_1000", DICT_4X4_1000},
      {"5X5_50", DICT_5X5_50},
      {"5X5_100", DICT_5X5_100},
      {"5X5_250", DICT_5X5_250},
      {"5X5_1000", DICT_5X5_1000},
      {"6X6_50", DICT_6X6_50},
      {"6X6_100", DICT_6X6_100},
      {"6X6_250", DICT_6X6_250},
      {"6X6_1000", DICT_6X6_1000},
      {"7X7_50", DICT_7X7_50},
      {"7X7_100", DICT_7X7_100},
      {"7X7_250", DICT_7X7_250},
      {"7X7_1000", DICT_7X7_1000},
      {"ARUCO_ORIGINAL", DICT_ARUCO_ORIGINAL},
      {"APRILTAG_16h5", DICT_APRILTAG_16h5},
      {"APRILTAG_25h9", DICT_APRILTAG_25h9},
      {"APRILTAG_36h10", DICT_APRILTAG_36h10},
      {"APRILTAG_36h11", DICT_APRILTAG_36h11}};
  for (const auto& [text, value] : kNames) {
    if (text == name) return getPredefinedDictionary(value);
  }
  throw_invalid_argument("no ArUco dictionary is called '" + std::string(name) + "'");
}

/// Thresholding windows [px] of one look; a window should be wider than a marker's border and narrower than
/// the marker.
struct Look {
  int window_min, window_max, window_step;
  bool is_negative;
};

void look(const cv::Mat& grey, const cv::Ptr<cv::aruco::Dictionary>& dictionary, const Look& how,
          int border_bits, std::vector<Marker>& markers) {
  const auto parameters = cv::aruco::DetectorParameters::create();
  parameters->adaptiveThreshWinSizeMin = how.window_min;
  parameters->adaptiveThreshWinSizeMax = how.window_max;
  parameters->adaptiveThreshWinSizeStep = how.window_step;
  parameters->minMarkerPerimeterRate =
      0.01;  // OpenCV's 0.03 of the width leaves out small boards in wide views
  parameters->markerBorderBits = border_bits;
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  cv::Mat image = grey;
  if (how.is_negative) cv::bitwise_not(grey, image);
  try {
    cv::aruco::detectMarkers(image, dictionary, corners, ids, parameters);
  } catch (const cv::Exception&) {
    return;  // asserts on degenerate candidates: nothing was found this way
  }
  std::set<int> known;
  for (const Marker& m : markers) known.insert(m.id);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (known.contains(ids[i]))
      continue;  // the first look at a marker counts; doubles within one look are kept
    Marker marker{ids[i], {}};
    for (std::size_t k = 0; k < 4; ++k) marker.px[k] = Vec2(corners[i][k].x, corners[i][k].y);
    markers.push_back(marker);
  }
}

}  // namespace

MarkerCodes marker_codes(std::string_view dictionary) {
  const auto markers = dictionary_of(dictionary);
  const int n = markers->markerSize;
  MarkerCodes out{n, {}};
  for (int id = 0; id < markers->bytesList.rows; ++id) {
    const cv::Mat bits = cv::aruco::Dictionary::getBitsFromByteList(markers->bytesList.row(id), n);
    std::array<std::uint64_t, 4> code{};
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        int at_x = x, at_y = y;
        for (std::size_t turn = 0; turn < 4; ++turn) {
          if (bits.at<unsigned char>(at_y, at_x) != 0) code[turn] |= std::uint64_t{1} << (y * n + x);
          at_x = std::exchange(at_y, at_x);
          at_x = n - 1 - at_x;
        }
      }
    }
    out.code.push_back(code);
  }
  return out;
}

std::vector<Marker> find_aruco(const cv::Mat& grey, std::string_view dictionary, int expected,
                               int border_bits) {
  const auto markers_of = dictionary_of(dictionary);
  const int widest = std::clamp(std::max(grey.cols, grey.rows) / 20, 33, 153) | 1;
  const Look looks[] = {{3, 23, 10, false},
                        {5, widest, std::max(14, widest / 5 * 2), false},
                        {3, 23, 10, true},
                        {5, widest, std::max(14, widest / 5 * 2), true}};
  std::vector<Marker> markers;
  for (const Look& how : looks) {
    look(grey, markers_of, how, border_bits, markers);
    if (2 * static_cast<int>(markers.size()) >= expected) break;
  }
  return markers;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include <opencv2/aruco.hpp>
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

}  // namespace plumbline::detail

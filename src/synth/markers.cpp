// SPDX-License-Identifier: Apache-2.0
#include "markers.hpp"

#include <apriltag/apriltag.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>
#include <fmt/format.h>

#include <array>
#include <memory>
#include <opencv2/aruco/dictionary.hpp>
#include <optional>

namespace plumbline::detail {
namespace {

Error bad(const std::string& message) { return {ErrorCode::kInvalidData, message, "marker"}; }

std::optional<int> dictionary_number(std::string_view name) {
  // The order of cv::aruco::PREDEFINED_DICTIONARY_NAME.
  constexpr std::array<std::string_view, 21> kNames{
      "4X4_50",        "4X4_100",        "4X4_250",       "4X4_1000", "5X5_50",         "5X5_100",
      "5X5_250",       "5X5_1000",       "6X6_50",        "6X6_100",  "6X6_250",        "6X6_1000",
      "7X7_50",        "7X7_100",        "7X7_250",       "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_16h5",
      "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"};
  static_assert(cv::aruco::DICT_4X4_50 == 0 && cv::aruco::DICT_7X7_1000 == 15 &&
                cv::aruco::DICT_APRILTAG_36h11 == 20);
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] == name) return static_cast<int>(i);
  }
  return std::nullopt;
}

}  // namespace

Result<Modules> aruco_modules(std::string_view dictionary, int id) {
  const auto number = dictionary_number(dictionary);
  if (!number) return bad(fmt::format("no ArUco dictionary is called '{}'", dictionary));
  const auto dict = cv::aruco::getPredefinedDictionary(*number);
  if (id < 0 || id >= dict->bytesList.rows) {
    return bad(fmt::format("dictionary {} has no marker {}", dictionary, id));
  }
  const cv::Mat bits =
      cv::aruco::Dictionary::getBitsFromByteList(dict->bytesList.rowRange(id, id + 1), dict->markerSize);
  Modules modules{dict->markerSize + 2, {}};
  modules.black.assign(static_cast<std::size_t>(modules.n * modules.n), 1);
  for (int r = 0; r < bits.rows; ++r) {
    for (int c = 0; c < bits.cols; ++c) {
      modules.black[static_cast<std::size_t>((r + 1) * modules.n + c + 1)] =
          bits.at<unsigned char>(r, c) == 0;
    }
  }
  return modules;
}

Result<Modules> april_modules(std::string_view name, int id, int border) {
  using Family = std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)>;
  const Family family = name == "36h11"  ? Family(tag36h11_create(), tag36h11_destroy)
                        : name == "25h9" ? Family(tag25h9_create(), tag25h9_destroy)
                                         : Family(nullptr, tag36h11_destroy);
  if (!family) return bad(fmt::format("no tag family is called '{}'", name));
  if (id < 0 || id >= static_cast<int>(family->ncodes))
    return bad(fmt::format("tag{} has no tag {}", name, id));
  const int n = family->width_at_border + 2 * (border - 1);
  Modules modules{n, std::vector<char>(static_cast<std::size_t>(n * n), 1)};
  // bit_x and bit_y count modules from the outer edge of a border ONE module wide. The first of the nbits
  // bits is the highest; a bit that is set is white.
  for (std::uint32_t i = 0; i < family->nbits; ++i) {
    const bool white = (family->codes[id] >> (family->nbits - 1 - i)) & 1;
    const int row = static_cast<int>(family->bit_y[i]) + border - 1;
    const int column = static_cast<int>(family->bit_x[i]) + border - 1;
    modules.black[static_cast<std::size_t>(row * n + column)] = !white;
  }
  return modules;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include "pictures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <set>

#include "plumbline/core/text.hpp"
#include "plumbline/image/image.hpp"
#include "plumbline/image/video.hpp"

namespace plumbline::apps {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kDigitHeight = 22;  ///< [px] of that font at scale 1

int thickness(double height_px) { return std::max(1, static_cast<int>(std::lround(height_px / 10))); }

}  // namespace

std::vector<std::string> picture_names(const CameraImages& images) {
  std::vector<std::string> names;
  for (const std::filesystem::path& file : images.files) {
    const auto frame = parse_frame_path(file.string());
    names.push_back(frame ? fmt::format("{}_{:06d}", frame->video.stem().string(), frame->frame)
                          : file.stem().string());
  }
  if (std::set<std::string>(names.begin(), names.end()).size() == names.size()) return names;
  names = images.frames;
  for (std::string& name : names) std::replace(name.begin(), name.end(), '/', '_');
  return names;
}

cv::Mat in_colour(const cv::Mat& image) {
  cv::Mat colour = to_8bit(image);
  if (colour.channels() == 1)
    cv::cvtColor(colour, colour, cv::COLOR_GRAY2BGR);
  else if (colour.data == image.data)
    colour = colour.clone();
  return colour;
}

void draw_text(cv::Mat& picture, const std::string& text, const Label& label) {
  const double scale = label.height_px / kDigitHeight;
  const int t = thickness(label.height_px);
  if (label.outlined) cv::putText(picture, text, label.at, kFont, scale, {0, 0, 0}, 2 * t + 1, cv::LINE_AA);
  cv::putText(picture, text, label.at, kFont, scale, label.colour, t, cv::LINE_AA);
}

int text_width(const std::string& text, double height_px) {
  return cv::getTextSize(text, kFont, height_px / kDigitHeight, thickness(height_px), nullptr).width;
}

std::vector<std::string> wrap_text(const std::string& text, double height_px, int width_px,
                                   std::size_t most) {
  const auto fits = [&](const std::string& line) { return text_width(line, height_px) <= width_px; };
  std::vector<std::string> lines;
  for (std::string word : split(text, ' ')) {
    if (!lines.empty() && fits(lines.back() + " " + word)) {
      lines.back() += " " + word;
      continue;
    }
    while (word.size() > 1 && !fits(word)) {  // a word longer than a line
      std::size_t n = word.size() - 1;
      while (n > 1 && !fits(word.substr(0, n))) --n;
      lines.push_back(word.substr(0, n));
      word.erase(0, n);
    }
    lines.push_back(word);
  }
  if (lines.size() > most) {
    lines.resize(most);
    while (lines.back().size() > 1 && !fits(lines.back() + "...")) lines.back().pop_back();
    lines.back() += "...";
  }
  return lines;
}

}  // namespace plumbline::apps

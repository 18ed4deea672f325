// SPDX-License-Identifier: Apache-2.0
#include "contact_sheet.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>

#include "pictures.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::apps {
namespace {

constexpr int kColumns = 7, kMostRows = 10;  ///< 70 pictures a page
constexpr int kPictureWidth = 240, kPictureHeight = 180, kGap = 16, kFrame = 4;
constexpr double kText = 10;               ///< height of a digit [px]
constexpr int kLine = 17;                  ///< [px] from line to line
constexpr std::size_t kMostLines = 4;      ///< for the reason
constexpr int kTitle = 44, kHeading = 34;  ///< heights [px]
constexpr int kWidth = kGap + kColumns * (kPictureWidth + kGap);
const cv::Scalar kPaper(32, 32, 32), kInk(235, 235, 235);

const char* name_of(Outcome outcome) {
  constexpr std::array<const char*, 4> kNames{"found", "partial", "near-duplicate", "rejected"};
  return kNames[static_cast<std::size_t>(outcome)];
}

/// The size of a picture in its cell.
cv::Size small_size(ImageSize size) {
  if (size.width <= 0 || size.height <= 0) return {kPictureWidth, kPictureHeight};
  const double scale = std::min(double(kPictureWidth) / size.width, double(kPictureHeight) / size.height);
  return {std::max(1, static_cast<int>(std::lround(scale * size.width))),
          std::max(1, static_cast<int>(std::lround(scale * size.height)))};
}

}  // namespace

Outcome outcome_of(std::span<const View* const> views, const Dataset& data) {
  bool any = false, all = !views.empty(), thinned = false;
  for (const View* view : views) {
    any |= !view->corners.empty();
    all &= view->corners.size() == data.targets[view->target].points.size();
    thinned |= is_near_duplicate(*view);
  }
  return all ? Outcome::kFound : any ? Outcome::kPartial : thinned ? Outcome::kThinned : Outcome::kRejected;
}

std::string text_of_outcome(std::span<const View* const> views, const Dataset& data) {
  std::vector<std::string> counts, reasons;
  for (const View* view : views) {
    if (view->corners.empty())
      reasons.push_back(view->reason);
    else
      counts.push_back(
          fmt::format("{} of {}", view->corners.size(), data.targets[view->target].points.size()));
  }
  return counts.empty() ? join(reasons, "; ") : join(counts, ", ") + " corners";
}

cv::Scalar colour_of(Outcome outcome) {
  switch (outcome) {
    case Outcome::kFound:
      return {90, 200, 60};
    case Outcome::kPartial:
      return {40, 210, 245};
    case Outcome::kThinned:
      return {230, 150, 70};
    default:
      return {70, 70, 240};
  }
}

ContactSheet::ContactSheet(std::filesystem::path folder, const std::vector<CameraImages>& images,
                           const Dataset& data,
                           const std::vector<std::vector<std::vector<const View*>>>& views)
    : folder_(std::move(folder)), images_(images), data_(data), views_(views) {
  lay_out();
}

void ContactSheet::lay_out() {
  int top = kTitle, rows = 0;
  std::size_t page = 0;
  const auto page_ends = [&] {
    height_.push_back(top + kGap);
    n_left_.push_back(0);
  };
  const auto new_row = [&](int height) {
    if (rows == kMostRows) {
      page_ends();
      ++page;
      top = kTitle;
      rows = 0;
    }
    const int at = top;
    top += height;
    return at;
  };
  for (std::size_t cam = 0; cam < images_.size(); ++cam) {
    std::array<int, 4> count{};
    for (const auto& views : views_[cam]) ++count[static_cast<std::size_t>(outcome_of(views, data_))];
    std::string text = fmt::format("{}: {} images", images_[cam].camera, images_[cam].files.size());
    for (std::size_t i = 0; i < count.size(); ++i) {
      if (count[i] > 0) text += fmt::format(", {} {}", count[i], name_of(static_cast<Outcome>(i)));
    }
    const auto head = [&] {
      const int at = new_row(kHeading);  // which may be on a new page
      headings_.push_back({page, at, text});
    };
    head();
    cells_.emplace_back();
    const cv::Size size = small_size(data_.cameras[cam].size);
    for (std::size_t i = 0; i < images_[cam].files.size(); i += kColumns) {
      // A row is as high as its longest text.
      const std::size_t end = std::min(images_[cam].files.size(), i + kColumns);
      std::size_t n_lines = 0;
      for (std::size_t k = i; k < end; ++k) {
        const std::string said = text_of_outcome(views_[cam][k], data_);
        n_lines = std::max(n_lines, 1 + wrap_text(said, kText, kPictureWidth, kMostLines).size());
      }
      if (rows == kMostRows) head();
      const int row = new_row(size.height + static_cast<int>(n_lines) * kLine + 2 * kGap);
      ++rows;
      for (std::size_t k = i; k < end; ++k) {
        const int left = kGap + static_cast<int>(k - i) * (kPictureWidth + kGap);
        cells_[cam].push_back({page, {{left + (kPictureWidth - size.width) / 2, row + kFrame}, size}});
      }
    }
  }
  page_ends();
  sheets_.resize(page + 1);
  for (const auto& of_camera : cells_)
    for (const Cell& cell : of_camera) ++n_left_[cell.page];
}

void ContactSheet::open_page(std::size_t page) {
  cv::Mat& sheet = sheets_[page];
  sheet = cv::Mat(height_[page], kWidth, CV_8UC3, kPaper);
  int left = kGap;
  const int base = kTitle - 16;
  for (const Outcome o : {Outcome::kFound, Outcome::kPartial, Outcome::kThinned, Outcome::kRejected}) {
    cv::rectangle(sheet, cv::Rect(left, base - 12, 14, 14), colour_of(o), cv::FILLED);
    draw_text(sheet, name_of(o), {{left + 20, base}, 12, kInk});
    left += 44 + text_width(name_of(o), 12);
  }
  if (sheets_.size() > 1) {
    const std::string text = fmt::format("page {} of {}", page + 1, sheets_.size());
    draw_text(sheet, text, {{kWidth - kGap - text_width(text, 12), base}, 12, kInk});
  }
  for (const Heading& heading : headings_) {
    if (heading.page == page) draw_text(sheet, heading.text, {{kGap, heading.top + kHeading - 14}, 13, kInk});
  }
}

void ContactSheet::draw_cell(cv::Mat& sheet, std::size_t cam, std::size_t image, const cv::Mat& small) const {
  const cv::Rect at = cells_[cam][image].picture;
  const auto& views = views_[cam][image];
  const cv::Scalar colour = colour_of(outcome_of(views, data_));
  const cv::Rect frame(at.x - kFrame, at.y - kFrame, at.width + 2 * kFrame, at.height + 2 * kFrame);
  cv::rectangle(sheet, frame, colour, cv::FILLED);
  cv::Mat inside = sheet(at);
  small.copyTo(inside);
  const ImageSize size = data_.cameras[cam].size;
  for (const View* view : views) {
    for (const Corner& corner : view->corners) {
      const cv::Point px(
          static_cast<int>(std::lround((corner.px.x() + 0.5) * at.width / size.width - 0.5)),
          static_cast<int>(std::lround((corner.px.y() + 0.5) * at.height / size.height - 0.5)));
      cv::rectangle(inside, px - cv::Point(1, 1), px + cv::Point(1, 1), colour, cv::FILLED);
    }
  }
  // The text has the whole width of the cell, also under a narrow picture.
  const int left = at.x - (kPictureWidth - at.width) / 2;
  int base = at.y + at.height + kFrame + kLine - 2;
  const auto lines_of = [&](const std::string& text, std::size_t most) {
    return wrap_text(text, kText, kPictureWidth, most);
  };
  draw_text(sheet, lines_of(images_[cam].names[image], 1)[0], {{left, base}, kText, kInk});
  for (const std::string& line : lines_of(text_of_outcome(views, data_), kMostLines))
    draw_text(sheet, line, {{left, base += kLine}, kText, colour});
}

Status ContactSheet::add(std::size_t cam, std::size_t image, const cv::Mat& picture) {
  const Cell& cell = cells_[cam][image];
  cv::Mat small;
  cv::resize(picture, small, cell.picture.size(), 0, 0,
             picture.cols > cell.picture.width ? cv::INTER_AREA : cv::INTER_LINEAR);
  cv::Mat full;
  {
    const std::lock_guard hold(lock_);
    if (sheets_[cell.page].empty()) open_page(cell.page);
    draw_cell(sheets_[cell.page], cam, image, small);
    if (--n_left_[cell.page] == 0) std::swap(full, sheets_[cell.page]);
  }
  if (full.empty()) return {};
  const std::string number = cell.page == 0 ? "" : fmt::format("_{}", cell.page + 1);
  return write_png(folder_ / ("contact_sheet" + number + ".png"), full);
}

}  // namespace plumbline::apps

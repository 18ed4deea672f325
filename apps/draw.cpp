// SPDX-License-Identifier: Apache-2.0
#include "draw.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "contact_sheet.hpp"
#include "pictures.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::apps {
namespace {

namespace fs = std::filesystem;

constexpr double kClear_px = 44;  ///< what corners should be apart in a picture
constexpr int kMostEnlarged = 4;
constexpr int kMostWidth = 3200;  ///< [px]; no image is enlarged beyond it
constexpr double kCircle = 0.3;   ///< radius of the median sigma's circle, in distances between corners
constexpr int kShift = 4;         ///< OpenCV draws at 1/16 px
const cv::Scalar kInk(235, 235, 235), kPaper(32, 32, 32), kSigma(255, 70, 255), kId(90, 255, 255);

/// How the pictures of one camera are drawn.
struct Scale {
  int enlarged = 1;
  double spacing_px = kClear_px;  ///< of the corners, in the picture
  double sigma_gain = 0;          ///< picture px of a circle's radius for an image px of sigma; 0: no corners
  double median_sigma_px = 0;
};

/// The largest of 1, 2, 5, 10, ... (and 0.5, 0.2, ...) that is not above x.
double round_down(double x) {
  const double ten = std::pow(10, std::floor(std::log10(x)));
  return x >= 5 * ten ? 5 * ten : x >= 2 * ten ? 2 * ten : ten;
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Median over the corners of the distance to the nearest other one.
double spacing_of(const std::vector<Corner>& corners) {
  std::vector<double> nearest;
  for (const Corner& a : corners) {
    double least = 1e9;
    for (const Corner& b : corners)
      if (a.point != b.point) least = std::min(least, (a.px - b.px).norm());
    nearest.push_back(least);
  }
  return median(nearest);
}

Scale scale_of(const Dataset& data, int cam) {
  std::vector<double> spacings, sigmas;
  for (const View& view : data.views) {
    if (view.cam != cam || view.corners.size() < 2) continue;
    spacings.push_back(spacing_of(view.corners));
    for (const Corner& corner : view.corners) sigmas.push_back(corner.sigma_px);
  }
  if (spacings.empty()) return {};
  const double spacing = std::max(median(spacings), 1.0), width = data.cameras[cam].size.width;
  const int wanted = static_cast<int>(std::ceil(kClear_px / spacing));
  const int most = std::min(kMostEnlarged, static_cast<int>(kMostWidth / std::max(width, 1.0)));
  Scale scale;
  scale.enlarged = std::max(1, std::min(wanted, most));
  scale.spacing_px = scale.enlarged * spacing;
  scale.median_sigma_px = std::max(median(sigmas), 1e-6);
  scale.sigma_gain = round_down(kCircle * spacing / scale.median_sigma_px) * scale.enlarged;
  return scale;
}

cv::Scalar hue(double fraction) {
  cv::Mat hsv(1, 1, CV_8UC3, cv::Scalar(120 * fraction, 255, 255)), bgr;
  cv::cvtColor(hsv, bgr, cv::COLOR_HSV2BGR);
  const cv::Vec3b c = bgr.at<cv::Vec3b>(0, 0);
  return {double(c[0]), double(c[1]), double(c[2])};
}

int fixed(double value) { return static_cast<int>(std::lround(value * (1 << kShift))); }
cv::Point fixed_point(const Vec2& px) { return {fixed(px.x()), fixed(px.y())}; }

void draw_corners(cv::Mat& picture, const View& view, std::size_t n_points, const Scale& scale) {
  const int line = std::max(1, picture.cols / 1600);
  const double arm = std::clamp(0.12 * scale.spacing_px, 3.0, std::max(3.0, 0.01 * picture.cols)),
               digits = std::clamp(0.2 * scale.spacing_px, 8.0, std::max(10.0, 0.008 * picture.cols));
  const auto place = [&](const Corner& corner) -> Vec2 {
    return (corner.px.array() + 0.5).matrix() * scale.enlarged - Vec2(0.5, 0.5);
  };
  for (std::size_t i = 0; i < view.corners.size(); ++i) {
    const cv::Scalar colour =
        hue(double(view.corners[i].point) / double(std::max<std::size_t>(n_points - 1, 1)));
    const Vec2 px = place(view.corners[i]);
    if (i > 0) {
      cv::line(picture, fixed_point(place(view.corners[i - 1])), fixed_point(px), colour, line, cv::LINE_AA,
               kShift);
    }
    for (const Vec2& half : {Vec2(arm, arm), Vec2(arm, -arm)})
      cv::line(picture, fixed_point(px - half), fixed_point(px + half), colour, line, cv::LINE_AA, kShift);
    // A sigma that would hide the next corner is cut, and shown in red.
    const double radius = scale.sigma_gain * view.corners[i].sigma_px, most = 0.6 * scale.spacing_px;
    cv::circle(picture, fixed_point(px), fixed(std::min(radius, most)),
               radius > most ? colour_of(Outcome::kRejected) : kSigma, line, cv::LINE_AA, kShift);
  }
  for (const Corner& corner : view.corners) {
    const Vec2 px = place(corner) + Vec2(1.2 * arm, -1.2 * arm);
    draw_text(picture, fmt::format("{}", corner.point),
              {{static_cast<int>(px.x()), static_cast<int>(px.y())}, digits, kId, true});
  }
}

/// What stands below a picture: the image's name and what became of it; below that the circles' key.
cv::Mat with_legend(const cv::Mat& picture, const std::string& name, const std::vector<const View*>& views,
                    const Dataset& data, const Scale& scale) {
  const Outcome outcome = outcome_of(views, data);
  std::string text = name + ": " + text_of_outcome(views, data), key;
  const bool has_key = outcome == Outcome::kFound || outcome == Outcome::kPartial;
  const double shown_px = round_down(1.5 * std::max(scale.median_sigma_px, 1e-9));
  if (has_key) {
    key = fmt::format("circles: sigma x {:g} (median {:.3f} px); this one is {:g} px:",
                      scale.sigma_gain / scale.enlarged, scale.median_sigma_px, shown_px);
  }
  double height = std::max(12.0, picture.cols / 110.0);
  const int margin = static_cast<int>(height), radius = static_cast<int>(scale.sigma_gain * shown_px) + 2;
  const int room = picture.cols - 2 * margin, row = static_cast<int>(2 * height);
  const auto lines = wrap_text(text, height, room, 3);
  const int key_row = has_key ? std::max(row, 2 * radius + margin / 2) : 0;
  cv::Mat strip(static_cast<int>(lines.size()) * row + key_row + margin / 2, picture.cols, CV_8UC3, kPaper);
  int base = row - margin / 2;
  for (const std::string& line : lines) {
    draw_text(strip, line, {{margin, base}, height, colour_of(outcome)});
    base += row;
  }
  if (has_key) {
    const int middle = base - row + margin / 2 + key_row / 2;
    while (height > 6 && text_width(key, height) + 3 * margin + 2 * radius > room) height -= 1;
    draw_text(strip, key, {{margin, middle + static_cast<int>(height / 2)}, height, kInk});
    cv::circle(strip, fixed_point(Vec2(2 * margin + text_width(key, height) + radius, middle)),
               fixed(scale.sigma_gain * shown_px), kSigma, std::max(1, picture.cols / 1600), cv::LINE_AA,
               kShift);
  }
  cv::Mat all;
  cv::vconcat(picture, strip, all);
  return all;
}

/// An image of the run, with all that was looked for in it.
struct Job {
  std::size_t cam = 0, image = 0;
  fs::path picture;
};

cv::Mat drawn(const cv::Mat& image, const std::string& name, const std::vector<const View*>& views,
              const Dataset& data, const Scale& scale) {
  cv::Mat picture = image.clone();
  if (scale.enlarged > 1) cv::resize(image, picture, {}, scale.enlarged, scale.enlarged, cv::INTER_CUBIC);
  for (const View* view : views)
    draw_corners(picture, *view, data.targets[view->target].points.size(), scale);
  return with_legend(picture, name, views, data, scale);
}

}  // namespace

Status draw_detections(const std::vector<CameraImages>& images, const Dataset& data, const fs::path& folder,
                       const Common& common) {
  std::vector<Job> jobs;
  std::vector<fs::path> files;
  std::vector<Scale> scales;
  std::vector<std::vector<std::vector<const View*>>> views(images.size());
  for (std::size_t cam = 0; cam < images.size(); ++cam) {
    std::error_code error;
    fs::create_directories(folder / images[cam].camera, error);
    if (error) return Error{ErrorCode::kIo, error.message(), (folder / images[cam].camera).string()};
    std::map<std::string, std::vector<const View*>> by_name;
    for (const View& view : data.views) {
      if (view.cam == static_cast<int>(cam)) by_name[view.image].push_back(&view);
    }
    const std::vector<std::string> pictures = picture_names(images[cam]);
    for (std::size_t i = 0; i < images[cam].files.size(); ++i) {
      views[cam].push_back(by_name[images[cam].names[i]]);
      jobs.push_back({cam, i, folder / images[cam].camera / (pictures[i] + ".png")});
      files.push_back(images[cam].files[i]);
    }
    scales.push_back(scale_of(data, static_cast<int>(cam)));
  }
  ContactSheet sheet(folder, images, data, views);
  Progress progress("drawing", common);
  std::mutex lock;
  int n_done = 0;
  std::vector<Status> statuses(jobs.size());
  for_each_image(files, ReadAs::kStored, common.n_threads, [&](int i, const Result<Photograph>& photograph) {
    const Job& job = jobs[i];
    statuses[i] = [&]() -> Status {
      if (!photograph) return photograph.error();
      const cv::Mat image = in_colour(photograph->pixels);
      if (Status s = sheet.add(job.cam, job.image, image); !s) return s;
      return write_png(job.picture, drawn(image, images[job.cam].names[job.image], views[job.cam][job.image],
                                          data, scales[job.cam]));
    }();
    const std::lock_guard hold(lock);
    progress(++n_done, static_cast<int>(jobs.size()));
  });
  for (Status& status : statuses) {
    if (!status) return std::move(status);
  }
  return {};
}

}  // namespace plumbline::apps

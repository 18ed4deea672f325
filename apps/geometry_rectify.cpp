// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "geometry_views.hpp"
#include "plumbline/image/image.hpp"
#include "plumbline/rectify/uncalibrated.hpp"
#include "remap_images.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string points, size, output, image_1, image_2, folder;
  RobustOptions robust;
  bool least_disparity = false;
};

// Where each pixel of the rectified image looks in the original.
RemapMaps maps_of(const Mat3& H, ImageSize size) {
  RemapMaps maps{cv::Mat(size.height, size.width, CV_32FC1), cv::Mat(size.height, size.width, CV_32FC1), 0};
  const Mat3 back = H.inverse();
  for (int r = 0; r < size.height; ++r) {
    for (int c = 0; c < size.width; ++c) {
      const Vec3 q = back * Vec3(c, r, 1);
      const Vec2 px = q.z() > 0 ? Vec2(q.hnormalized()) : Vec2(-1, -1);
      maps.x.at<float>(r, c) = static_cast<float>(px.x());
      maps.y.at<float>(r, c) = static_cast<float>(px.y());
    }
  }
  return maps;
}

// FOLDER/1/STEM.png, FOLDER/2/STEM.png and FOLDER/pairs/STEM.png with lines along the epipolar lines.
Status write_images(const Options& o, const UncalibratedRectification& r, ImageSize size,
                    const Common& common) {
  std::vector<CameraImages> images;
  const std::string stem = std::filesystem::path(o.image_1).stem().string();
  for (const std::string& file : {o.image_1, o.image_2})
    images.push_back({images.empty() ? "1" : "2", {file}, {file}, {stem}});
  return write_folder(o.folder, common.force, [&](const std::filesystem::path& folder) -> Status {
    Progress progress("rectifying", common);
    for (int i = 0; i < 2; ++i) {
      if (Status s = remap_images(images[i], size, maps_of(r.H[i], size), folder, common, progress); !s)
        return s;
    }
    return write_pairs(images, folder, r.vertical, common);
  });
}

Result<ImageSize> size_of(const Options& o) {
  if (!o.size.empty()) return parse_size(o.size, "--size");
  auto image = read_image(o.image_1);
  if (!image) return image.error();
  return ImageSize{image->cols, image->rows};
}

Result<int> run(const Options& o, const Common& common) {
  if (o.image_1.empty() != o.folder.empty() || o.image_2.empty() != o.folder.empty())
    usage_error("--image1, --image2 and --folder belong together");
  if (o.size.empty() && o.folder.empty()) usage_error("--size WIDTHxHEIGHT is needed, or the images");
  if (Status s = check_answer(o.output, common); !s) return s.error();
  if (Status s = check_answer(o.folder, common); !s) return s.error();
  if (Status s = check_parent(o.output); !s) return s.error();
  auto known_size = size_of(o);
  if (!known_size) return known_size.error();
  const ImageSize size = *known_size;
  auto matches = load_matches(o.points);
  if (!matches) return matches.error();
  auto F = estimate_fundamental(*matches, o.robust, {}, common);
  if (!F) return in_file(F.error(), o.points);
  const auto px1 = chosen(matches->px1, F->inlier), px2 = chosen(matches->px2, F->inlier);
  auto r = rectify_uncalibrated(
      F->F, px1, px2, size, {o.least_disparity ? RowFreedom::kLeastDisparity : RowFreedom::kLeastDistortion});
  if (!r) return in_file(r.error(), o.points);
  const Json json{{"H1", json_of_matrix(r->H[0])},
                  {"H2", json_of_matrix(r->H[1])},
                  {"F", json_of_matrix(F->F)},
                  {"vertical", r->vertical},
                  {"row_rms_px", r->row_rms_px},
                  {"disparity_px", {r->min_disparity_px, r->max_disparity_px}},
                  {"distortion", {r->distortion[0], r->distortion[1]}},
                  {"inliers", px1.size()},
                  {"n", matches->px1.size()},
                  {"outliers", json_of_unset(F->inlier)}};
  std::string text =
      text_of_matrix("H1", r->H[0]) + text_of_matrix("H2", r->H[1]) +
      fmt::format(
          "{} match to {:.4f} px rms over {} of {} points; disparities from {:.1f} to {:.1f} px; local "
          "stretches {:.2f} % and {:.2f} % from 1\n",
          r->vertical ? "columns" : "rows", r->row_rms_px, px1.size(), matches->px1.size(),
          r->min_disparity_px, r->max_disparity_px, 100 * r->distortion[0], 100 * r->distortion[1]);
  if (!o.folder.empty()) {
    if (Status s = write_images(o, *r, size, common); !s) return s.error();
    text += fmt::format("written: {0}/1/, {0}/2/, {0}/pairs/\n", o.folder);
  }
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

}  // namespace

void add_geometry_rectify(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_points_option(app, o->points, "u1,v1,u2,v2");
  app.add_option("--size", o->size, "of both images, WIDTHxHEIGHT in pixels");
  app.add_option("--image1", o->image_1, "the first image, to be rectified");
  app.add_option("--image2", o->image_2, "the second image");
  app.add_option("--folder", o->folder, "a folder for the rectified images, and for both side by side");
  app.add_flag("--least-disparity", o->least_disparity,
               "fit the first image to the second along the rows (default: least distortion)");
  add_robust_options(app, o->robust, "distance from its epipolar line (Sampson)");
  add_answer_option(app, o->output);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include "calibrate_inputs.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <map>
#include <set>

#include "calibrate_effects.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/glob.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline::apps {
namespace {

// Adds one view of a corners.vnl to the data set, making its frame when the key is new.
void add_view(Dataset& data, std::map<std::string, int>& frame_of, int cam, const std::string& key,
              const VnlImage& image) {
  const auto [it, is_new] = frame_of.insert({key, static_cast<int>(data.frames.size())});
  if (is_new) data.frames.push_back(key);
  View view{cam, it->second, image.filename, image.corners, ""};
  if (image.corners.empty()) view.reason = "no corners in the corners file";
  data.views.push_back(std::move(view));
}

Result<Dataset> load_vnl(const CalibrateInputs& in) {
  if (in.targets.size() != 1 && (!in.targets.empty() || in.known_targets.size() != 1))
    usage_error("--corners with a .vnl file needs one --target");
  if (in.image_size.empty()) usage_error("--corners with a .vnl file needs --image-size WIDTHxHEIGHT");
  Dataset data;
  auto target = in.targets.empty() ? Result<Target>(in.known_targets[0]) : load_target(in.targets[0]);
  if (!target) return target.error();
  data.targets = {*std::move(target)};
  data.detector = "corners read from a .vnl file";
  auto images = load_vnl_file(in.corners);
  if (!images) return images.error();
  std::sort(images->begin(), images->end(),
            [](const VnlImage& a, const VnlImage& b) { return natural_less(a.filename, b.filename); });
  const std::vector<CamArg> cams =
      parse_cams(in.cams.empty() ? std::vector<std::string>{"camera=*"} : in.cams);
  std::map<std::string, int> frame_of;
  for (std::size_t cam = 0; cam < cams.size(); ++cam) {
    data.cameras.push_back({cams[cam].name, parse_size(in.image_size, "--image-size")});
    const int n_points = static_cast<int>(data.targets[0].points.size());
    int n_matched = 0;
    for (const VnlImage& image : *images) {
      auto key = glob_key(cams[cam].pattern, image.filename);
      if (!key) continue;
      if (image.n_rows != n_points && !(image.n_rows == 1 && image.corners.empty())) {
        return Error{
            ErrorCode::kInvalidData,
            fmt::format("{} rows, the target {} has {} points; every image needs a row for each, or a lone "
                        "'NAME - - -'",
                        image.n_rows, data.targets[0].name, n_points),
            in.corners + ": " + image.filename};
      }
      if (in.pair_by == "order") key = fmt::format("{}", n_matched);
      add_view(data, frame_of, static_cast<int>(cam), *key, image);
      ++n_matched;
    }
    if (n_matched == 0) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("no name in the file matches --cam {}={}; it holds {} images{}",
                               cams[cam].name, cams[cam].pattern, images->size(),
                               images->empty() ? "" : ", for example " + images->front().filename),
                   in.corners};
    }
  }
  if (Status s = validate(data); !s) return s.error();
  return data;
}

Result<Dataset> load_corners(const CalibrateInputs& in) {
  auto text = read_file(in.corners);
  if (!text) return text.error();
  if (text->find("plumbline_calibration:") != std::string::npos)
    return Error{
        ErrorCode::kInvalidData,
        fmt::format("the file is a calibration; give it without --corners to solve its corners again, or "
                    "as --start {} for its cameras",
                    in.corners),
        "--corners " + in.corners};
  const bool is_vnl =
      std::filesystem::path(in.corners).extension() == ".vnl" || trim(*text).substr(0, 1) == "#";
  if (is_vnl && text->find("plumbline_corners") == std::string::npos) return load_vnl(in);
  if (!in.cams.empty())
    usage_error("--cam goes with images or with a .vnl file; a corners.yaml names its cameras itself");
  if (!in.image_size.empty())
    usage_error("--image-size goes with a .vnl file; a corners.yaml has the size of its images");
  if (!in.pair_by.empty())
    usage_error("--pair-by goes with images or with a .vnl file; a corners.yaml has its frames");
  auto data = load_corners_yaml(in.corners);
  if (!data || in.targets.empty()) return data;
  auto targets = load_targets(in.targets);
  if (!targets) return targets.error();
  const auto same_spec = [](const Target& a, const Target& b) { return a.spec == b.spec; };
  if (std::equal(targets->begin(), targets->end(), data->targets.begin(), data->targets.end(), same_spec))
    return data;
  const auto names = [](const std::vector<Target>& list) {
    std::vector<std::string> all;
    for (const Target& target : list) all.push_back(target.name);
    return join(all, ", ");
  };
  return Error{
      ErrorCode::kInvalidData,
      fmt::format("the corners were taken of target {}, --target is {}; leave --target away, or detect again",
                  names(data->targets), names(*targets)),
      in.corners};
}

}  // namespace

void check_usage(const CalibrateInputs& in) {
  if (in.corners.empty() && (in.targets.empty() || in.cams.empty())) {
    usage_error("either --target and --cam, or --corners is needed");
  }
  if (in.corners.empty() && !in.image_size.empty())
    usage_error("--image-size goes with a .vnl file; images have their own size");
}

void add_input_options(CLI::App& app, CalibrateInputs& in) {
  add_target_option(app, in.targets);
  add_cam_option(app, in.cams);
  app.add_option("--pair-by", in.pair_by,
                 "match frames of several cameras by name (what the wildcards matched) or order")
      ->check(CLI::IsMember({"name", "order"}));
  add_every_option(app, in.every);
  add_thin_option(app, in.thin_px);
  app.add_option("--corners", in.corners, "corners.yaml of ours, or mrcal's corners.vnl, instead of images");
  app.add_option("--image-size", in.image_size, "WIDTHxHEIGHT, with a .vnl file");
  app.add_option("--times", in.times,
                 "when the images were taken: a CSV file of image,time_s, or 'names' for files named by "
                 "nanoseconds");
}

namespace {

Result<Dataset> load_without_times(const CalibrateInputs& in, const Common& common, Observed& observed) {
  if (!in.corners.empty()) return load_corners(in);
  auto targets =
      in.targets.empty() ? Result<std::vector<Target>>(in.known_targets) : load_targets(in.targets);
  if (!targets) return targets.error();
  auto images = find_images(in.cams, in.pair_by == "order", in.every, common);
  if (!images) return images.error();
  Progress progress("detecting", common);
  DetectOptions options;
  options.n_threads = common.n_threads;
  options.progress = [&](int done, int all) { progress(done, all); };
  options.thin_px = in.thin_px;
  observed.images = *images;
  options.note = [&](const std::string& note) { observed.notes.push_back(note); };
  return detect_dataset(*images, *targets, options);
}

}  // namespace

Result<Dataset> load_observations(const CalibrateInputs& in, const Common& common, Observed& observed) {
  auto data = load_without_times(in, common, observed);
  if (!data) return data;
  if (Status s = add_times(in.times, *data); !s) return s.error();
  return data;
}

Result<std::vector<std::string>> parse_lenses(const std::string& argument,
                                              const std::vector<CameraInfo>& cameras, bool has_start) {
  std::map<std::string, std::string> by_camera;
  std::string for_all;
  for (const std::string& piece : split(argument, ',')) {
    const std::size_t equals = piece.find('=');
    if (equals == std::string::npos)
      for_all = piece;
    else
      by_camera[piece.substr(0, equals)] = piece.substr(equals + 1);
  }
  std::vector<std::string> lenses;
  for (const CameraInfo& camera : cameras) {
    const auto it = by_camera.find(camera.name);
    const std::string lens = it != by_camera.end() ? it->second : for_all;
    if (it != by_camera.end()) by_camera.erase(it);
    if (lens.empty() && !has_start)
      usage_error(fmt::format("--lens {}: camera {} has no lens", argument, camera.name));
    if (const auto made = make_lens(lens, ImageSize{}, 1.0); !made && lens != "auto" && !lens.empty())
      usage_error("--lens: " + made.error().message);
    lenses.push_back(lens);
  }
  if (!by_camera.empty())
    usage_error(fmt::format("--lens {}: there is no camera {}", argument, by_camera.begin()->first));
  return lenses;
}

}  // namespace plumbline::apps

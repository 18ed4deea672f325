// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/detect.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"
#include "overlay.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/files.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string target, output, overlay;
  std::vector<std::string> cams;
  std::string pair_by = "name";
};

Json json_of_views(const Dataset& data) {
  Json views = Json::array();
  for (const View& view : data.views) {
    Json item{
        {"camera", data.cameras[view.cam].name}, {"image", view.image}, {"corners", view.corners.size()}};
    item["reason"] = view.reason.empty() ? Json(nullptr) : Json(view.reason);
    views.push_back(item);
  }
  return views;
}

Result<int> run(const Options& o, const Common& common) {
  const bool as_vnl = std::filesystem::path(o.output).extension() == ".vnl";
  const auto extension = std::filesystem::path(o.output).extension();
  if (!as_vnl && extension != ".yaml" && extension != ".yml") {
    usage_error(fmt::format("-o {}: corners are written as .yaml, or as .vnl for mrcal", o.output));
  }
  if (as_vnl && o.cams.size() != 1)
    usage_error("a .vnl file holds one camera; give one --cam, or -o corners.yaml");
  if (Status s = check_output(o.output, common); !s) return s.error();
  if (!o.overlay.empty()) {
    if (Status s = check_output(o.overlay, common); !s) return s.error();
  }
  auto target = load_target(o.target);
  if (!target) return target.error();
  auto images = find_images(o.cams, o.pair_by == "order");
  if (!images) return images.error();
  Progress progress("detecting", common);
  DetectOptions options;
  options.n_threads = common.n_threads;
  options.progress = [&](int done, int all) { progress(done, all); };
  auto data = detect_dataset(*images, *target, options);
  if (!data) return data.error();
  const std::string bytes = as_vnl ? format_vnl(*data, 0) : format_corners(*data);
  if (Status s = write_file(o.output, bytes, common.force); !s) return s.error();
  if (!o.overlay.empty()) {
    const Status drawn = write_folder(o.overlay, common.force, [&](const std::filesystem::path& folder) {
      return write_overlays(*images, *data, folder, common);
    });
    if (!drawn) return drawn.error();
  }

  Json json{{"target", data->target.name}, {"detector", data->detector}, {"views", json_of_views(*data)}};
  std::string text;
  for (std::size_t cam = 0; cam < data->cameras.size(); ++cam) {
    int n_found = 0, n_all = 0;
    std::size_t n_corners = 0;
    for (const View& view : data->views) {
      if (view.cam != static_cast<int>(cam)) continue;
      ++n_all;
      n_found += !view.corners.empty();
      n_corners += view.corners.size();
    }
    text += fmt::format("{}: board found in {} of {} images, {} corners\n", data->cameras[cam].name, n_found,
                        n_all, n_corners);
  }
  for (const View& view : data->views) {
    if (!view.reason.empty()) text += fmt::format("  {}: {}\n", view.image, view.reason);
  }
  text += fmt::format("{}\nwritten: {}\n", data->detector, o.output);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

}  // namespace

void add_detect(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("--target", o->target, "target file, ours or Kalibr's")->required();
  add_cam_option(app, o->cams)->required();
  app.add_option("--pair-by", o->pair_by,
                 "match frames of several cameras by name (what the wildcards matched) or order")
      ->check(CLI::IsMember({"name", "order"}));
  app.add_option("-o,--output", o->output, "corners.yaml, or corners.vnl for mrcal")->required();
  app.add_option("--overlay", o->overlay, "folder for the images with the corners drawn into them");
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

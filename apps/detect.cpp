// SPDX-License-Identifier: Apache-2.0
#include "plumbline/detect/detect.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"
#include "calibrate_look.hpp"
#include "draw.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/files.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string output, draw, calibration;
  std::vector<std::string> targets, cams;
  std::string pair_by = "name";
  int every = 15;
  std::optional<double> thin_px;
};

Json json_of_views(const Dataset& data) {
  Json views = Json::array();
  for (const View& view : data.views) {
    Json item{
        {"camera", data.cameras[view.cam].name}, {"image", view.image}, {"corners", view.corners.size()}};
    if (data.targets.size() > 1) item["target"] = data.targets[view.target].name;
    item["reason"] = view.reason.empty() ? Json(nullptr) : Json(view.reason);
    views.push_back(item);
  }
  return views;
}

std::string text_of_views(const Dataset& data) {
  std::string text;
  const bool several = data.targets.size() > 1;
  for (std::size_t cam = 0; cam < data.cameras.size(); ++cam) {
    for (std::size_t t = 0; t < data.targets.size(); ++t) {
      int n_found = 0, n_all = 0, n_thinned = 0;
      std::size_t n_corners = 0;
      for (const View& view : data.views) {
        if (view.cam != static_cast<int>(cam) || view.target != static_cast<int>(t)) continue;
        ++n_all;
        n_found += !view.corners.empty();
        n_thinned += is_near_duplicate(view);
        n_corners += view.corners.size();
      }
      text += fmt::format("{}: {} found in {} of {} images, {} corners{}\n", data.cameras[cam].name,
                          several ? data.targets[t].name : "board", n_found + n_thinned, n_all, n_corners,
                          n_thinned == 0 ? ""
                                         : fmt::format("; {} near-duplicate{} left out", n_thinned,
                                                       n_thinned == 1 ? "" : "s"));
    }
    for (const View& view : data.views) {
      if (view.cam != static_cast<int>(cam) || view.reason.empty()) continue;
      text += fmt::format("  {}{}: {}\n", view.image, several ? ", " + data.targets[view.target].name : "",
                          view.reason);
    }
  }
  return text;
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
  if (!o.draw.empty()) {
    if (Status s = check_output(o.draw, common); !s) return s.error();
  }
  if (as_vnl && o.targets.size() != 1)
    usage_error("a .vnl file holds one board; give one --target, or -o corners.yaml");
  auto targets = load_targets(o.targets);
  if (!targets) return targets.error();
  auto images = find_images(o.cams, o.pair_by == "order", o.every, common);
  if (!images) return images.error();
  Progress progress("detecting", common);
  DetectOptions options;
  options.n_threads = common.n_threads;
  options.progress = [&](int done, int all) { progress(done, all); };
  options.thin_px = o.thin_px;
  std::vector<std::string> notes;
  options.note = [&](const std::string& note) { notes.push_back(note); };
  auto data = detect_dataset(*images, *targets, options);
  if (!data) return data.error();
  std::optional<LookReport> look;
  if (!o.calibration.empty()) {
    auto report = look_with(o.calibration, *images, common, *data);
    if (!report) return report.error();
    look = *std::move(report);
  }
  const std::string bytes = as_vnl ? format_vnl(*data, 0) : format_corners(*data);
  if (Status s = write_file(o.output, bytes, common.force); !s) return s.error();
  if (!o.draw.empty()) {
    const Status drawn = write_folder(o.draw, common.force, [&](const std::filesystem::path& folder) {
      return draw_detections(*images, *data, folder, common);
    });
    if (!drawn) return drawn.error();
  }

  std::vector<std::string> names;
  for (const Target& target : data->targets) names.push_back(target.name);
  Json json{{"target", join(names, ", ")},
            {"detector", data->detector},
            {"notes", notes},
            {"views", json_of_views(*data)}};
  std::string text = text_of_notes(notes) + text_of_views(*data);
  if (look) {
    add_look(*look, *data, json);
    text += text_of_look(*look, *data);
  }
  text += fmt::format("{}\nwritten: {}\n", data->detector, o.output);
  if (!o.draw.empty()) text += fmt::format("drawn: {0}/CAMERA/, {0}/contact_sheet.png\n", o.draw);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

}  // namespace

void add_detect(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  add_target_option(app, o->targets)->required();
  add_cam_option(app, o->cams)->required();
  app.add_option("--pair-by", o->pair_by,
                 "match frames of several cameras by name (what the wildcards matched) or order")
      ->check(CLI::IsMember({"name", "order"}));
  app.add_option("-o,--output", o->output, "corners.yaml, or corners.vnl for mrcal")->required();
  add_every_option(app, o->every);
  add_thin_option(app, o->thin_px);
  app.add_option("--draw,--overlay", o->draw,
                 "folder for the images with ids, corners and sigmas drawn into them, and a contact sheet of "
                 "all images");
  app.add_option(
         "--calibration", o->calibration,
         "cameras that are known, in any known format: the images are searched again where they put corners "
         "that are missing, and centres of circles are freed of their bias")
      ->check(CLI::ExistingPath);
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

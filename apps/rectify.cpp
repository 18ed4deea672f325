// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/rectify.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <map>

#include "args.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/io/rectification_io.hpp"
#include "plumbline/rectify/remap.hpp"
#include "remap_images.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string output, size;
  std::vector<std::string> calibration, cams;
  std::string pair_by = "name";
  double alpha = 0;
  int every = 1;
  bool pairs = false;
};

// The board corners lie in calibration.yaml only; other camera files have none.
std::optional<double> vertical_rms(const Options& o, const StereoRectification& rectification) {
  const auto calibration = load_calibration(o.calibration.front());
  if (!calibration) return std::nullopt;
  return vertical_rms_px(rectification, *calibration);
}

Result<int> run(const Options& o, const Common& common) {
  if (o.cams.size() != 2) usage_error("rectify needs two --cam NAME=GLOB");
  if (Status s = check_output(o.output, common); !s) return s.error();
  auto rig = load_rig(o.calibration);
  if (!rig) return rig.error();
  auto images = find_images(o.cams, o.pair_by == "order", o.every, common);
  if (!images) return images.error();
  std::array<int, 2> cams{};
  for (std::size_t i = 0; i < 2; ++i) {
    auto cam = find_camera(*rig, (*images)[i].camera, o.calibration.front());
    if (!cam) return cam.error();
    cams[i] = *cam;
  }
  RectifyOptions options;
  options.alpha = o.alpha;
  if (!o.size.empty()) options.size = parse_size(o.size, "--size");
  auto rectification = rectify_stereo(*rig, cams[0], cams[1], options);
  if (!rectification) return rectification.error();

  std::array<RemapMaps, 2> maps;
  for (std::size_t i = 0; i < 2; ++i) {
    maps[i] =
        rectification_maps(*rectification, rig->cameras[cams[i]], static_cast<int>(i), common.n_threads);
  }
  const Status written =
      write_folder(o.output, common.force, [&](const std::filesystem::path& folder) -> Status {
        for (std::size_t i = 0; i < 2; ++i) {
          Progress progress("rectifying " + (*images)[i].camera, common);
          const Status s =
              remap_images((*images)[i], rig->cameras[cams[i]].size, maps[i], folder, common, progress);
          if (!s) return s;
        }
        if (o.pairs) {
          if (Status s = write_pairs(*images, folder, rectification->vertical, common); !s) return s;
        }
        return write_file(folder / "rectification.yaml", format_rectification(*rectification), true);
      });
  if (!written) return written.error();

  const std::optional<double> rms = vertical_rms(o, *rectification);
  const double valid = std::min(maps[0].valid_fraction, maps[1].valid_fraction),
               fx = rectification->P[0](0, 0);
  Json json{{"baseline_m", rectification->baseline_m},
            {"valid_fraction", valid},
            {"fx", fx},
            {"width", rectification->size.width},
            {"height", rectification->size.height},
            {"vertical", rectification->vertical}};
  json["vertical_rms_px"] = rms ? Json(*rms) : Json(nullptr);
  std::string text =
      fmt::format("rectified {}x{} px, f {:.4f} px, baseline {:.6f} m ({}), {:.2f} % of the pixels valid\n",
                  rectification->size.width, rectification->size.height, fx, rectification->baseline_m,
                  rectification->vertical ? "one above the other" : "side by side", 100 * valid);
  if (rms)
    text += fmt::format("the calibration's board corners across the epipolar lines: {:.4f} px rms\n", *rms);
  text += fmt::format("written: {0}/{1}/, {0}/{2}/, {0}/rectification.yaml\n", o.output, (*images)[0].camera,
                      (*images)[1].camera);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

}  // namespace

void add_rectify(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("calibration", o->calibration,
                 "calibration.yaml, or camera files of any known format, with extrinsics")
      ->required();
  add_cam_option(app, o->cams)->required();
  add_every_option(app, o->every);
  app.add_option("--pair-by", o->pair_by, "name or order")->check(CLI::IsMember({"name", "order"}));
  app.add_option("--alpha", o->alpha, "0: only valid pixels, 1: every source pixel (default: 0)")
      ->check(between(0.0, 1.0));
  app.add_option("--size", o->size, "WIDTHxHEIGHT of the rectified images (default: as the first camera's)");
  app.add_flag("--pairs", o->pairs,
               "write pairs/FRAME.png too: both pictures in one, with lines that show the rows match");
  app.add_option("-o,--output", o->output, "folder for CAMERA/STEM.png and rectification.yaml")->required();
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"
#include "plumbline/image/image.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/synth/scene.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string target, output, camera, size = "640x480";
  SceneOptions scene;
  double image_noise_grey = 2, blur_px = 0.6;
  bool no_images = false;
};

// One image per view, with what makes a photograph: blur, shading, noise, a background that is not plain.
Status write_images(const std::filesystem::path& folder, const Calibration& truth, const Options& o,
                    const Common& common) {
  const auto drawings = draw_target(truth.data.targets[0]);
  if (!drawings) return drawings.error();
  Progress progress("rendering", common);
  CameraRays rays;
  int done = 0, cam = -1;
  for (const View& view : truth.data.views) {
    if (view.cam != cam) {
      cam = view.cam;
      rays = camera_rays(truth.rig.cameras[cam].lens, truth.rig.cameras[cam].size, common.n_threads);
      std::filesystem::create_directories(folder / truth.rig.cameras[cam].name);
    }
    RenderOptions look;
    look.texture_grey = 25;
    look.vignetting = 0.2;
    look.blur_sigma_px = o.blur_px;
    look.noise_grey = o.image_noise_grey;
    look.seed = o.scene.seed * 1000003ULL + static_cast<std::uint64_t>(done);
    look.n_threads = common.n_threads;
    const cv::Mat image =
        render(*drawings, rays, truth.rig.T_cam_rig[cam] * *truth.T_rig_board[view.frame], look);
    if (Status s = write_png(folder / view.image, image); !s) return s;
    progress(++done, static_cast<int>(truth.data.views.size()));
  }
  return {};
}

Result<int> run(Options o, const Common& common) {
  if (Status s = check_output(o.output, common); !s) return s.error();
  auto target = load_target(o.target);
  if (!target) return target.error();
  o.scene.size = parse_size(o.size, "--size");
  o.scene.seed = static_cast<std::uint64_t>(common.seed);
  if (!o.camera.empty()) {
    auto rig = load_rig({o.camera});
    if (!rig) return rig.error();
    o.scene.exact_lens = rig->cameras.at(0).lens;
    o.scene.size = rig->cameras[0].size;
  }
  auto truth = simulate(*target, o.scene);
  if (!truth) return truth.error();
  truth->provenance.version = PLUMBLINE_VERSION;
  const bool images = !o.no_images && !std::holds_alternative<Points3d>(target->spec);
  const Status written =
      write_folder(o.output, common.force, [&](const std::filesystem::path& folder) -> Status {
        if (Status s = write_file(folder / "corners.yaml", format_corners(truth->data), true); !s) return s;
        if (Status s = write_file(folder / "truth.yaml", format_calibration(*truth), true); !s) return s;
        return images ? write_images(folder, *truth, o, common) : Status();
      });
  if (!written) return written.error();

  Json json{{"target", target->name},
            {"frames", truth->data.frames.size()},
            {"corners", truth->stats.n_corners},
            {"cameras", Json::array()}};
  std::string text = fmt::format("{}: {} frames, {} corners\n", target->name, truth->data.frames.size(),
                                 truth->stats.n_corners);
  for (const Camera& camera : truth->rig.cameras) {
    const auto k = params(camera.lens);
    json["cameras"].push_back({{"name", camera.name},
                               {"lens", lens_name(camera.lens)},
                               {"width", camera.size.width},
                               {"height", camera.size.height},
                               {"fx", k[0]}});
    text +=
        fmt::format("{}: {} {}x{}, fx {:.2f} fy {:.2f} cx {:.2f} cy {:.2f}\n", camera.name,
                    lens_name(camera.lens), camera.size.width, camera.size.height, k[0], k[1], k[2], k[3]);
  }
  text += fmt::format("written: {0}/corners.yaml, {0}/truth.yaml{1}\n", o.output,
                      images ? fmt::format(", {}/CAMERA/FRAME.png", o.output) : "");
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

}  // namespace

void add_simulate(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("--target", o->target, "target file, ours or Kalibr's")->required();
  app.add_option("--lens", o->scene.lens, "lens of all cameras (default: opencv5)");
  app.add_option("--camera", o->camera, "take lens and size from this camera file instead");
  app.add_option("--fov", o->scene.fov_deg, "horizontal field of view, degrees (default: 70)");
  app.add_option("--size", o->size, "WIDTHxHEIGHT of the images (default: 640x480)");
  app.add_option("--views", o->scene.n_views, "positions of the board (default: 20)");
  app.add_option("--noise", o->scene.noise_px, "of the corners in corners.yaml, px (default: 0.1)");
  app.add_option("--cams", o->scene.n_cameras, "cameras side by side (default: 1)");
  app.add_option("--baseline", o->scene.baseline_m, "between neighbouring cameras, metres (default: 0.1)");
  app.add_option("--image-noise", o->image_noise_grey, "of the images, grey levels (default: 2)")
      ->check(between(0.0, 100.0));
  app.add_option("--blur", o->blur_px, "of the images, sigma in px (default: 0.6)")
      ->check(between(0.0, 20.0));
  app.add_flag("--no-images", o->no_images, "corners.yaml and truth.yaml only");
  app.add_option("-o,--output", o->output, "folder for CAMERA/FRAME.png, corners.yaml and truth.yaml")
      ->required();
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

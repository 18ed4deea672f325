// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/rectify/rectify.hpp"
#include "remap_images.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string output, size;
  std::vector<std::string> calibration, cams;
  double alpha = 0;
  int every = 1;
};

Result<int> run(const Options& o, const Common& common) {
  if (Status s = check_output(o.output, common); !s) return s.error();
  auto rig = load_rig(o.calibration);
  if (!rig) return rig.error();
  auto images = find_images(o.cams, false, o.every, common);
  if (!images) return images.error();
  const ImageSize size = o.size.empty() ? ImageSize{} : parse_size(o.size, "--size");
  Json json{{"cameras", Json::array()}};
  std::string text;
  Rig undistorted;
  const Status written =
      write_folder(o.output, common.force, [&](const std::filesystem::path& folder) -> Status {
        for (const CameraImages& of_camera : *images) {
          auto cam = find_camera(*rig, of_camera.camera, o.calibration.front());
          if (!cam) return cam.error();
          const Camera& camera = rig->cameras[*cam];
          const ImageSize new_size = size.width > 0 ? size : camera.size;
          auto pinhole = undistorted_camera(camera, o.alpha, new_size);
          if (!pinhole) return pinhole.error();
          const RemapMaps maps =
              remap_maps(camera, Mat3::Identity(), camera_matrix_k(*pinhole), new_size, common.n_threads);
          Progress progress("undistorting " + of_camera.camera, common);
          if (Status s = remap_images(of_camera, camera.size, maps, folder, common, progress); !s) return s;
          undistorted.cameras.push_back({of_camera.camera, new_size, *pinhole});
          undistorted.T_cam_rig.push_back(rig->T_cam_rig[*cam]);
          json["cameras"].push_back({{"name", of_camera.camera},
                                     {"width", new_size.width},
                                     {"height", new_size.height},
                                     {"fx", pinhole->fx},
                                     {"fy", pinhole->fy},
                                     {"cx", pinhole->cx},
                                     {"cy", pinhole->cy},
                                     {"valid_fraction", maps.valid_fraction}});
          text += fmt::format(
              "{}: {}x{} px, fx {:.4f} fy {:.4f} cx {:.4f} cy {:.4f}, {:.2f} % of the pixels valid\n",
              of_camera.camera, new_size.width, new_size.height, pinhole->fx, pinhole->fy, pinhole->cx,
              pinhole->cy, 100 * maps.valid_fraction);
        }
        auto cameras = find_format("plumbline")->write(undistorted, {});
        if (!cameras) return cameras.error();
        return write_file(folder / "undistorted.yaml", cameras->front().bytes, true);
      });
  if (!written) return written.error();
  text += fmt::format("written: {0}/CAMERA/, {0}/undistorted.yaml (the pinhole cameras of the new images)\n",
                      o.output);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

}  // namespace

void add_undistort(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("calibration", o->calibration,
                 "calibration.yaml, or camera files of any known format or a folder of them")
      ->required();
  add_cam_option(app, o->cams)->required();
  add_every_option(app, o->every);
  app.add_option("--alpha", o->alpha, "0: only valid pixels, 1: every source pixel (default: 0)")
      ->check(between(0.0, 1.0));
  app.add_option("--size", o->size, "WIDTHxHEIGHT of the new images (default: as the camera's)");
  app.add_option("-o,--output", o->output, "folder for CAMERA/STEM.png")->required();
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

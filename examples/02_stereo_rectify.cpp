// SPDX-License-Identifier: Apache-2.0
// A stereo pair, from photographs to a rectified pair:  02_stereo_rectify out_folder n_pairs left... right...
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <plumbline/detect/detect.hpp>
#include <plumbline/image/image.hpp>
#include <plumbline/rectify/remap.hpp>
#include <plumbline/refine/refine.hpp>

using namespace plumbline;

namespace {

int fail(const Error& error) {
  std::fprintf(stderr, "%s\n", error.text().c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  const int n_pairs = argc > 2 ? std::atoi(argv[2]) : 0;
  if (n_pairs < 3 || argc != 3 + 2 * n_pairs) {
    std::fprintf(stderr, "usage: 02_stereo_rectify out_folder n_pairs left... right...\n");
    return 2;
  }
  const auto target = make_target(Chessboard{.columns = 9, .rows = 6, .square_m = 0.025});
  if (!target) return fail(target.error());

  // Equal frame keys tell that two images were taken at the same moment.
  std::vector<CameraImages> images{{.camera = "left"}, {.camera = "right"}};
  for (int i = 0; i < 2 * n_pairs; ++i) {
    auto& camera = images[i / n_pairs];
    const std::filesystem::path file = argv[3 + i];
    camera.files.push_back(file);
    camera.names.push_back(file.filename().string());
    camera.frames.push_back(std::to_string(i % n_pairs));
  }
  const auto data = detect_dataset(images, *target);
  if (!data) return fail(data.error());
  const auto calibration = calibrate(*data, {.lenses = {"opencv5"}});
  if (!calibration) return fail(calibration.error());

  const auto rectification = rectify_stereo(calibration->rig, 0, 1);
  if (!rectification) return fail(rectification.error());
  const auto error_px = vertical_rms_px(*rectification, *calibration);
  std::printf("RMS %.3f px, baseline %.4f m, vertical epipolar error %.3f px\n", calibration->stats.rms_px,
              rectification->baseline_m, error_px.value_or(-1));

  std::filesystem::create_directories(argv[1]);
  for (int which = 0; which < 2; ++which) {
    const Camera& camera = calibration->rig.cameras[which];
    const RemapMaps maps = rectification_maps(*rectification, camera, which);
    const auto image = read_image(images[which].files[0]);
    if (!image) return fail(image.error());
    const auto written =
        write_png(std::filesystem::path(argv[1]) / (camera.name + ".png"), remap_image(*image, maps));
    if (!written) return fail(written.error());
  }
  return 0;
}

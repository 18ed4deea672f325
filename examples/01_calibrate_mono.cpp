// SPDX-License-Identifier: Apache-2.0
// One camera from photographs of a chessboard:  01_calibrate_mono calibration.yaml image...
#include <cstdio>
#include <filesystem>
#include <plumbline/detect/detect.hpp>
#include <plumbline/io/calibration_io.hpp>
#include <plumbline/io/files.hpp>
#include <plumbline/refine/refine.hpp>

using namespace plumbline;

namespace {

int fail(const Error& error) {
  std::fprintf(stderr, "%s\n", error.text().c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: 01_calibrate_mono calibration.yaml image...\n");
    return 2;
  }
  // 9x6 inner corners, squares of 25 mm.
  const auto target = make_target(Chessboard{.columns = 9, .rows = 6, .square_m = 0.025});
  if (!target) return fail(target.error());

  CameraImages images{.camera = "camera"};
  for (int i = 2; i < argc; ++i) {
    const std::filesystem::path file = argv[i];
    images.files.push_back(file);
    images.names.push_back(file.filename().string());
    images.frames.push_back(file.stem().string());
  }
  const auto data = detect_dataset({images}, *target);
  if (!data) return fail(data.error());

  const auto calibration = calibrate(*data, {.lenses = {"opencv5"}});
  if (!calibration) return fail(calibration.error());

  std::printf("RMS %.3f px over %d corners\n", calibration->stats.rms_px, calibration->stats.n_corners);
  const Lens& lens = calibration->rig.cameras[0].lens;
  for (int i = 0; i < n_params(lens); ++i) {
    std::printf("%-3.3s %12.6f\n", param_names(lens)[i].data(), params(lens)[i]);
  }
  for (const auto& weak : calibration->stats.weak) std::printf("weak: %s\n", weak.consequence.c_str());

  const auto written = write_file(argv[1], format_calibration(*calibration), true);
  return written ? 0 : fail(written.error());
}

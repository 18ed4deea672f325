// SPDX-License-Identifier: Apache-2.0
// Writes the seeds: DIR/fuzz_<target>/seed<n>, in every shape that our own writers know.
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>

#include "io/example.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/io/reconstruction_io.hpp"
#include "plumbline/io/target_io.hpp"

namespace {
using namespace plumbline;

std::filesystem::path root;
std::map<std::string, int> n_seeds;

void seed(const std::string& target, const std::string& bytes) {
  const auto dir = root / ("fuzz_" + target);
  std::filesystem::create_directories(dir);
  const int n = n_seeds[target]++;
  std::ofstream(dir / ("seed" + std::to_string(n)), std::ios::binary) << bytes;
}

void seed_targets() {
  BoardRig rig;
  rig.parts = {{Charuco{}, SE3()}, {AprilGrid{}, SE3(so3_exp({0.1, 0.2, 0.3}), {1, 2, 3})}};
  for (const TargetSpec& spec :
       {TargetSpec(Chessboard{}), TargetSpec(Charuco{}), TargetSpec(AprilGrid{}), TargetSpec(Circles{}),
        TargetSpec(Points3d{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0.5}}}), TargetSpec(rig)}) {
    seed("target", format_target(make_target(spec, "a name").value()));
  }
  seed("target",
       "target_type: 'aprilgrid' # type\ntagCols: 6\ntagRows: 6\ntagSize: 0.088\ntagSpacing: 0.3\n");
  seed("target",
       "target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\ncolSpacingMeters: "
       "0.06\n");
  seed("target",
       "target_type: circlegrid\ntargetCols: 6\ntargetRows: 7\nspacingMeters: 0.02\nasymmetricGrid: true\n");
}

void seed_formats() {
  for (std::string_view lens : lens_names()) {
    for (int n = 1; n <= 3; ++n) {
      Rig rig;
      for (int i = 0; i < n; ++i) {
        rig.cameras.push_back(
            {"cam" + std::to_string(i), {640, 480}, make_lens(lens, {640, 480}, 500).value()});
        for (double& v : params(rig.cameras.back().lens).subspan(4)) v = 0.01;
        rig.T_cam_rig.push_back(i ? SE3(so3_exp({0.1, 0, 0}), {-0.1 * i, 0, 0}) : SE3());
      }
      for (const Format* format : formats()) {
        const auto files = format->write(rig, {});
        if (!files) continue;
        for (const NamedBytes& file : *files) {
          seed(std::string(format->name), file.bytes);
          seed("any", file.bytes);
        }
      }
    }
  }
}
void seed_reconstructions() {
  Reconstruction scene;
  for (const char* lens : {"opencv4", "kb4"})
    scene.cameras.push_back({lens, {640, 480}, make_lens(lens, {640, 480}, 500).value()});
  for (int v = 0; v < 3; ++v)
    scene.views.push_back({v % 2, "img.jpg", SE3(so3_exp({0.1 * v, 0, 0}), {0.1, 0.2, 3}), v + 1});
  for (int p = 0; p < 4; ++p) {
    scene.p_world.emplace_back(0.1 * p, 0.2, 0.3);
    for (int v = 0; v < 3; ++v) scene.sightings.push_back({v, p, {300.5 + p, 200.25}, 1});
  }
  std::string model;
  for (const NamedBytes& file : format_colmap_model(scene).value()) model += file.bytes + "===\n";
  seed("colmap_model", model);
  scene.cameras[1].lens = scene.cameras[0].lens;
  seed("bal", format_bal(scene).value());
}
}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: fuzz_seeds DIR\n";
    return 2;
  }
  root = argv[1];
  const Calibration calibration = test::example_calibration();
  seed_targets();
  seed("corners", format_corners(calibration.data));
  const std::string head =
      "plumbline_corners: 1\ntarget: {type: chessboard, corners: [3, 2], square_m: 0.025}\n"
      "cameras: [{name: left, width: 640, height: 480}]\nframes: [a]\nviews:\n  - camera: left\n    frame: "
      "a\n    "
      "image: a.png\n    corners: ";
  seed("corners", head + "[[0, 1.5, 2, 1], [5, 3e1, 4, 0.1]]\n");
  seed("corners", head + "|\n      0 1.5 2 1\n\n      5\t3e1 4 0.1\n      6 1e999 nan\n");
  seed("calibration", format_calibration(calibration));
  Calibration rig_only;
  rig_only.rig = calibration.rig;
  seed("calibration", format_calibration(rig_only));
  seed("vnl", format_vnl(calibration.data, 0));
  seed("vnl", "# filename x y weight\na 1 2 0.5\na - - -\nb 1e3 2 -\n");
  seed("points", "X,Y,Z,u,v\n0.5,1,2,3.25,-1\n-1,2e-3,3,4,5\n");
  seed("points", "# u v\n1 2\n- 3 # not seen\n");
  seed("points", "{columns: [u, v], rows: [[0.5, 1], [2, ~]]}\n");
  seed("points", "columns: [u, v]\nrows: |\n  1 2\n  3 4\n");
  seed("transform", "1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n");
  seed("transform", "{R: [[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]], t: [1, 2, 3]}\n");
  seed("transform", "quaternion_wxyz: [1, 0, 0, 0]\nrotation_rad: [0, 0, 0]\ntranslation_m: [1, 2, 3]\n");
  seed_formats();
  seed_reconstructions();
  return 0;
}

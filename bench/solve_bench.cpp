// SPDX-License-Identifier: Apache-2.0
// solve_bench TOOL LENS VIEWS CAMERAS [REPETITIONS] [THREADS]
// solve_bench write LENS VIEWS CAMERAS FILE: the corners as text, for tools in other languages
// (mrcal_procedure.py). One JSON line a run: time, cost, error against the truth, memory above the loaded
// problem. bench/solve/run calls it for a table of all tools.
#include <malloc.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include "solve/tools.hpp"

namespace {

using namespace bench;

std::optional<Outcome> run(const std::string& tool, SolveSet& set, int n_threads) {
  if (tool == "plumbline") return run_plumbline(set, n_threads);
  if (tool == "plumbline-procedure") return run_procedure(set, n_threads);
  if (tool == "plumbline-ceres") return run_our_ceres(set);
  if (tool == "ceres-autodiff") return run_autodiff(set, false);
  if (tool == "ceres-autodiff-tight") return run_autodiff(set, true);
  if (tool == "opencv") return run_opencv(set, false);
  if (tool == "opencv-lu") return run_opencv(set, true);
  if (tool == "mrcal") return run_mrcal(set);
  return std::nullopt;
}

// A line of /proc/self/status in MB.
double memory_mb(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(key + ":", 0) == 0) return std::strtod(line.c_str() + key.size() + 1, nullptr) / 1024;
  }
  return 0;
}

// One line for each view, "camera frame" and the pixels of its corners in the board's order.
bool write_corners(const SolveSet& set, const char* path) {
  std::FILE* file = std::fopen(path, "w");
  if (!file) return false;
  for (const auto& view : set.start.data.views) {
    std::fprintf(file, "%d %d", view.cam, view.frame);
    for (const auto& c : view.corners) std::fprintf(file, " %.17g %.17g", c.px.x(), c.px.y());
    std::fputc('\n', file);
  }
  return std::fclose(file) == 0;
}

// Forgets the peak so far.
void reset_peak() {
  malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << "5";
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fputs("solve_bench TOOL LENS VIEWS CAMERAS [REPETITIONS] [THREADS]\n", stderr);
    return 2;
  }
  const std::string tool = argv[1], lens = argv[2];
  const int n_views = std::atoi(argv[3]), n_cams = std::atoi(argv[4]);
  const int repetitions = argc > 5 ? std::atoi(argv[5]) : 1, n_threads = argc > 6 ? std::atoi(argv[6]) : 1;
  const SolveSet set = make_set(lens, n_views, n_cams);
  if (tool == "write") return argc > 5 && write_corners(set, argv[5]) ? 0 : 1;
  for (int i = 0; i < repetitions; ++i) {
    SolveSet mine = set;
    reset_peak();
    const double base_mb = memory_mb("VmRSS");
    const auto outcome = run(tool, mine, n_threads);
    const double peak_mb = memory_mb("VmHWM");
    if (!outcome) {
      std::printf("{\"tool\": \"%s\", \"failed\": true}\n", tool.c_str());
      continue;
    }
    std::printf(
        "{\"tool\": \"%s\", \"lens\": \"%s\", \"views\": %d, \"cams\": %d, \"threads\": %d, \"cpu_ms\": "
        "%.4f, "
        "\"wall_ms\": %.4f, \"rms_xy_px\": %.9f, \"iterations\": %d, \"error_px\": %.5f, \"mb\": %.1f}\n",
        tool.c_str(), lens.c_str(), n_views, n_cams, n_threads, 1e3 * outcome->seconds, 1e3 * outcome->wall_s,
        outcome->rms_xy_px, outcome->iterations, lens_error_px(outcome->rig, set.truth), peak_mb - base_mb);
    std::fflush(stdout);
  }
  return 0;
}

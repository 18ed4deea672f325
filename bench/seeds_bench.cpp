// SPDX-License-Identifier: Apache-2.0
// seeds_bench FOV NOISE VIEWS LENS TRIALS [THREADS] [FOLDER]
// How often calibrate() reaches, from corners alone, the optimum that a solve from the truth reaches: cost at
// most 1e-6 above it. Beside it OpenCV on the same corners. One JSON line; with FOLDER the trials are written
// as text (true focal length and cost; frame, point, u, v), for other tools.
#include <cfloat>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <opencv2/calib3d.hpp>

#include "plumbline/core/parallel.hpp"
#include "plumbline/refine/refine.hpp"
#include "seeds/trials.hpp"

namespace {

using namespace bench;
using namespace plumbline;

struct Tally {
  int reached = 0, elsewhere = 0, refused = 0, not_finite = 0, threw = 0;
};

enum class Ending { kReached, kElsewhere, kRefused, kNotFinite, kThrew };

// Sum of squares by the calibration's own predict(), and not what the solver says.
double cost_of(const Calibration& cal) {
  double sum = 0;
  for (const View& view : cal.data.views) {
    for (const Corner& c : view.corners) {
      const auto px = predict(cal, view, c.point);
      sum += px ? (*px - c.px).squaredNorm() : INFINITY;
    }
  }
  return sum;
}

RefineOptions options_of(const TrialKind& kind) {
  RefineOptions options;
  options.lenses = {kind.lens};
  options.mark_outliers = false;
  options.max_iterations = 500;
  options.n_threads = 1;
  return options;
}

Ending ours(const TrialKind& kind, const Calibration& truth, double best, std::string& reason) {
  const auto cal = calibrate(truth.data, options_of(kind));
  if (!cal) {
    reason = cal.error().text();
    return Ending::kRefused;
  }
  const double cost = cost_of(*cal);
  if (!std::isfinite(cost)) return Ending::kNotFinite;
  if (cost <= best * (1 + 1e-6)) return Ending::kReached;
  char text[80];
  std::snprintf(text, sizeof text, "cost %.6g times the optimum's", cost / best);
  reason = text;
  return Ending::kElsewhere;
}

// OpenCV's answer holds float32 corners: within 1e-4 of the cost counts as reached.
Ending opencv(const TrialKind& kind, const Calibration& truth, double best) {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> px;
  std::vector<std::vector<cv::Point3d>> board_d;
  std::vector<std::vector<cv::Point2d>> px_d;
  std::size_t n = 0;
  for (const View& view : truth.data.views) {
    board.emplace_back(), px.emplace_back(), board_d.emplace_back(), px_d.emplace_back();
    for (const Corner& c : view.corners) {
      const Vec3& p = truth.data.targets[0].points[c.point];
      board_d.back().emplace_back(p.x(), p.y(), 0);
      px_d.back().emplace_back(c.px.x(), c.px.y());
      board.back().emplace_back(board_d.back().back());
      px.back().emplace_back(px_d.back().back());
      ++n;
    }
  }
  cv::Mat K, D;
  std::vector<cv::Mat> r, t;
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 300, DBL_EPSILON);
  try {
    const double rms =
        kind.lens == "kb4"
            ? cv::fisheye::calibrate(board_d, px_d, {1280, 960}, K, D, r, t,
                                     cv::fisheye::CALIB_RECOMPUTE_EXTRINSIC | cv::fisheye::CALIB_FIX_SKEW,
                                     criteria)
            : cv::calibrateCamera(board, px, {1280, 960}, K, D, r, t, cv::CALIB_USE_LU, criteria);
    if (!std::isfinite(rms)) return Ending::kNotFinite;
    return rms * rms * static_cast<double>(n) <= best * (1 + 1e-4) ? Ending::kReached : Ending::kElsewhere;
  } catch (const cv::Exception&) {
    return Ending::kThrew;
  }
}

void count(Tally& tally, Ending ending) {
  int* const counts[] = {&tally.reached, &tally.elsewhere, &tally.refused, &tally.not_finite, &tally.threw};
  ++*counts[static_cast<int>(ending)];
}

void write_trial(const std::string& path, const Calibration& truth, double best) {
  std::ofstream out(path);
  out.precision(17);
  out << params(truth.rig.cameras[0].lens)[0] << ' ' << best << '\n';
  for (const View& view : truth.data.views) {
    for (const Corner& c : view.corners)
      out << view.frame << ' ' << c.point << ' ' << c.px.x() << ' ' << c.px.y() << '\n';
  }
}

void print(const char* name, const Tally& t) {
  std::printf(
      "\"%s\": {\"reached\": %d, \"elsewhere\": %d, \"refused\": %d, \"not_finite\": %d, \"threw\": %d}",
      name, t.reached, t.elsewhere, t.refused, t.not_finite, t.threw);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 6) {
    std::fputs("seeds_bench FOV NOISE VIEWS LENS TRIALS [THREADS] [FOLDER]\n", stderr);
    return 2;
  }
  const TrialKind kind{std::atof(argv[1]), std::atof(argv[2]), std::atoi(argv[3]), argv[4]};
  const int n_trials = std::atoi(argv[5]), n_threads = argc > 6 ? std::atoi(argv[6]) : 0;
  cv::setNumThreads(1);
  std::vector<Ending> our_endings(static_cast<std::size_t>(n_trials)), cv_endings(our_endings);
  std::vector<std::string> reasons(our_endings.size());
  parallel_for(n_trials, n_threads, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    const Calibration truth = make_trial(kind, static_cast<std::uint64_t>(i + 1));
    const auto from_truth = refine(truth, options_of(kind));
    const double best = from_truth ? cost_of(*from_truth) : cost_of(truth);
    try {
      our_endings[at] = ours(kind, truth, best, reasons[at]);
    } catch (const std::exception& e) {
      our_endings[at] = Ending::kThrew;
      reasons[at] = e.what();
    }
    cv_endings[at] = opencv(kind, truth, best);
    if (argc > 7) write_trial(std::string(argv[7]) + "/" + std::to_string(i) + ".txt", truth, best);
  });
  Tally us, cv_tally;
  for (std::size_t i = 0; i < our_endings.size(); ++i) {
    count(us, our_endings[i]);
    count(cv_tally, cv_endings[i]);
    if (!reasons[i].empty()) std::fprintf(stderr, "trial %zu: %s\n", i + 1, reasons[i].c_str());
  }
  std::printf("{\"fov\": %g, \"noise\": %g, \"views\": %d, \"lens\": \"%s\", \"trials\": %d, ", kind.fov_deg,
              kind.noise_px, kind.n_views, kind.lens.c_str(), n_trials);
  print("plumbline", us);
  std::printf(", ");
  print("opencv", cv_tally);
  std::printf("}\n");
  return 0;
}

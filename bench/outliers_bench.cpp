// SPDX-License-Identifier: Apache-2.0
// What 5 % of wrong corners do to a calibration: ours, mrcal's with its outlier rejection (started at the
// truth), OpenCV's. Not a benchmark of time:  outliers_bench [SEEDS [FIRST [PEER_SEEDS]]]  prints a table in
// Markdown. Each figure is the RMS over the seeds of the projection error against the truth, near the corners
// / over the whole image, with the wrong corners divided by without them, on the same noise.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <numeric>

#include "outliers/outliers.hpp"
#include "plumbline/core/parallel.hpp"
#include "plumbline/refine/refine.hpp"

namespace {

using namespace plumbline;
using namespace plumbline::bench;

constexpr std::array kFaults{Fault::kNone, Fault::kUniform, Fault::kNear, Fault::kSwapped, Fault::kShifted};

struct Outcome {
  std::array<std::optional<ErrorPx>, kFaults.size()> ours, mrcal, opencv;
  std::array<int, kFaults.size()> good_lost{}, bad_kept{};
};

// A view whose rows are counted from one too far is right but for the row that came round.
bool is_wrong(Fault fault, const Corner& corner, const Corner& clean) {
  return corner.px != clean.px && (fault != Fault::kShifted || corner.point < 11);
}

void count_marks(Outcome& outcome, std::size_t f, const Calibration& cal, const Dataset& clean) {
  for (std::size_t v = 0; v < clean.views.size(); ++v) {
    for (std::size_t i = 0; i < clean.views[v].corners.size(); ++i) {
      const bool wrong = is_wrong(kFaults[f], cal.data.views[v].corners[i], clean.views[v].corners[i]);
      const bool kept = !cal.fits[v].empty() && !cal.fits[v][i].outlier;
      outcome.good_lost[f] += !wrong && !kept;
      outcome.bad_kept[f] += wrong && kept;
    }
  }
}

Outcome trial(const Kind& kind, std::uint64_t seed, bool with_peers) {
  const Calibration truth = make_truth(kind, seed);
  Outcome outcome;
  for (std::size_t f = 0; f < kFaults.size(); ++f) {
    const Dataset data = with_fault(truth.data, kFaults[f], seed);
    RefineOptions options;
    options.lenses = {kind.lens};
    options.n_threads = 1;
    if (const auto cal = calibrate(data, options)) {
      outcome.ours[f] = error_px(truth, cal->rig.cameras[0]);
      count_marks(outcome, f, *cal, truth.data);
      for (const std::string& reason : cal->view_reason) {
        if (!reason.empty())
          fmt::print(stderr, "{} {} seed {} {}: {}\n", kind.lens, kind.fov_deg, seed, name_of(kFaults[f]),
                     reason);
      }
    } else {
      fmt::print(stderr, "{} {} seed {} {}: {}\n", kind.lens, kind.fov_deg, seed, name_of(kFaults[f]),
                 cal.error().text());
    }
    if (!with_peers) continue;
    if (const auto other = by_mrcal(truth, data)) outcome.mrcal[f] = error_px(truth, *other);
    if (const auto other = by_opencv(data, kind)) outcome.opencv[f] = error_px(truth, *other);
  }
  return outcome;
}

// With fault f over without, among the seeds that have both, near the corners / over the whole image; and how
// many seeds do not.
std::string ratio(const std::vector<Outcome>& all, std::size_t f, const auto& member) {
  ErrorPx with, without;
  int n = 0, n_failed = 0;
  for (const Outcome& o : all) {
    const auto &a = (o.*member)[f], &b = (o.*member)[0];
    if (!b) continue;
    if (!a) {
      ++n_failed;
      continue;
    }
    with.near += a->near * a->near, with.whole += a->whole * a->whole;
    without.near += b->near * b->near, without.whole += b->whole * b->whole;
    ++n;
  }
  if (n == 0) return "-";
  std::string text = fmt::format("{:.3f} / {:.3f}", std::sqrt(with.near / without.near),
                                 std::sqrt(with.whole / without.whole));
  if (n_failed > 0) text += fmt::format(" ({} failed)", n_failed);
  return text;
}

std::string rms(const std::vector<Outcome>& all, const auto& member) {
  ErrorPx sum;
  int n = 0;
  for (const Outcome& o : all) {
    if (const auto& e = (o.*member)[0]) sum.near += e->near * e->near, sum.whole += e->whole * e->whole, ++n;
  }
  return n == 0 ? "-" : fmt::format("{:.3f} / {:.3f}", std::sqrt(sum.near / n), std::sqrt(sum.whole / n));
}

}  // namespace

int main(int argc, char** argv) {
  const int n_seeds = argc > 1 ? std::atoi(argv[1]) : 100, first = argc > 2 ? std::atoi(argv[2]) : 1,
            n_peers = argc > 3 ? std::atoi(argv[3]) : n_seeds;
  fmt::print(
      "| lens, field of view | wrong corners | Plumbline | good corners lost, wrong ones kept | mrcal | "
      "OpenCV |\n|---|---|---|---|---|---|\n");
  for (const Kind& kind :
       {Kind{"opencv5", 60}, Kind{"opencv8", 90}, Kind{"kb4", 100}, Kind{"kb4", 140}, Kind{"kb4", 180}}) {
    std::vector<Outcome> all(static_cast<std::size_t>(n_seeds));
    parallel_for(n_seeds, 0, [&](int i) {
      all[static_cast<std::size_t>(i)] = trial(kind, static_cast<std::uint64_t>(first + i), i < n_peers);
    });
    fmt::print("| {}, {} deg | none: error [px] | {} | {}, 0 | {} | {} |\n", kind.lens, kind.fov_deg,
               rms(all, &Outcome::ours),
               std::accumulate(all.begin(), all.end(), 0,
                               [](int n, const Outcome& o) { return n + o.good_lost[0]; }),
               rms(all, &Outcome::mrcal), rms(all, &Outcome::opencv));
    for (std::size_t f = 1; f < kFaults.size(); ++f) {
      int lost = 0, kept = 0;
      for (const Outcome& o : all) lost += o.good_lost[f], kept += o.bad_kept[f];
      fmt::print("| | {} | {} | {}, {} | {} | {} |\n", name_of(kFaults[f]), ratio(all, f, &Outcome::ours),
                 lost, kept, ratio(all, f, &Outcome::mrcal), ratio(all, f, &Outcome::opencv));
    }
    std::fflush(stdout);
  }
  return 0;
}

// SPDX-License-Identifier: Apache-2.0
// Plumbline's detectors beside their peers, on rendered boards whose truth is known, on images without a
// board and on photographs.  detect_bench [quick|short|full [PART_OF_A_NAME [alone]]] prints one JSON line
// for each set and tool; bench/detect/run makes docs/detect.md's tables of them. Not a Google benchmark:
// recall and error matter as much as time.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <opencv2/core.hpp>
#include <set>

#include "detect/data_sets.hpp"
#include "detect/shots.hpp"
#include "detect/tools.hpp"
#include "plumbline/image/image.hpp"

namespace {

using namespace plumbline;
using namespace plumbline::bench;

constexpr double kWrongPx = 3;  ///< farther than this from the point of its id: a wrong corner

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

double median(std::vector<double> v) {
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

struct Score {
  int images = 0, found = 0, whole = 0;
  std::size_t visible = 0, right = 0, wrong = 0;
  std::vector<double> ms;
  double square = 0, n_axes = 0;  ///< of the right corners
  Vec2 sum = Vec2::Zero();
  double ratio_square = 0;  ///< (error / sigma)^2 over both axes
};

/// The tool's numbering, or one that turns the board by half (quarter) turns where the tool cannot know
/// better.
std::vector<std::vector<Corner>> numberings(const std::vector<Corner>& corners, const Target& target,
                                            bool is_peer) {
  std::vector<std::vector<Corner>> out{corners};
  const auto* board = std::get_if<Chessboard>(&target.spec);
  if (board == nullptr || corners.size() != target.points.size()) return out;
  const int w = board->columns, h = board->rows;
  if (is_peer || is_half_turn_symmetric(target.spec)) {
    out.push_back(corners);
    for (Corner& c : out.back()) c.point = w * h - 1 - c.point;
  }
  if (w == h) {
    const std::size_t n = out.size();
    for (std::size_t i = 0; i < n; ++i) {
      out.push_back(out[i]);
      for (Corner& c : out.back()) c.point = (c.point % w) * w + (w - 1 - c.point / w);
    }
    // mrgingham and others may mirror a square board as well.
    for (std::size_t i = 0; is_peer && i < 2 * n; ++i) {
      out.push_back(out[i]);
      for (Corner& c : out.back()) c.point = (c.point % w) * w + c.point / w;
    }
  }
  return out;
}

std::pair<std::size_t, std::size_t> count(const std::vector<Corner>& corners,
                                          const std::vector<std::optional<Vec2>>& truth) {
  std::set<int> right;
  std::size_t wrong = 0;
  for (const Corner& c : corners) {
    const bool is_known = c.point >= 0 && c.point < static_cast<int>(truth.size());
    const auto at = is_known ? truth[static_cast<std::size_t>(c.point)] : std::nullopt;
    if (at && (c.px - *at).norm() < kWrongPx)
      right.insert(c.point);
    else
      ++wrong;
  }
  return {right.size(), wrong};
}

void add(Score& score, const Answer& answer, const Shot& shot, const Target& target, bool is_peer) {
  std::vector<std::optional<Vec2>> truth(target.points.size());
  for (const Corner& c : shot.truth) truth[static_cast<std::size_t>(c.point)] = c.px;
  const auto is_rim = [&](const Corner& found) {
    return std::any_of(shot.rim.begin(), shot.rim.end(), [&](const Corner& c) {
      return c.point == found.point && (c.px - found.px).norm() < kWrongPx;
    });
  };
  std::vector<Corner> best;
  std::pair<std::size_t, std::size_t> n{0, 0};
  for (auto corners : numberings(answer.corners, target, is_peer)) {
    std::erase_if(corners, is_rim);
    const auto m = count(corners, truth);
    if (best.empty() || m.first > n.first) best = corners, n = m;
  }
  ++score.images;
  score.visible += shot.truth.size();
  score.right += n.first;
  score.wrong += n.second;
  score.found += best.empty() ? 0 : 1;
  score.whole += !shot.truth.empty() && n.first == shot.truth.size() ? 1 : 0;
  for (const Corner& c : best) {
    if (c.point < 0 || c.point >= static_cast<int>(truth.size())) continue;
    const auto at = truth[static_cast<std::size_t>(c.point)];
    if (!at || (c.px - *at).norm() >= kWrongPx) continue;
    const Vec2 e = c.px - *at;
    score.square += e.squaredNorm();
    score.sum += e;
    score.n_axes += 2;
    if (c.sigma_px > 0) score.ratio_square += (e / c.sigma_px).squaredNorm();
  }
}

void print(const std::string& table, const std::string& set, const std::string& kind, const std::string& tool,
           const Score& s) {
  const double n = std::max(1.0, s.n_axes);
  fmt::print(
      "{{\"table\": \"{}\", \"set\": \"{}\", \"kind\": \"{}\", \"tool\": \"{}\", \"images\": {}, \"found\": "
      "{}, "
      "\"whole\": {}, \"visible\": {}, \"right\": {}, \"wrong\": {}, \"rms_px\": {:.5f}, \"bias_px\": "
      "[{:.5f}, "
      "{:.5f}], \"sigma_ratio\": {:.4f}, \"ms\": {:.3f}, \"ms_max\": {:.3f}}}\n",
      table, set, kind, tool, s.images, s.found, s.whole, s.visible, s.right, s.wrong,
      std::sqrt(s.square / n), 2 * s.sum.x() / n, 2 * s.sum.y() / n, std::sqrt(s.ratio_square / n),
      median(s.ms), s.ms.empty() ? 0 : *std::max_element(s.ms.begin(), s.ms.end()));
  std::fflush(stdout);
}

Answer timed(const Tool& tool, const cv::Mat& grey, Score& score) {
  const double start = cpu_ms();
  Answer answer = tool.run(grey);
  // A program that was run counts by its own time, not by what it takes to write its image.
  score.ms.push_back(answer.child_ms > 0 ? answer.child_ms : cpu_ms() - start);
  return answer;
}

bool g_peers = true;

void measure(const std::string& table, const Subject& subject, const std::string& kind,
             const std::vector<Shot>& shots) {
  if (shots.empty()) return;
  const Target target = *make_target(subject.spec);
  for (const Tool& tool : tools_for(target, g_peers)) {
    Score score;
    for (const Shot& shot : shots)
      add(score, timed(tool, shot.grey, score), shot, target, tool.name != "Plumbline");
    print(table, subject.name, kind, tool.name, score);
  }
}

/// Boards of which two kinds of render tell enough: the square one is there for mrgingham, which knows no
/// other, and the tags of 25h9 differ in their modules alone.
bool is_brief(const Subject& subject) {
  const auto* board = std::get_if<Chessboard>(&subject.spec);
  const auto* grid = std::get_if<AprilGrid>(&subject.spec);
  return (board != nullptr && board->columns == board->rows) || (grid != nullptr && grid->family == "25h9");
}

void measure_renders(bool is_quick, bool is_short, const std::string& only) {
  for (const Subject& subject : subjects()) {
    std::uint64_t seed = 1;
    for (const Kind& kind : kinds()) {
      seed += 1000;
      const bool is_large = kind.size.width > 3000;
      if (is_brief(subject) && kind.name != "clean" && kind.name != "blurred and noisy") continue;
      if ((is_quick && is_large) ||
          ("render " + subject.name + " " + kind.name).find(only) == std::string::npos)
        continue;
      const int n = is_quick || is_short ? 1 : is_large ? 1 : kind.name == "clean" ? 5 : 3;
      measure("render", subject, kind.name, shots(subject, kind, n, seed, is_quick));
    }
    for (const std::string& kind : empty_kinds()) {
      seed += 1000;
      if (is_brief(subject) || ("empty " + subject.name + " " + kind).find(only) == std::string::npos)
        continue;
      measure("empty", subject, kind,
              empty_shots(subject, kind, is_quick || is_short || kind == "noise" ? 1 : 2, seed, is_quick));
    }
  }
}

/// At most `n` images of a set, evenly spread.
void measure_photographs(const std::string& folder, std::size_t n, const std::string& only) {
  for (const test::DataSet& set : test::data_sets()) {
    const std::filesystem::path at = std::filesystem::path(folder) / set.folder;
    if (!std::filesystem::is_directory(at) || ("photographs " + set.folder).find(only) == std::string::npos)
      continue;
    const auto files = test::images_of(at, set.pattern);
    const Target target = *make_target(set.spec);
    std::vector<cv::Mat> images;
    for (std::size_t i = 0; i < std::min(n, files.size()); ++i) {
      const auto grey = read_image_grey(files[i * files.size() / std::min(n, files.size())]);
      if (grey) images.push_back(*grey);
    }
    for (const Tool& tool : tools_for(target, g_peers)) {
      Score score;
      for (const cv::Mat& grey : images) {
        const std::size_t found = timed(tool, grey, score).corners.size();
        ++score.images;
        score.found += found > 0 ? 1 : 0;
        score.visible += target.points.size();
        score.right += found;
        score.whole += found == target.points.size() ? 1 : 0;
      }
      print("photographs", set.folder, target.name, tool.name, score);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool is_quick = argc > 1 && std::strcmp(argv[1], "quick") == 0;
  const std::string only = argc > 2 ? argv[2] : "";
  g_peers = argc <= 3;
  cv::setNumThreads(1);
  const bool is_short = argc > 1 && std::strcmp(argv[1], "short") == 0;
  measure_renders(is_quick, is_short, only);
  const char* data = std::getenv("PLUMBLINE_DATA");
  if (data != nullptr && *data != '\0')
    measure_photographs(data, is_quick || is_short ? 1 : g_peers ? 5 : 1000, only);
  return 0;
}

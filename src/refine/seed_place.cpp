// SPDX-License-Identifier: Apache-2.0
#include "refine/seed_place.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "plumbline/core/linalg.hpp"

namespace plumbline::detail {
namespace {

constexpr std::size_t kMaxHypotheses = 40;

double cap_px(const Camera& camera) { return 0.05 * std::hypot(camera.size.width, camera.size.height); }

int target_of(const Calibration& cal, const Link& link) { return cal.data.views[link.view].target; }

// The numbering of each view that agrees best with X; another than the present one must be clearly better.
Placement judge(const Calibration& cal, const std::vector<Link>& links, const SE3& X, const Symmetries& all) {
  Placement placement{X, {}, {}, 0};
  for (const Link& link : links) {
    const std::vector<Symmetry>& symmetries = all[target_of(cal, link)];
    double best = error_px(cal, link, X, symmetries[0]);
    int chosen = 0;
    for (std::size_t g = 1; g < symmetries.size(); ++g) {
      const double e = error_px(cal, link, X, symmetries[g]);
      if (e >= 0.8 * best) continue;
      best = e;
      chosen = static_cast<int>(g);
    }
    placement.symmetry.push_back(chosen);
    placement.error_px.push_back(best);
    placement.score += best * best;
  }
  return placement;
}

// points[permutation[i]] = G points[i], so a board pose found with the ids i becomes T G^-1 with the ids
// permutation[i].
SE3 proposal(const Link& link, const Symmetry& symmetry) {
  const SE3 X = link.T_cam_board * symmetry.T_board_board.inverse() * link.right.inverse();
  return link.left ? link.left->inverse() * X : X;
}

// Twice the median: what agrees with a placement and what does not.
double bound_of(std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  return 2 * errors[errors.size() / 2] + 1e-9;
}

// Mean over the links that agree with a placement: rotations by the nearest rotation to their sum,
// translations by the median of each coordinate.
SE3 average(const Calibration& cal, const std::vector<Link>& links, const Placement& placement,
            const Symmetries& all) {
  const double bound = bound_of(placement.error_px);
  Mat3 sum = Mat3::Zero();
  std::array<std::vector<double>, 3> t;
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (placement.error_px[i] > bound) continue;
    const SE3 T = proposal(links[i], all[target_of(cal, links[i])][placement.symmetry[i]]);
    sum += T.R();
    for (int k = 0; k < 3; ++k) t[k].push_back(T.t()[k]);
  }
  Vec3 middle;
  for (int k = 0; k < 3; ++k) {
    std::sort(t[k].begin(), t[k].end());
    middle[k] = t[k][t[k].size() / 2];
  }
  return {nearest_rotation(sum), middle};
}

// Root mean square over the views of a frame when X and Y tell where the second part's boards are.
double motion_error_px(const Calibration& cal, const MotionFrame& frame, const HandEye& guess,
                       const Symmetries& all) {
  const SE3 T_2 = guess.T_cam1_cam2.inverse() * frame.T_1 * guess.T_board1_board2;
  double sum = 0;
  for (const Link& link : frame.links) {
    const double e = error_px(cal, link, T_2, all[target_of(cal, link)][0]);
    sum += e * e;
  }
  return std::sqrt(sum / static_cast<double>(frame.links.size()));
}

Result<HandEye> hand_eye_of(const std::vector<MotionFrame>& frames, const std::vector<std::size_t>& chosen) {
  std::vector<SE3> first, second;
  for (std::size_t i : chosen) {
    first.push_back(frames[i].T_1);
    second.push_back(frames[i].T_2);
  }
  return hand_eye(first, second);
}

}  // namespace

double error_px(const Calibration& cal, const Link& link, const SE3& X, const Symmetry& symmetry) {
  const View& view = cal.data.views[link.view];
  const Camera& camera = cal.rig.cameras[view.cam];
  const double cap = cap_px(camera);
  const SE3 T_cam_board = link.left ? *link.left * X * link.right : X * link.right;
  double sum = 0;
  for (const Corner& c : view.corners) {
    const Vec3& p_board = cal.data.targets[view.target].points[symmetry.permutation[c.point]];
    const auto px = project(camera.lens, T_cam_board * p_board);
    sum += px ? std::min((*px - c.px).squaredNorm(), cap * cap) : cap * cap;
  }
  return std::sqrt(sum / static_cast<double>(view.corners.size()));
}

Placement place(const Calibration& cal, const std::vector<Link>& links, const Symmetries& all) {
  // Forty links spread over all of them propose, and judge the proposals; the best is judged by all.
  std::vector<Link> some;
  const std::size_t step = (links.size() + kMaxHypotheses - 1) / kMaxHypotheses;
  for (std::size_t i = 0; i < links.size(); i += step) some.push_back(links[i]);
  std::optional<Placement> best;
  const auto consider = [&](const std::vector<Link>& judges, const SE3& X) {
    Placement candidate = judge(cal, judges, X, all);
    if (!best || candidate.score < best->score * (1 - 1e-9)) best = std::move(candidate);
  };
  std::size_t most = 0;
  for (const auto& symmetries : all) most = std::max(most, symmetries.size());
  for (std::size_t g = 0; g < most; ++g) {  // the identity first: it wins a tie
    for (const Link& link : some) {
      const std::vector<Symmetry>& symmetries = all[target_of(cal, link)];
      if (g < symmetries.size()) consider(some, proposal(link, symmetries[g]));
    }
  }
  best = judge(cal, links, best->X, all);
  consider(links, average(cal, links, *best, all));
  return *best;
}

Result<HandEye> place_by_motion(const Calibration& cal, const std::vector<MotionFrame>& frames,
                                const Symmetries& all) {
  const std::size_t n = frames.size();
  std::vector<std::size_t> everything;
  for (std::size_t i = 0; i < n; ++i) everything.push_back(i);
  const auto whole = hand_eye_of(frames, everything);
  if (!whole) return whole;
  std::optional<HandEye> best;
  double best_score = 0;
  std::vector<double> best_errors;
  const auto consider = [&](const HandEye& guess) {
    std::vector<double> errors;
    double score = 0;
    for (const MotionFrame& frame : frames) {
      errors.push_back(motion_error_px(cal, frame, guess, all));
      score += errors.back() * errors.back();
    }
    if (best && !(score < best_score)) return;
    best = guess;
    best_score = score;
    best_errors = std::move(errors);
  };
  consider(*whole);
  // Triples that are spread over the recording, so that one wrong pose cannot bend all of them.
  for (std::size_t k = 0; k < std::min(n, kMaxHypotheses); ++k) {
    const std::size_t i = k * n / std::min(n, kMaxHypotheses);
    const auto guess = hand_eye_of(frames, {i, (i + n / 3) % n, (i + 2 * n / 3) % n});
    if (guess) consider(*guess);
  }
  for (int round = 0; round < 2; ++round) {
    const double bound = bound_of(best_errors);
    std::vector<std::size_t> agreeing;
    for (std::size_t i = 0; i < n; ++i) {
      if (best_errors[i] <= bound) agreeing.push_back(i);
    }
    if (const auto guess = hand_eye_of(frames, agreeing)) consider(*guess);
  }
  return *best;
}

}  // namespace plumbline::detail

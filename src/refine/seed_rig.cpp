// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {

namespace {

std::optional<std::vector<int>> permutation_by(const SE3& T, const std::vector<Vec3>& points,
                                               double tolerance_m) {
  std::vector<int> permutation;
  for (const Vec3& p : points) {
    const Vec3 moved = T * p;
    int match = -1;
    for (std::size_t k = 0; k < points.size() && match < 0; ++k) {
      if ((points[k] - moved).norm() < tolerance_m) match = static_cast<int>(k);
    }
    if (match < 0) return std::nullopt;
    permutation.push_back(match);
  }
  return permutation;
}

}  // namespace

std::vector<Symmetry> symmetries(const Target& target) {
  Symmetry identity;
  for (int i = 0; i < static_cast<int>(target.points.size()); ++i) identity.permutation.push_back(i);
  std::vector<Symmetry> list{identity};
  const auto* chess = std::get_if<Chessboard>(&target.spec);
  const bool circles = std::holds_alternative<Circles>(target.spec);
  if (!chess && !circles) return list;
  Vec3 low = target.points.front(), high = low;
  for (const Vec3& p : target.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec3 middle = 0.5 * (low + high);
  for (int quarter = 1; quarter < 4; ++quarter) {
    // The points alone say nothing about the colours of a board that is not square.
    if (chess && chess->columns != chess->rows && !is_half_turn_symmetric(target.spec)) continue;
    const Mat3 R = so3_exp(Vec3(0, 0, quarter * std::numbers::pi / 2));
    const SE3 T(R, middle - R * middle);
    if (auto permutation = permutation_by(T, target.points, 1e-6 * (high - low).norm())) {
      list.push_back({*std::move(permutation), T});
    }
  }
  return list;
}

namespace {

constexpr int kMaxHypotheses = 40;

struct Placement {
  SE3 T_cam_rig;
  std::vector<int> symmetry;  // per shared frame
  std::vector<double> error_px;
  double score = 0;
};

// One camera's view of a frame whose board pose is known from the cameras placed before.
struct SharedFrame {
  int view = 0;     // of the whole data set
  SE3 T_rig_board;  // known
  SE3 T_cam_board;  // from this camera alone
};

double error_px(const Calibration& cal, const SharedFrame& frame, const SE3& T_cam_rig,
                const Symmetry& symmetry) {
  const View& view = cal.data.views[frame.view];
  const Camera& camera = cal.rig.cameras[view.cam];
  const double cap = 0.05 * std::hypot(camera.size.width, camera.size.height);
  const SE3 T_cam_board = T_cam_rig * frame.T_rig_board;
  double sum = 0;
  for (const Corner& c : view.corners) {
    const auto px =
        project(camera.lens, T_cam_board * cal.data.targets[0].points[symmetry.permutation[c.point]]);
    sum += px ? std::min((*px - c.px).squaredNorm(), cap * cap) : cap * cap;
  }
  return std::sqrt(sum / static_cast<double>(view.corners.size()));
}

// The numbering of each frame that agrees best with T_cam_rig; another than the present one must be clearly
// better.
Placement judge(const Calibration& cal, const std::vector<SharedFrame>& frames, const SE3& T_cam_rig,
                const std::vector<Symmetry>& all) {
  Placement placement{T_cam_rig, {}, {}, 0};
  for (const SharedFrame& frame : frames) {
    double best = error_px(cal, frame, T_cam_rig, all[0]);
    int chosen = 0;
    for (std::size_t g = 1; g < all.size(); ++g) {
      const double e = error_px(cal, frame, T_cam_rig, all[g]);
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
SE3 relative_pose(const SharedFrame& frame, const Symmetry& symmetry) {
  return frame.T_cam_board * symmetry.T_board_board.inverse() * frame.T_rig_board.inverse();
}

// Mean over the frames that agree with a placement: rotations by the nearest rotation to their sum,
// translations by the median of each coordinate.
SE3 average(const std::vector<SharedFrame>& frames, const Placement& placement,
            const std::vector<Symmetry>& all) {
  std::vector<double> sorted = placement.error_px;
  std::sort(sorted.begin(), sorted.end());
  const double bound = 2 * sorted[sorted.size() / 2] + 1e-9;
  Mat3 sum = Mat3::Zero();
  std::array<std::vector<double>, 3> t;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (placement.error_px[i] > bound) continue;
    const SE3 T = relative_pose(frames[i], all[placement.symmetry[i]]);
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

Placement place(const Calibration& cal, const std::vector<SharedFrame>& frames,
                const std::vector<Symmetry>& all) {
  std::optional<Placement> best;
  const auto consider = [&](const SE3& T_cam_rig) {
    Placement candidate = judge(cal, frames, T_cam_rig, all);
    if (!best || candidate.score < best->score * (1 - 1e-9)) best = std::move(candidate);
  };
  const std::size_t n = frames.size(), step = (n + kMaxHypotheses - 1) / kMaxHypotheses;
  for (const Symmetry& symmetry : all) {  // the identity first: it wins a tie
    for (std::size_t i = 0; i < n; i += step) consider(relative_pose(frames[i], symmetry));
  }
  consider(average(frames, *best, all));
  return *best;
}

void renumber(View& view, const std::vector<int>& permutation) {
  for (Corner& c : view.corners) c.point = permutation[c.point];
  std::sort(view.corners.begin(), view.corners.end(),
            [](const Corner& a, const Corner& b) { return a.point < b.point; });
}

// The rig under construction.
struct Builder {
  Calibration cal;
  std::vector<std::optional<SE3>> T_cam_board;  // per view, from its camera alone
  std::vector<bool> placed;
  std::vector<std::string> renumbered;

  std::vector<SharedFrame> shared_frames(int cam) const {
    std::vector<SharedFrame> list;
    for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
      const View& view = cal.data.views[v];
      const auto& known = cal.T_rig_board[view.frame];
      if (view.cam == cam && T_cam_board[v] && known)
        list.push_back({static_cast<int>(v), *known, *T_cam_board[v]});
    }
    return list;
  }

  // Frames that no placed camera had seen get their pose from this one.
  void adopt_frames(int cam) {
    placed[cam] = true;
    const SE3 T_rig_cam = cal.rig.T_cam_rig[cam].inverse();
    for (std::size_t v = 0; v < cal.data.views.size(); ++v) {
      const View& view = cal.data.views[v];
      if (view.cam != cam || !T_cam_board[v]) continue;
      auto& pose = cal.T_rig_board[view.frame];
      if (!pose) pose = T_rig_cam * *T_cam_board[v];
    }
  }

  void add(int cam, const std::vector<SharedFrame>& frames, const std::vector<Symmetry>& all) {
    const Placement placement = place(cal, frames, all);
    cal.rig.T_cam_rig[cam] = placement.T_cam_rig;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Symmetry& symmetry = all[placement.symmetry[i]];
      if (placement.symmetry[i] == 0) continue;
      View& view = cal.data.views[frames[i].view];
      renumber(view, symmetry.permutation);
      T_cam_board[frames[i].view] = frames[i].T_cam_board * symmetry.T_board_board.inverse();
      renumbered.push_back(view.image.empty() ? cal.rig.cameras[cam].name + " " + cal.data.frames[view.frame]
                                              : view.image);
    }
    adopt_frames(cam);
  }
};

// Among the cameras of a frame, the one whose pose suits all of them best.
void choose_frame_poses(Builder& b) {
  std::vector<std::vector<int>> views_of(b.cal.T_rig_board.size());
  for (std::size_t v = 0; v < b.cal.data.views.size(); ++v) {
    if (b.T_cam_board[v]) views_of[b.cal.data.views[v].frame].push_back(static_cast<int>(v));
  }
  Symmetry identity;
  for (int i = 0; i < static_cast<int>(b.cal.data.targets[0].points.size()); ++i)
    identity.permutation.push_back(i);
  for (std::size_t f = 0; f < views_of.size(); ++f) {
    if (views_of[f].size() < 2) continue;
    double best = -1;
    for (int source : views_of[f]) {
      const SE3 T_rig_board =
          b.cal.rig.T_cam_rig[b.cal.data.views[source].cam].inverse() * *b.T_cam_board[source];
      double sum = 0;
      for (int v : views_of[f]) {
        sum += error_px(b.cal, {v, T_rig_board, {}}, b.cal.rig.T_cam_rig[b.cal.data.views[v].cam], identity);
      }
      if (best >= 0 && !(sum < best)) continue;
      best = sum;
      b.cal.T_rig_board[f] = T_rig_board;
    }
  }
}

}  // namespace

Result<Calibration> seed_rig(const Dataset& data, const std::vector<MonoData>& parts,
                             std::vector<Calibration> monos) {
  std::vector<Lens> lenses;
  for (const Calibration& mono : monos) lenses.push_back(mono.rig.cameras[0].lens);
  Builder b{empty_calibration(data, lenses), {}, {}, {}};
  b.T_cam_board.resize(data.views.size());
  b.placed.assign(monos.size(), false);
  for (std::size_t cam = 0; cam < monos.size(); ++cam) {
    for (std::size_t i = 0; i < parts[cam].view_index.size(); ++i) {
      const int v = parts[cam].view_index[i];
      b.cal.view_reason[v] = monos[cam].view_reason[i];
      if (takes_part(monos[cam], i))
        b.T_cam_board[v] = monos[cam].T_rig_board[parts[cam].data.views[i].frame];
    }
  }
  const std::vector<Symmetry> all = symmetries(data.targets[0]);
  b.adopt_frames(0);
  for (std::size_t n_placed = 1; n_placed < monos.size(); ++n_placed) {
    int next = -1;
    std::vector<SharedFrame> most;
    for (int cam = 0; cam < static_cast<int>(monos.size()); ++cam) {
      if (b.placed[cam]) continue;
      std::vector<SharedFrame> frames = b.shared_frames(cam);
      if (next >= 0 && frames.size() <= most.size()) continue;
      next = cam;
      most = std::move(frames);
    }
    if (most.empty()) {
      return Error{
          ErrorCode::kDegenerate,
          fmt::format(
              "cameras {} and {} never see the board in the same frame, and no other camera connects them; "
              "take images in which both see the board at once, and check that --cam patterns pair the "
              "frames",
              data.cameras[0].name, data.cameras[next].name),
          fmt::format("cameras {}, {}", data.cameras[0].name, data.cameras[next].name)};
    }
    b.add(next, most, all);
  }
  choose_frame_poses(b);
  for (std::size_t v = 0; v < data.views.size(); ++v) {
    if (b.T_cam_board[v]) b.cal.fits[v].resize(data.views[v].corners.size());
  }
  if (!b.renumbered.empty()) {
    std::string& remark = b.cal.data.detector;
    remark += fmt::format("{}{} views renumbered, because the board looks the same turned around: {}",
                          remark.empty() ? "" : "; ", b.renumbered.size(), join(b.renumbered, ", "));
  }
  evaluate(b.cal);
  return std::move(b.cal);
}

}  // namespace plumbline::detail

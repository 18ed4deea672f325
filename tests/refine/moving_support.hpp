// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>

#include "plumbline/rig/motion.hpp"
#include "refine_support.hpp"

/// Recordings of moving boards with known truth; nothing here is the code under test but SE3.
namespace plumbline::test {

using Motion = std::function<SE3(double time_s)>;

/// A motion that the model of rig/motion.hpp holds exactly: about one axis by a polynomial of fourth degree,
/// and along one in each coordinate. `mid` is where it is at mid_s; half_s later it has come some 6 cm and 7
/// degrees.
inline Motion polynomial_motion(const SE3& mid, double mid_s, double half_s, Rng& rng) {
  const Vec3 axis = Vec3(rng.normal(), rng.normal(), rng.normal()).normalized();
  Eigen::Matrix<double, 4, 4> a;  // rows: x y z angle; columns: powers 1 to 4
  const Vec4 size(1, 0.4, 0.2, 0.1);
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) a(r, c) = rng.normal(r < 3 ? 0.04 : 0.12) * size[c];
  }
  return [=](double t) {
    const double s = (t - mid_s) / half_s;
    const Vec4 x = a * Vec4(s, s * s, s * s * s, s * s * s * s);
    return SE3(so3_exp(axis * x[3]) * mid.R(), mid.t() + x.head<3>());
  };
}

struct Recording {
  Dataset data;
  Rig rig;
  std::vector<std::optional<SE3>> T_rig_board;  ///< at the frames' times
};

struct RecordingOptions {
  std::vector<Lens> lenses;
  double line_delay_s = 30e-6, time_offset_s = 0.004;  ///< the latter of all cameras but the first
  double late_s = 0.002;  ///< cameras but the first see the frame that much later
  double interval_s = 0.04;
  int n_runs = 6, n_frames = 8;
  std::uint64_t seed = 1;
};

/// Where a point appears whose row is exposed when it appears there: by repetition, which halves the error at
/// least 20 times each round here.
inline std::optional<Vec2> seen_in_rows(const Lens& lens, const SE3& T_cam_rig, const Motion& motion,
                                        double start_s, double line_delay_s, double middle_row,
                                        const Vec3& p) {
  double row = middle_row;
  std::optional<Vec2> px;
  for (int i = 0; i < 40; ++i) {
    px = project_by_opencv(lens, T_cam_rig * (motion(start_s + line_delay_s * (row - middle_row)) * p));
    if (!px) return std::nullopt;
    row = px->y();
  }
  return px;
}

/// \param make_motion  of a run around a pose and a time
inline Recording record(const RecordingOptions& o,
                        const std::function<Motion(const SE3&, double, Rng&)>& make_motion) {
  Scene scene{.lenses = o.lenses, .n_frames = 1, .seed = o.seed};
  const Simulation sim = simulate(scene);
  Recording rec{sim.truth.data, sim.truth.rig, {}};
  rec.data.frames.clear();
  rec.data.views.clear();
  const Target& target = rec.data.targets[0];
  Rng rng(o.seed);
  for (int run = 0; run < o.n_runs; ++run) {
    const double mid_s = 2.0 * run + 0.5 * o.interval_s * (o.n_frames - 1);
    const Motion motion = make_motion(random_board_pose(scene, target, rng), mid_s, rng);
    for (int i = 0; i < o.n_frames; ++i) {
      const double frame_s = 2.0 * run + o.interval_s * i;
      const int frame = static_cast<int>(rec.data.frames.size());
      rec.data.frames.push_back(std::to_string(frame));
      rec.T_rig_board.emplace_back(motion(frame_s));
      for (int cam = 0; cam < static_cast<int>(o.lenses.size()); ++cam) {
        const double exposed_s = frame_s + (cam > 0 ? o.late_s : 0);
        View view{cam, frame, rec.data.cameras[cam].name + "/" + std::to_string(frame), {}, ""};
        view.time_s = exposed_s - (cam > 0 ? o.time_offset_s : 0);
        for (int id = 0; id < static_cast<int>(target.points.size()); ++id) {
          const auto px = seen_in_rows(o.lenses[cam], rec.rig.T_cam_rig[cam], motion, exposed_s,
                                       o.line_delay_s, 0.5 * (scene.size.height - 1), target.points[id]);
          if (px && px->minCoeff() >= 0 && px->x() <= scene.size.width - 1 &&
              px->y() <= scene.size.height - 1)
            view.corners.push_back({id, *px, 1.0});
        }
        if (view.corners.size() >= 12) rec.data.views.push_back(view);
      }
    }
  }
  std::stable_sort(rec.data.views.begin(), rec.data.views.end(),
                   [](const View& a, const View& b) { return a.cam < b.cam; });
  return rec;
}

inline Recording record_polynomials(const RecordingOptions& o) {
  const double half_s = 0.5 * o.interval_s * std::max(1, o.n_frames - 1);
  return record(
      o, [=](const SE3& mid, double mid_s, Rng& rng) { return polynomial_motion(mid, mid_s, half_s, rng); });
}

/// The true lenses and poses, and no clocks.
inline Calibration start_of(const Recording& rec) {
  Calibration start;
  start.data = rec.data;
  start.rig = rec.rig;
  start.T_rig_board = rec.T_rig_board;
  return start;
}

}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plumbline/core/random.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"
#include "visibility.hpp"

namespace plumbline {
namespace {

constexpr int kTries = 400;  // poses drawn for one frame before giving up

Error bad(const std::string& message) { return {ErrorCode::kInvalidData, message, "simulate"}; }

Status check(const SceneOptions& o) {
  if (o.size.width < 16 || o.size.height < 16 || o.size.width > 20000 || o.size.height > 20000) {
    return bad(
        fmt::format("size {}x{}: 16 to 20000 pixels a side are possible", o.size.width, o.size.height));
  }
  if (o.n_views < 1 || o.n_views > 100000)
    return bad(fmt::format("{} views: 1 to 100000 are possible", o.n_views));
  if (o.n_cameras < 1 || o.n_cameras > 100)
    return bad(fmt::format("{} cameras: 1 to 100 are possible", o.n_cameras));
  if (!std::isfinite(o.baseline_m) || (o.n_cameras > 1 && !(o.baseline_m > 0))) {
    return bad(fmt::format("baseline {} m: a length above 0 is needed", o.baseline_m));
  }
  if (!(o.noise_px >= 0 && o.noise_px <= 100))
    return bad(fmt::format("noise {} px: 0 to 100 are possible", o.noise_px));
  return {};
}

// Independent streams from one seed.
Rng stream(std::uint64_t seed, std::uint64_t which) {
  return Rng(Rng(seed * 0x9E3779B97F4A7C15ULL + which).bits());
}

Result<Rig> draw_rig(const SceneOptions& o) {
  Rig rig;
  Rng rng = stream(o.seed, 1);
  for (int i = 0; i < o.n_cameras; ++i) {
    Lens lens;
    if (i == 0 && o.exact_lens) {
      lens = *o.exact_lens;
    } else {
      const std::string name(o.exact_lens ? lens_name(*o.exact_lens) : std::string_view(o.lens));
      auto drawn = simulated_lens(name, o.fov_deg, o.size, o.distorted,
                                  o.seed + 1000003ULL * static_cast<std::uint64_t>(i));
      if (!drawn) return drawn.error();
      lens = *std::move(drawn);
      if (o.exact_lens) lens = *o.exact_lens;  // all cameras of a rig with a given lens have it
    }
    rig.cameras.push_back({fmt::format("cam{}", i), o.size, lens});
    // Cameras of a rig are never quite parallel; a degree or so.
    const Mat3 R = i == 0 ? Mat3(Mat3::Identity())
                          : so3_exp(Vec3(rng.normal(0.01), rng.normal(0.015), rng.normal(0.01)));
    rig.T_cam_rig.emplace_back(R, -(R * Vec3(i * o.baseline_m, 0, 0)));
  }
  return rig;
}

// How the target is best looked at: its middle, its radius, and the rotation into a frame whose z points away
// from the viewer, y down.
struct Subject {
  Vec3 middle = Vec3::Zero();
  double radius = 0;
  Mat3 R_view_target = Mat3::Identity();
  double max_tilt = std::numbers::pi / 4;  ///< from facing the camera [rad]
};

Subject subject_of(const Target& target, const std::vector<BoardDrawing>& drawings) {
  Subject s;
  for (const Vec3& p : target.points) s.middle += p / static_cast<double>(target.points.size());
  for (const Vec3& p : target.points) s.radius = std::max(s.radius, (p - s.middle).norm());
  Vec3 away = Vec3::Zero(), down = Vec3::Zero();
  for (const BoardDrawing& d : drawings) {
    const Mat3 R = d.T_target_board.R();
    away += d.y_up ? Vec3(-R.col(2)) : Vec3(R.col(2));
    down += d.y_up ? Vec3(-R.col(1)) : Vec3(R.col(1));
  }
  // Boards that face all ways have no best side.
  if (away.norm() < 1e-6 * static_cast<double>(drawings.size() + 1)) return s;
  away.normalize();
  down -= away * away.dot(down);
  if (down.norm() < 1e-6) down = away.unitOrthogonal();
  down.normalize();
  // The faces of a corner are tilted by 55 degrees already when the corner faces the camera.
  if (!target.is_planar) s.max_tilt = 0.35;
  s.R_view_target.row(0) = down.cross(away);
  s.R_view_target.row(1) = down;
  s.R_view_target.row(2) = away;
  return s;
}

// A pose in front of one camera: the middle of the target at `place` of the image (0..1 both ways), the
// target covering about `share` of the image's smaller side.
std::optional<SE3> draw_pose(const Subject& s, const Camera& camera, const Vec2& place, double share,
                             Rng& rng) {
  const Vec2 px(place.x() * camera.size.width - 0.5, place.y() * camera.size.height - 0.5);
  const double tilt = s.max_tilt * std::sqrt(rng.uniform()), towards = rng.uniform(0, 2 * std::numbers::pi);
  const double roll = rng.uniform(-0.5, 0.5);
  const auto ray = unproject(camera.lens, px);
  if (!ray) return std::nullopt;
  const double span_px = share * std::min(camera.size.width, camera.size.height);
  const double half_angle = std::min(std::atan(0.5 * span_px / params(camera.lens)[0]), 0.65);
  const Vec3 turn = Vec3::UnitZ().cross(*ray);
  const double angle = std::acos(std::clamp(ray->z(), -1.0, 1.0));
  const Mat3 R_look = turn.norm() < 1e-12 ? Mat3(Mat3::Identity()) : so3_exp(turn.normalized() * angle);
  const Mat3 R = R_look * so3_exp(Vec3(0, 0, roll)) *
                 so3_exp(tilt * Vec3(std::cos(towards), std::sin(towards), 0)) * s.R_view_target;
  const double distance = s.radius / std::sin(half_angle);
  return SE3(R, distance * *ray - R * s.middle);
}

struct Frame {
  SE3 T_rig_board;
  std::vector<std::vector<Corner>> corners;  // per camera
};

// The corners a detector would report in each camera, without noise.
std::vector<std::vector<Corner>> see(const Target& target, const std::vector<BoardDrawing>& drawings,
                                     const Rig& rig, const SE3& T_rig_board) {
  std::vector<std::vector<Corner>> seen;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    seen.push_back(visible_corners(target, drawings, rig.cameras[i], rig.T_cam_rig[i] * T_rig_board));
    if (detail::needs_whole(target.spec) && seen.back().size() < target.points.size()) seen.back().clear();
  }
  return seen;
}

std::optional<Frame> draw_frame(const Target& target, const std::vector<BoardDrawing>& drawings,
                                const Subject& subject, const Rig& rig, int index, std::uint64_t seed) {
  Rng rng = stream(seed, 1000 + static_cast<std::uint64_t>(index));
  const int n_cameras = static_cast<int>(rig.cameras.size()), chosen = index % n_cameras;
  const double n_points = static_cast<double>(target.points.size());
  for (int attempt = 0; attempt < kTries; ++attempt) {
    // The first place is that of an evenly spread sequence (Roberts 2018, R2), so that few views cover the
    // image well.
    const double turn = attempt == 0 ? 0 : rng.uniform();
    Vec2 place(std::fmod(0.5 + 0.7548776662466927 * (index + 1) + turn, 1.0),
               std::fmod(0.5 + 0.5698402909980532 * (index + 1) + 0.618 * attempt, 1.0));
    place = Vec2::Constant(0.12) + 0.76 * place;
    const double tired = static_cast<double>(attempt) / kTries;  // the longer it takes, the less is asked for
    const double share = rng.uniform(0.35, 0.8) * (1 - 0.5 * tired);
    const auto T_cam_board = draw_pose(subject, rig.cameras[chosen], place, share, rng);
    if (!T_cam_board) continue;
    Frame frame{rig.T_cam_rig[chosen].inverse() * *T_cam_board, {}};
    frame.corners = see(target, drawings, rig, frame.T_rig_board);
    bool enough = static_cast<double>(frame.corners[chosen].size()) >= (0.75 - 0.5 * tired) * n_points;
    for (const auto& corners : frame.corners) {
      if (tired < 0.6 && static_cast<double>(corners.size()) < 0.5 * n_points) enough = false;
    }
    if (enough && frame.corners[chosen].size() >= 4) return frame;
  }
  return std::nullopt;
}

void add_noise(std::vector<Corner>& corners, double noise_px, Rng rng) {
  for (Corner& corner : corners) {
    if (noise_px > 0) {
      corner.px += Vec2(rng.normal(noise_px), rng.normal(noise_px));
      corner.sigma_px = noise_px;
    }
  }
}

// The views by camera, the noise as residuals, and the RMS.
void fill_views(Calibration& truth, std::vector<Frame>& frames, const SceneOptions& o) {
  double sum = 0;
  for (int cam = 0; cam < o.n_cameras; ++cam) {
    for (int i = 0; i < o.n_views; ++i) {
      View view{cam, i, truth.rig.cameras[cam].name + "/" + truth.data.frames[i] + ".png",
                std::move(frames[i].corners[cam]), ""};
      // The measurement model itself, so that without noise a residual is 0 and not a rounding error.
      for (Corner& corner : view.corners) corner.px = *predict(truth, view, corner.point);
      add_noise(view.corners, o.noise_px,
                stream(o.seed,
                       1000000 + static_cast<std::uint64_t>(cam) * 1000000 + static_cast<std::uint64_t>(i)));
      if (view.corners.empty()) view.reason = "the board is not seen, or not seen whole";
      std::vector<CornerFit> fits;
      for (const Corner& corner : view.corners) {
        fits.push_back({*predict(truth, view, corner.point) - corner.px, false});
        sum += fits.back().residual_px.squaredNorm();
      }
      truth.stats.n_corners += static_cast<int>(fits.size());
      truth.view_reason.push_back(view.reason);
      truth.fits.push_back(std::move(fits));
      truth.data.views.push_back(std::move(view));
    }
  }
  if (truth.stats.n_corners > 0) truth.stats.rms_px = std::sqrt(sum / truth.stats.n_corners);
  truth.stats.rms_xy_px = truth.stats.rms_px / std::sqrt(2.0);
}

}  // namespace

Result<Calibration> simulate(const Target& target, const SceneOptions& o) {
  if (Status ok = check(o); !ok) return ok.error();
  std::vector<BoardDrawing> drawings;
  if (!std::holds_alternative<Points3d>(target.spec)) {
    auto drawn = draw_target(target);
    if (!drawn) return drawn.error();
    drawings = *std::move(drawn);
  }
  auto rig = draw_rig(o);
  if (!rig) return rig.error();
  Calibration truth;
  truth.rig = *std::move(rig);
  truth.data.targets = {target};
  truth.data.detector = "simulated";
  for (const Camera& camera : truth.rig.cameras) truth.data.cameras.push_back({camera.name, camera.size});

  const Subject subject = subject_of(target, drawings);
  std::vector<Frame> frames;
  for (int i = 0; i < o.n_views; ++i) {
    auto frame = draw_frame(target, drawings, subject, truth.rig, i, o.seed);
    if (!frame) {
      return Error{ErrorCode::kDegenerate,
                   fmt::format("no pose found in {} tries that shows the target (radius {:.3g} m) to a {:g} "
                               "degree lens; try a "
                               "smaller baseline than {:g} m or another field of view",
                               kTries, subject.radius, o.fov_deg, o.baseline_m),
                   fmt::format("view {}", i)};
    }
    truth.data.frames.push_back(fmt::format("{:03}", i));
    truth.T_rig_board.emplace_back(frame->T_rig_board);
    frames.push_back(*std::move(frame));
  }
  fill_views(truth, frames, o);
  truth.stats.converged = true;
  truth.stats.termination = "simulated: this is the truth, not an estimate";
  truth.provenance.options = {{"lens", std::string(lens_name(truth.rig.cameras[0].lens))},
                              {"fov_deg", fmt::format("{:g}", o.fov_deg)},
                              {"noise_px", fmt::format("{:g}", o.noise_px)},
                              {"seed", fmt::format("{}", o.seed)}};
  truth.provenance.corners_hash = corners_hash(truth.data);
  return truth;
}

}  // namespace plumbline

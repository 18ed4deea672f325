// SPDX-License-Identifier: Apache-2.0
#include "refine/weak.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline::detail {

namespace {

// No corner finder is better than this on photographs, so that data without noise are judged like data with
// little.
constexpr double kSmallestNoisePx = 0.05;
// Two per cent of the focal length is 20 px at the rim of a 2000 px image; three of the width for the centre
// is the same order, since a shift of the centre is mostly taken up by turning the camera.
constexpr double kWeakFocal = 0.02, kWeakCentre = 0.03;
// Beyond a fifth the linear prediction itself has no meaning any more.
constexpr double kUselessFocal = 0.10;
// Boards that are nearly parallel to one another: the errors of their printing and of the corner finder are
// the same in all of them and do not average out as the covariance believes. Ten frames of a hand-held
// sequence whose boards stayed within 2 degrees miss the focal length by 4 % at a predicted 1 %
// (tests/refine/reference_test.cpp).
constexpr double kWeakSpreadDeg = 10.0;
// A central perspective that sees boards only head-on: focal length and distance cannot be told apart.
constexpr double kHeadOnDeg = 2.0;
constexpr double kDegPerRad = 180 / std::numbers::pi;

// How the boards that one camera saw were tilted.
struct Tilts {
  double spread_deg = 0;   // largest angle between two normals
  double largest_deg = 0;  // largest angle between a normal and the optical axis
  int n_views = 0;
};

Tilts tilts_of(const Calibration& cal, int cam) {
  std::vector<Vec3> normals;
  Tilts tilts;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (cal.data.views[v].cam != cam || !takes_part(cal, v)) continue;
    normals.push_back((cal.rig.T_cam_rig[cam] * *board_pose(cal, cal.data.views[v])).R().col(2));
    // atan2 of the cross product: acos loses half the digits near zero
    const Vec3& n = normals.back();
    tilts.largest_deg =
        std::max(tilts.largest_deg, kDegPerRad * std::atan2(std::hypot(n.x(), n.y()), std::abs(n.z())));
  }
  tilts.n_views = static_cast<int>(normals.size());
  for (const Vec3& a : normals) {
    for (const Vec3& b : normals) {
      tilts.spread_deg = std::max(tilts.spread_deg, kDegPerRad * std::atan2(a.cross(b).norm(), a.dot(b)));
    }
  }
  return tilts;
}

bool all_planar(const Calibration& cal) {
  return std::all_of(cal.data.targets.begin(), cal.data.targets.end(),
                     [](const Target& target) { return target.is_planar; });
}

constexpr const char* kNextStep = "add images with the board tilted 30 to 45 degrees in several directions";

// The scale of the image at its centre along x and y [px/rad], which is what a focal length means: fx and fy
// themselves for most lenses, fx / (1 + xi) for a sphere seen from xi above its centre.
Vec2 centre_scale(const Lens& lens) {
  Mat23 J_px_p;
  if (!project(lens, Vec3(0, 0, 1), &J_px_p)) return Vec2(params(lens)[0], params(lens)[1]);
  return {J_px_p(0, 0), J_px_p(1, 1)};
}

// Covariance of that scale and of cx, cy.
Mat4 centre_covariance(const Lens& lens, const MatX& covariance, int offset) {
  const int n = n_params(lens);
  MatX G = MatX::Zero(4, n);
  G(2, 2) = G(3, 3) = 1;
  for (int i = 0; i < n; ++i) {
    Lens up = lens, down = lens;
    const double h = 1e-6 * std::max(1.0, std::abs(params(lens)[i]));
    params(up)[i] += h, params(down)[i] -= h;
    G.col(i).head<2>() = (centre_scale(up) - centre_scale(down)) / (2 * h);
  }
  return G * covariance.block(offset, offset, n, n) * G.transpose();
}

// Directions of (fx, fy, cx, cy) in units of the focal lengths and the image's width.
void add_weak_lens(Calibration& cal, const MatX& covariance, int cam, int offset,
                   const std::vector<std::string>& names) {
  const Camera& camera = cal.rig.cameras[cam];
  const Vec2 f = centre_scale(camera.lens);
  const double width = camera.size.width;
  const VecX scale = Vec4(1 / f.x(), 1 / f.y(), 1 / width, 1 / width);
  const SymEigen eigen =
      sym_eigen(scale.asDiagonal() * centre_covariance(camera.lens, covariance, offset) * scale.asDiagonal());
  const Tilts tilts = tilts_of(cal, cam);
  const bool all_alike = all_planar(cal) && tilts.spread_deg < kWeakSpreadDeg;
  for (int i = 3; i >= 0; --i) {
    const VecX direction = eigen.vectors.col(i);
    const double sigma = std::sqrt(std::max(0.0, eigen.values[i]));
    const auto [text, first] = describe_direction(direction, names, offset);
    const double bound = first < 2 ? kWeakFocal : kWeakCentre;
    if (!(sigma > bound) && !(all_alike && i == 3)) continue;
    WeakDirection weak;
    weak.parameters = text;
    weak.sigma = sigma * std::abs(direction[first]) / scale[first];
    if (sigma > bound) {
      weak.consequence = fmt::format("{} is known to +-{:.2g} px only ({:.1f} % of {}); {}",
                                     names[offset + first], weak.sigma, 100 * weak.sigma * scale[first],
                                     first < 2 ? "its value" : "the image's width", kNextStep);
    } else {
      weak.consequence = fmt::format(
          "the {} boards that camera {} saw are within {:.1f} degrees of parallel, so that errors common to "
          "all of them "
          "move {} by more than the predicted +-{:.2g} px; {}",
          tilts.n_views, camera.name, tilts.spread_deg, names[offset + first], weak.sigma, kNextStep);
    }
    cal.stats.weak.push_back(std::move(weak));
  }
}

// A held focal length has no variance and cannot be refused; one with a prior is judged by its variance
// alone.
Status refuse_useless(const Calibration& cal, const MatX& covariance, int cam, int offset,
                      const std::vector<PriorTerm>& priors) {
  const Camera& camera = cal.rig.cameras[cam];
  const double fx = centre_scale(camera.lens).x(),
               sigma = std::sqrt(centre_covariance(camera.lens, covariance, offset)(0, 0));
  const Tilts tilts = tilts_of(cal, cam);
  const bool has_prior = std::any_of(priors.begin(), priors.end(), [&](const PriorTerm& prior) {
    return prior.index == offset || prior.index == offset + 1;
  });
  const bool head_on = !has_prior && all_planar(cal) && is_central_perspective(camera.lens) &&
                       tilts.largest_deg < kHeadOnDeg && sigma > 0;
  if (!(sigma > kUselessFocal * fx) && !head_on) return {};
  return Error{
      ErrorCode::kDegenerate,
      fmt::format(
          "its {} views do not determine the focal length: {:.4g} +- {:.2g} px from boards that are within "
          "{:.1f} degrees of parallel to one another and {:.1f} degrees of parallel to the image; {}",
          tilts.n_views, fx, sigma, tilts.spread_deg, tilts.largest_deg, kNextStep),
      "camera " + camera.name};
}

}  // namespace

std::pair<std::string, int> describe_direction(const VecX& direction, const std::vector<std::string>& names,
                                               int first_name) {
  std::vector<int> order(direction.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return std::abs(direction[a]) > std::abs(direction[b]); });
  const double sign = direction[order[0]] < 0 ? -1 : 1;
  std::vector<std::string> pieces;
  for (int i : order) {
    if (std::abs(direction[i]) < 0.2) break;
    pieces.push_back(fmt::format("{} ({:+.2f})", names[first_name + i], sign * direction[i]));
  }
  return {join(pieces, ", "), order[0]};
}

Status judge_determination(Calibration& cal, const SolveSpec& spec) {
  // Thousands of parameters of which no one means anything: neither a covariance nor weak directions.
  cal.covariance.reset();
  for (const Camera& camera : cal.rig.cameras) {
    if (is_sparse(camera.lens)) return {};
  }
  const std::vector<std::string> names = shared_parameter_names(cal);
  const SharedCovariance c = shared_covariance(cal, spec);
  cal.covariance = c.variance * c.unit_covariance;
  const MatX judged = std::max(c.variance, kSmallestNoisePx * kSmallestNoisePx) * c.unit_covariance;
  int offset = 0;
  const int n_cams = static_cast<int>(cal.rig.cameras.size());
  for (int cam = 0; cam < n_cams; ++cam) {
    if (auto status = refuse_useless(cal, judged, cam, offset, spec.priors); !status) return status;
    add_weak_lens(cal, judged, cam, offset, names);
    offset += n_params(cal.rig.cameras[cam].lens);
  }
  add_weak_rig(cal, judged, names);
  if (c.null_direction.size() > 0) {
    // Terms of a lens with more terms than the views can tell apart: harmless for the pixels that the boards
    // covered.
    const auto [text, first] = describe_direction(c.null_direction, names, 0);
    cal.stats.weak.push_back(
        {text, std::sqrt(judged(first, first)),
         "these can change together without changing any residual, and mean nothing one by one; "
         "choose a lens with fewer terms or hold some with --fix"});
  }
  return {};
}

}  // namespace plumbline::detail

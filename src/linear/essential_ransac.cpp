// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "linear/consensus.hpp"
#include "linear/degeneracy.hpp"
#include "linear/dlt.hpp"
#include "linear/minimal.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/essential.hpp"
#include "plumbline/linear/plane_motion.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "essential_ransac";
// Rays come from unproject(), to 1e-10 px; the solvers lose some digits.
constexpr double kRoundingPx = 1e-6;

Error degenerate(std::string text) { return {ErrorCode::kDegenerate, std::move(text), kWhere}; }

// The pairs that both lenses see.
struct Seen {
  std::vector<detail::Lifted> a, b;
  std::vector<Vec2> px2;
  std::vector<std::size_t> index;  // of the caller's pair
};

Seen lift_pairs(const Lens& lens_1, const Lens& lens_2, std::span<const Vec2> px1,
                std::span<const Vec2> px2) {
  Seen out;
  for (std::size_t i = 0; i < px1.size(); ++i) {
    const auto a = detail::lift(lens_1, px1[i]), b = detail::lift(lens_2, px2[i]);
    if (!a || !b) continue;
    out.a.push_back(*a), out.b.push_back(*b), out.px2.push_back(px2[i]), out.index.push_back(i);
  }
  return out;
}

// Sampson distances in pixels of many pairs of rays: coordinates apart, so that the loop is one of vectors.
class SampsonErrors {
 public:
  explicit SampsonErrors(const Seen& pairs) : data_(static_cast<Eigen::Index>(pairs.a.size()), 18) {
    for (std::size_t i = 0; i < pairs.a.size(); ++i) {
      const detail::Lifted &a = pairs.a[i], &b = pairs.b[i];
      data_.row(static_cast<Eigen::Index>(i)) << a.v.transpose(), a.J_v_px.col(0).transpose(),
          a.J_v_px.col(1).transpose(), b.v.transpose(), b.J_v_px.col(0).transpose(),
          b.J_v_px.col(1).transpose();
    }
  }

  void operator()(const Mat3& E, int first, std::span<double> e2) const {
    constexpr int kBlock = 128;
    using Block = Eigen::Array<double, Eigen::Dynamic, 1, 0, kBlock, 1>;
    for (std::size_t done = 0; done < e2.size(); done += kBlock) {
      const auto n = static_cast<Eigen::Index>(std::min<std::size_t>(kBlock, e2.size() - done));
      const auto at = static_cast<Eigen::Index>(first) + static_cast<Eigen::Index>(done);
      const auto column = [&](int c) { return data_.col(c).segment(at, n); };
      const auto dot = [&](int c, const Block& x, const Block& y, const Block& z) {
        return column(c) * x + column(c + 1) * y + column(c + 2) * z;
      };
      const auto map = [&](double k0, double k1, double k2, int c) -> Block {
        return k0 * column(c) + k1 * column(c + 1) + k2 * column(c + 2);
      };
      const Block x2 = map(E(0, 0), E(0, 1), E(0, 2), 0), y2 = map(E(1, 0), E(1, 1), E(1, 2), 0),
                  z2 = map(E(2, 0), E(2, 1), E(2, 2), 0);
      const Block x1 = map(E(0, 0), E(1, 0), E(2, 0), 9), y1 = map(E(0, 1), E(1, 1), E(2, 1), 9),
                  z1 = map(E(0, 2), E(1, 2), E(2, 2), 9);
      Eigen::Map<Eigen::ArrayXd>(e2.data() + done, n) =
          dot(9, x2, y2, z2).square() / (dot(12, x2, y2, z2).square() + dot(15, x2, y2, z2).square() +
                                         dot(3, x1, y1, z1).square() + dot(6, x1, y1, z1).square());
    }
  }

 private:
  Eigen::ArrayXXd data_;
};

// Gauss-Newton on the Sampson distances of some pairs, whose slopes are those of the step before.
std::optional<Mat3> refit(const Seen& pairs, const Mat3& E, std::span<const int> of) {
  if (of.size() < 6) return std::nullopt;
  constexpr int kSteps = 3;
  const SE3 start = decompose_essential(E)[0];
  Mat3 R = start.R();
  Vec3 t = start.t();
  for (int k = 0; k < kSteps; ++k) {
    const Mat3 M = skew(t) * R;
    Eigen::Matrix<double, 3, 2> across;  // of the sphere at t
    across.col(0) = t.unitOrthogonal();
    across.col(1) = t.cross(across.col(0));
    MatX A = MatX::Zero(5, 5), g = MatX::Zero(5, 1);
    for (const int i : of) {
      const detail::Lifted &a = pairs.a[static_cast<std::size_t>(i)],
                           &b = pairs.b[static_cast<std::size_t>(i)];
      const Vec3 q = R * a.v, p = q.cross(b.v);
      const double slope2 = (a.J_v_px.transpose() * (M.transpose() * b.v)).squaredNorm() +
                            (b.J_v_px.transpose() * (M * a.v)).squaredNorm();
      if (!(slope2 > 0)) continue;
      Eigen::Matrix<double, 5, 1> J;
      J << q.cross(b.v.cross(t)), across.transpose() * p;
      A += J * J.transpose() / slope2;
      g += J * (t.dot(p) / slope2);
    }
    const auto step = solve_spd(A, -g);
    if (!step) return std::nullopt;
    R = so3_exp(Vec3(step->topRows<3>())) * R;
    t = (t + across * step->bottomRows<2>()).normalized();
  }
  return Mat3(skew(t) * R);
}

std::optional<Found<Mat3>> search(const Seen& pairs, const SampsonErrors& errors,
                                  const RansacOptions& options) {
  return detail::find_consensus<Mat3>(
      static_cast<int>(pairs.a.size()), 5, options,
      [&](std::span<const int> sample, std::vector<Mat3>& out) {
        std::array<Vec3, 5> a, b;
        for (std::size_t i = 0; i < 5; ++i) {
          a[i] = pairs.a[static_cast<std::size_t>(sample[i])].v;
          b[i] = pairs.b[static_cast<std::size_t>(sample[i])].v;
        }
        const detail::Answers<10> answers = detail::five_point(a, b);
        if (!(answers.determinacy > detail::kRankTolerance)) return;
        for (int i = 0; i < answers.n; ++i) {
          const Mat3& E = answers.matrix[static_cast<std::size_t>(i)];
          if (detail::is_oriented(E, pairs.a, pairs.b, sample)) out.push_back(E);
        }
      },
      errors, [&](const Mat3& E, std::span<const int> inliers) { return refit(pairs, E, inliers); });
}

// The pairs that a turn explains, by samples of two of E's inliers.
std::optional<detail::Plane> turn(const Seen& pairs, const Found<Mat3>& found, double tolerance_px,
                                  std::uint64_t seed) {
  const std::vector<int> inliers = detail::inlier_indices(found.consensus);
  const std::vector<detail::Lifted> a = detail::subset(pairs.a, inliers),
                                    b = detail::subset(pairs.b, inliers);
  const auto fit = [&](std::span<const int> of) {
    Mat3 moment = Mat3::Zero();
    for (const int i : of) {
      moment += b[static_cast<std::size_t>(i)].v * a[static_cast<std::size_t>(i)].v.transpose();
    }
    return nearest_rotation(moment);
  };
  RansacOptions options;
  options.inlier_px = tolerance_px;
  options.max_hypotheses = 32;  // a turn of half of the inliers is missed once in 10,000
  options.seed = seed;
  const auto best = detail::find_consensus<Mat3>(
      static_cast<int>(a.size()), 2, options,
      [&](std::span<const int> sample, std::vector<Mat3>& out) { out.push_back(fit(sample)); },
      [&](const Mat3& R, int first, std::span<double> e2) {
        for (std::size_t k = 0; k < e2.size(); ++k) {
          const std::size_t i = static_cast<std::size_t>(first) + k;
          e2[k] = detail::homography_sampson_squared(R, a[i], b[i]);
        }
      },
      [&](const Mat3&, std::span<const int> of) -> std::optional<Mat3> {
        if (of.size() < 2) return std::nullopt;
        return fit(of);
      });
  if (!best) return std::nullopt;
  return detail::split_by_homography(best->model, pairs.a, pairs.b, tolerance_px);
}

std::vector<Vec3> rays_of(const std::vector<detail::Lifted>& lifted, std::span<const int> of) {
  std::vector<Vec3> out;
  for (const int i : of) out.push_back(lifted[static_cast<std::size_t>(i)].v);
  return out;
}

// A plane seen twice has two motions. Leaves in `found` the one that sees the points ahead; the error when
// both do.
std::optional<Error> settle_plane(const Seen& pairs, const SampsonErrors& errors, const detail::Plane& plane,
                                  const TwoViewComparison& comparison, const RansacOptions& options,
                                  Found<Mat3>& found) {
  constexpr double kAheadShare = 0.9, kSameRad = 2 * std::numbers::pi / 180;
  const std::vector<Vec3> rays_1 = rays_of(pairs.a, plane.on), rays_2 = rays_of(pairs.b, plane.on);
  std::vector<RelativePose> possible;
  const auto motions = plane_motions(plane.H, Mat3::Identity(), Mat3::Identity());
  if (!motions) return motions.error();
  for (std::size_t k = 0; k < motions->size(); k += 2) {  // the next one is its twin with the same E
    const PlaneMotion& motion = (*motions)[k];
    const Mat3 E = essential_from_pose(SE3(motion.R, motion.t_over_d.normalized()));
    const auto better = refit(pairs, E, plane.on);
    const auto pose = relative_pose_from_essential(better ? *better : E, rays_1, rays_2);
    if (pose && pose->n_in_front >= kAheadShare * static_cast<double>(plane.on.size())) {
      possible.push_back(*pose);
    }
  }
  if (possible.size() == 2) {
    const SE3 &p = possible[0].T_2_1, &q = possible[1].T_2_1;
    const double turned = rotation_angle(p.R() * q.R().transpose()),
                 apart = std::atan2(p.t().cross(q.t()).norm(), p.t().dot(q.t()));
    if (std::max(turned, apart) > kSameRad) {
      return degenerate(
          fmt::format("the scene is a plane, and two motions explain it ({} of {} pairs on it; the two are "
                      "turned by {:.3g} "
                      "degrees, their baselines by {:.3g}); use points off the plane, or plane_motions() and "
                      "what is known "
                      "of its normal",
                      comparison.n - comparison.n_off, comparison.n, turned * 180 / std::numbers::pi,
                      apart * 180 / std::numbers::pi));
    }
  }
  if (possible.size() == 1) {
    const int drawn = found.consensus.n_hypotheses, n = static_cast<int>(pairs.a.size());
    found = {possible[0].E, detail::consensus_of(possible[0].E, n, errors, options.inlier_px)};
    found.consensus.n_hypotheses = drawn;
  }
  return std::nullopt;
}

// Why the pairs do not determine a relative pose, when so.
std::optional<Error> refuse(const Seen& pairs, const SampsonErrors& errors, const RansacOptions& options,
                            Found<Mat3>& found) {
  // A sample has four real answers in the mean.
  if (auto e = detail::refuse_chance(found, pairs.a, pairs.b, pairs.px2, 5,
                                     4.0 * found.consensus.n_hypotheses, "essential matrix", kWhere)) {
    return e;
  }
  const detail::Noise noise = detail::noise_among(found, pairs.a, pairs.b, 5, kRoundingPx);
  const auto n_inliers = static_cast<std::size_t>(found.consensus.n_inliers);
  // A rotation has 2 n - 3 degrees of freedom against n - 5, a plane's homography 2 n - 8.
  if (const auto turned = turn(pairs, found, noise.tolerance_px(n_inliers), options.seed)) {
    TwoViewComparison c = detail::judge(found, *turned, pairs.a, pairs.b, pairs.px2, noise, 2);
    if (c.kind != TwoViewDegeneracy::kNone) {
      c.kind = TwoViewDegeneracy::kPureRotation;
      return degenerate(c.text());
    }
  }
  const auto plane = detail::dominant_plane(found, pairs.a, pairs.b, noise, options.seed);
  if (!plane) return std::nullopt;
  const TwoViewComparison c = detail::judge(found, *plane, pairs.a, pairs.b, pairs.px2, noise, -3);
  if (c.kind == TwoViewDegeneracy::kNone) return std::nullopt;
  return settle_plane(pairs, errors, *plane, c, options, found);
}

}  // namespace

Result<Found<RelativePose>> essential_ransac(const Lens& lens_1, const Lens& lens_2,
                                             std::span<const Vec2> px1, std::span<const Vec2> px2,
                                             const RansacOptions& options) {
  PLUMBLINE_CHECK(px1.size() == px2.size() && px1.size() >= 6,
                  "essential_ransac needs as many pixels in px1 as in px2, 6 or more");
  detail::check_options(options);
  for (std::size_t i = 0; i < px1.size(); ++i) {
    if (!px1[i].allFinite() || !px2[i].allFinite()) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("pair {} has a coordinate that is not a finite number; remove that pair", i),
                   kWhere};
    }
  }
  const Seen pairs = lift_pairs(lens_1, lens_2, px1, px2);
  if (pairs.a.size() < 6) {
    return degenerate(fmt::format(
        "only {} of {} pairs lie in the domains of both lenses, at least 6 are needed; check that "
        "the lenses belong to the images",
        pairs.a.size(), px1.size()));
  }
  const SampsonErrors errors(pairs);
  std::optional<Found<Mat3>> found = search(pairs, errors, options);
  if (!found) {
    return degenerate(
        "the camera only turned, or pairs coincide: no sample of five pairs determines an essential matrix; "
        "move the camera between the views");
  }
  if (auto e = refuse(pairs, errors, options, *found)) return *e;
  const std::vector<int> inliers = detail::inlier_indices(found->consensus);
  auto pose =
      relative_pose_from_essential(found->model, rays_of(pairs.a, inliers), rays_of(pairs.b, inliers));
  if (!pose) return pose.error();
  Found<RelativePose> out{std::move(*pose), {}};
  const std::vector<bool> ahead = std::exchange(out.model.in_front, std::vector<bool>(px1.size(), false));
  for (std::size_t k = 0; k < inliers.size(); ++k) {
    out.model.in_front[pairs.index[static_cast<std::size_t>(inliers[k])]] = ahead[k];
  }
  out.consensus = found->consensus;
  out.consensus.inlier.assign(px1.size(), false);
  for (const int i : inliers) out.consensus.inlier[pairs.index[static_cast<std::size_t>(i)]] = true;
  return out;
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <utility>

#include "linear/consensus.hpp"
#include "linear/degeneracy.hpp"
#include "linear/dlt.hpp"
#include "linear/minimal.hpp"
#include "linear/pixel_pairs.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/fundamental.hpp"

namespace plumbline {
namespace {

constexpr const char* kWhere = "fundamental_ransac";

// Sampson distances of many pairs: coordinates apart, so that the loop is one of vectors.
class SampsonErrors {
 public:
  explicit SampsonErrors(const detail::PixelPairs& pairs)
      : xy_(static_cast<Eigen::Index>(pairs.a.size()), 4) {
    for (std::size_t i = 0; i < pairs.a.size(); ++i) {
      xy_.row(static_cast<Eigen::Index>(i)) << pairs.a[i].v.head<2>().transpose(),
          pairs.b[i].v.head<2>().transpose();
    }
    scale1_ = std::pow(pairs.normaliser_1.scale, 2), scale2_ = std::pow(pairs.normaliser_2.scale, 2);
  }

  void operator()(const Mat3& F, int first, std::span<double> e2) const {
    constexpr int kBlock = 128;
    using Block = Eigen::Array<double, Eigen::Dynamic, 1, 0, kBlock, 1>;
    for (std::size_t done = 0; done < e2.size(); done += kBlock) {
      const auto n = static_cast<Eigen::Index>(std::min<std::size_t>(kBlock, e2.size() - done));
      const auto at = static_cast<Eigen::Index>(first) + static_cast<Eigen::Index>(done);
      const auto x1 = xy_.col(0).segment(at, n), y1 = xy_.col(1).segment(at, n),
                 x2 = xy_.col(2).segment(at, n), y2 = xy_.col(3).segment(at, n);
      const Block u = F(0, 0) * x1 + F(0, 1) * y1 + F(0, 2), v = F(1, 0) * x1 + F(1, 1) * y1 + F(1, 2);
      const Block p = F(0, 0) * x2 + F(1, 0) * y2 + F(2, 0), q = F(0, 1) * x2 + F(1, 1) * y2 + F(2, 1);
      Eigen::Map<Eigen::ArrayXd>(e2.data() + done, n) =
          (x2 * u + y2 * v + (F(2, 0) * x1 + F(2, 1) * y1 + F(2, 2))).square() /
          (scale2_ * (u.square() + v.square()) + scale1_ * (p.square() + q.square()));
    }
  }

 private:
  Eigen::ArrayXXd xy_;
  double scale1_, scale2_;
};

std::optional<Mat3> refit(const detail::PixelPairs& pairs, std::span<const int> inliers) {
  if (inliers.size() < 8) return std::nullopt;
  return detail::with_rank_2(detail::eight_point(pairs.a, pairs.b, inliers).F);
}

std::optional<Found<Mat3>> search(const detail::PixelPairs& pairs, const SampsonErrors& errors,
                                  const RansacOptions& options) {
  return detail::find_consensus<Mat3>(
      static_cast<int>(pairs.a.size()), 7, options,
      [&](std::span<const int> sample, std::vector<Mat3>& out) {
        std::array<Vec3, 7> a, b;
        for (std::size_t i = 0; i < 7; ++i) {
          a[i] = pairs.a[static_cast<std::size_t>(sample[i])].v;
          b[i] = pairs.b[static_cast<std::size_t>(sample[i])].v;
        }
        const detail::Answers<3> answers = detail::seven_point(a, b);
        if (!(answers.determinacy > detail::kRankTolerance)) return;
        for (int i = 0; i < answers.n; ++i) {
          const Mat3& F = answers.matrix[static_cast<std::size_t>(i)];
          if (detail::is_oriented(F, pairs.a, pairs.b, sample)) out.push_back(F);
        }
      },
      errors, [&](const Mat3&, std::span<const int> inliers) { return refit(pairs, inliers); });
}

// The best F = [e2]_x H: two pairs off the plane fix e2, where the lines from H a to b meet.
std::optional<Mat3> plane_and_parallax(const detail::PixelPairs& pairs, const detail::Plane& plane,
                                       const RansacOptions& options) {
  if (plane.off.size() < 2) return std::nullopt;
  const auto line = [&](int k) -> Vec3 {
    const auto i = static_cast<std::size_t>(plane.off[static_cast<std::size_t>(k)]);
    return (plane.H * pairs.a[i].v).cross(pairs.b[i].v);
  };
  const auto best = detail::find_consensus<Mat3>(
      static_cast<int>(plane.off.size()), 2, options,
      [&](std::span<const int> sample, std::vector<Mat3>& out) {
        const Vec3 e2 = line(sample[0]).normalized().cross(line(sample[1]).normalized());
        if (e2.norm() > detail::kRankTolerance) out.push_back((skew(e2) * plane.H).normalized());
      },
      [&](const Mat3& F, int first, std::span<double> e2) {
        for (std::size_t k = 0; k < e2.size(); ++k) {
          const auto i = static_cast<std::size_t>(plane.off[static_cast<std::size_t>(first) + k]);
          e2[k] = detail::sampson_squared(F, pairs.a[i], pairs.b[i]);
        }
      },
      [](const Mat3&, std::span<const int>) { return std::optional<Mat3>(); });
  if (!best) return std::nullopt;
  return best->model;
}

// The better of F and the best F that holds the plane, refitted to its inliers.
void complete(const detail::PixelPairs& pairs, const SampsonErrors& errors, const detail::Plane& plane,
              const RansacOptions& options, Found<Mat3>& found) {
  constexpr double kNoBound = std::numeric_limits<double>::infinity();
  const int n = static_cast<int>(pairs.a.size());
  const auto score = [&](const Mat3& F) {
    return detail::score_of(F, n, errors, options.inlier_px, kNoBound);
  };
  std::optional<Mat3> F = plane_and_parallax(pairs, plane, options);
  double best = score(found.model);
  for (int k = 0; F && k < 5; ++k) {
    const double s = score(*F);
    const Consensus c = detail::consensus_of(*F, n, errors, options.inlier_px);
    if (s < best) {
      const int drawn = found.consensus.n_hypotheses;
      found = {*F, c};
      found.consensus.n_hypotheses = drawn;
      best = s;
    } else if (k > 0) {
      break;
    }
    F = refit(pairs, detail::inlier_indices(c));
  }
}

}  // namespace

Result<Found<Mat3>> fundamental_ransac(std::span<const Vec2> px1, std::span<const Vec2> px2,
                                       const RansacOptions& options) {
  PLUMBLINE_CHECK(px1.size() == px2.size() && px1.size() >= 8,
                  "fundamental_ransac needs as many pixels in px1 as in px2, 8 or more");
  detail::check_options(options);
  if (const auto e = detail::refuse_pixels(px1, px2, kWhere)) return *e;
  const detail::PixelPairs pairs(px1, px2);
  const SampsonErrors errors(pairs);
  std::optional<Found<Mat3>> found = search(pairs, errors, options);
  const auto is_turn = [&](const Mat3& H, std::span<const int> on) {
    return detail::is_turn(H, pairs.a, pairs.b, on, pairs.T_common_1(), pairs.T_common_2());
  };
  if (!found) {
    const TwoViewComparison c = detail::compare(detail::eight_point(pairs.a, pairs.b).F, pairs.a, pairs.b,
                                                pairs.rounding_px(), is_turn);
    if (c.kind != TwoViewDegeneracy::kNone) return Error{ErrorCode::kDegenerate, c.text(), kWhere};
    return Error{ErrorCode::kDegenerate,
                 "no sample of seven pairs determines a fundamental matrix; use points at different depths",
                 kWhere};
  }
  // Each sample has up to three answers.
  if (auto e = detail::refuse_chance(*found, pairs.a, pairs.b, px2, 7, 3.0 * found->consensus.n_hypotheses,
                                     "fundamental matrix", kWhere)) {
    return *e;
  }
  const auto noise = [&] { return detail::noise_among(*found, pairs.a, pairs.b, 7, pairs.rounding_px()); };
  if (const auto plane = detail::dominant_plane(*found, pairs.a, pairs.b, noise(), options.seed)) {
    complete(pairs, errors, *plane, options, *found);
    const detail::Noise n = noise();
    TwoViewComparison c = detail::judge(*found, *plane, pairs.a, pairs.b, px2, n, -1);
    if (c.kind != TwoViewDegeneracy::kNone) {
      if (is_turn(plane->H, plane->on)) c.kind = TwoViewDegeneracy::kPureRotation;
      return Error{ErrorCode::kDegenerate, c.text(), kWhere};
    }
  }
  found->model = pairs.denormalised(found->model);
  return std::move(*found);
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// White box: the search behind every *_ransac, on lines y = a x + b, whose answer anyone can check.
#include "plumbline/linear/ransac.hpp"

#include <gtest/gtest.h>

#include <set>

#include "linear/consensus.hpp"
#include "plumbline/core/types.hpp"

namespace plumbline::test {
namespace {

struct Line {
  double a, b;
};

struct Points {
  std::vector<Vec2> p;
  std::vector<bool> on_line;
};

Points points(Rng& rng, int n, double outlier_share, double noise, const Line& truth) {
  Points s;
  for (int i = 0; i < n; ++i) {
    const bool outlier = rng.uniform() < outlier_share;
    const double x = rng.uniform(-100, 100);
    s.p.emplace_back(x, outlier ? rng.uniform(-300, 300) : truth.a * x + truth.b + rng.normal(noise));
    s.on_line.push_back(!outlier);
  }
  return s;
}

std::optional<Found<Line>> find_line(const std::vector<Vec2>& p, const RansacOptions& options) {
  return detail::find_consensus<Line>(
      static_cast<int>(p.size()), 2, options,
      [&](std::span<const int> s, std::vector<Line>& out) {
        const Vec2 d = p[s[1]] - p[s[0]];
        if (d.x() != 0) out.push_back({d.y() / d.x(), p[s[0]].y() - d.y() / d.x() * p[s[0]].x()});
      },
      [&](const Line& l, int first, std::span<double> e2) {
        for (std::size_t i = 0; i < e2.size(); ++i) {
          const Vec2& q = p[first + i];
          e2[i] = std::pow(q.y() - l.a * q.x() - l.b, 2);
        }
      },
      [&](const Line&, std::span<const int> inliers) -> std::optional<Line> {
        if (inliers.size() < 2) return std::nullopt;
        double sx = 0, sy = 0, sxx = 0, sxy = 0, n = static_cast<double>(inliers.size());
        for (int i : inliers)
          sx += p[i].x(), sy += p[i].y(), sxx += p[i].x() * p[i].x(), sxy += p[i].x() * p[i].y();
        const double a = (n * sxy - sx * sy) / (n * sxx - sx * sx);
        return Line{a, (sy - a * sx) / n};
      });
}

TEST(Ransac, FindsTheLineAmongHalfOutliers) {
  Rng rng(1);
  for (int k = 0; k < 200; ++k) {
    const Line truth{rng.uniform(-1, 1), rng.uniform(-50, 50)};
    const Points s = points(rng, 100, 0.5, 0.3, truth);
    RansacOptions options;
    options.seed = static_cast<std::uint64_t>(k);
    const auto found = find_line(s.p, options);
    ASSERT_TRUE(found);
    // 50 inliers of 0.3 px over +-58: sigma of b 0.045, of a 0.0008; five of them.
    EXPECT_NEAR(found->model.b, truth.b, 0.25);
    EXPECT_NEAR(found->model.a, truth.a, 0.005);
    EXPECT_NEAR(found->consensus.rms_px, 0.3,
                0.15);  // a far outlier within 2 px may join: chance 1 in 150 each
    for (std::size_t i = 0; i < s.p.size(); ++i) {
      if (s.on_line[i]) EXPECT_TRUE(found->consensus.inlier[i]);  // 2 px are 6 sigma
    }
  }
}

TEST(Ransac, TheThreadsDoNotMatter) {
  Rng rng(2);
  const Points s = points(rng, 300, 0.7, 0.5, {0.3, 10});
  RansacOptions options{.confidence = 0.999999999, .seed = 7};
  const auto one = find_line(s.p, options);
  for (int n_threads : {2, 3, 8, 0}) {
    options.n_threads = n_threads;
    const auto other = find_line(s.p, options);
    EXPECT_EQ(one->model.a, other->model.a);
    EXPECT_EQ(one->model.b, other->model.b);
    EXPECT_EQ(one->consensus.inlier, other->consensus.inlier);
    EXPECT_EQ(one->consensus.n_hypotheses, other->consensus.n_hypotheses);
  }
}

TEST(Ransac, StopsAsSoonAsTheConfidenceIsReached) {
  Rng rng(3);
  const auto clean = find_line(points(rng, 100, 0, 0.1, {1, 2}).p, {});
  EXPECT_EQ(clean->consensus.n_hypotheses, 16);  // one round
  EXPECT_EQ(clean->consensus.n_inliers, 100);
  const auto hard = find_line(points(rng, 100, 0.9, 0.1, {1, 2}).p, {});
  // log(1e-4) / log(1 - 0.01) = 916, and outliers that are inliers by chance shorten it.
  EXPECT_GT(hard->consensus.n_hypotheses, 400);
  EXPECT_LT(hard->consensus.n_hypotheses, 3000);
}

TEST(Ransac, HypothesesNeeded) {
  EXPECT_EQ(detail::hypotheses_needed(50, 100, 2, 0.99, 1000),
            17);  // log(.01) / log(1 - 50*49/100/99) = 16.3
  EXPECT_EQ(detail::hypotheses_needed(100, 100, 7, 0.99, 1000), 1);
  EXPECT_EQ(detail::hypotheses_needed(3, 100, 4, 0.99, 1000), 1000);
}

TEST(Ransac, SamplesAreDistinctAndDiffer) {
  std::set<std::vector<int>> seen;
  for (int h = 0; h < 1000; ++h) {
    std::vector<int> s(5);
    detail::draw_sample(9, h, 20, s);
    EXPECT_EQ(std::set<int>(s.begin(), s.end()).size(), 5u);
    seen.insert(s);
  }
  EXPECT_GT(seen.size(), 990u);  // of 20*19*18*17*16 ordered samples
}

TEST(Ransac, RefusesOptionsOutOfRange) {
  EXPECT_THROW(find_line({{0, 0}, {1, 1}}, {.inlier_px = 0}), std::invalid_argument);
  EXPECT_THROW(find_line({{0, 0}, {1, 1}}, {.confidence = 1}), std::invalid_argument);
  EXPECT_THROW(find_line({{0, 0}, {1, 1}}, {.max_hypotheses = 0}), std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test

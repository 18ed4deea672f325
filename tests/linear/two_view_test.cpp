// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/two_view.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <type_traits>

#include "linear/scenes.hpp"
#include "plumbline/core/linalg.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

// No reconstruction becomes another by itself, nor its points or poses.
template <class To, class From>
constexpr bool kNeverFrom = !std::is_convertible_v<From, To> && !std::is_constructible_v<To, From> &&
                            !std::is_assignable_v<To&, From>;
static_assert(kNeverFrom<MetricReconstruction, UpToScaleReconstruction>);
static_assert(kNeverFrom<MetricReconstruction, ProjectiveReconstruction>);
static_assert(kNeverFrom<UpToScaleReconstruction, ProjectiveReconstruction>);
static_assert(kNeverFrom<UpToScaleReconstruction, MetricReconstruction>);
static_assert(kNeverFrom<ProjectiveReconstruction, UpToScaleReconstruction>);
static_assert(kNeverFrom<ProjectiveReconstruction, MetricReconstruction>);
static_assert(kNeverFrom<Result<MetricReconstruction>, UpToScaleReconstruction>);
// What each kind of knowledge gives is decided by its type.
template <class Known>
using GivenBy = decltype(reconstruct(std::declval<const Known&>(), std::span<const Vec2>(),
                                     std::span<const Vec2>(), TwoViewOptions()));
static_assert(std::is_same_v<GivenBy<NothingKnown>, Result<ProjectiveReconstruction>>);
static_assert(std::is_same_v<GivenBy<KnownLenses>, Result<UpToScaleReconstruction>>);
static_assert(std::is_same_v<GivenBy<KnownLensesAndBaseline>, Result<MetricReconstruction>>);
static_assert(std::is_same_v<GivenBy<KnownRig>, Result<MetricReconstruction>>);
static_assert(std::is_same_v<GivenBy<TwoViewKnowledge>, Result<TwoViewReconstruction>>);

Lens lens_of(std::string_view name, std::vector<double> k) { return make_lens(name, k).value(); }

struct Scene {
  Lens lens_1, lens_2;
  SE3 T_2_1;
  std::vector<Vec3> p_1;
  std::vector<Vec2> px1, px2;
};

// n points 2 to 6 m away, a baseline of 0.7 m; the first n_wrong pairs do not belong together.
Scene random_scene(Rng& rng, bool distorted, int n, int n_wrong, double sigma_px) {
  Scene s;
  s.lens_1 = distorted ? lens_of("opencv5", {520, 530, 315, 243, -0.28, 0.1, 1e-3, -5e-4, -0.01})
                       : lens_of("pinhole", {700, 710, 315, 243});
  s.lens_2 = distorted ? lens_of("kb4", {300, 301, 319, 241, -0.012, 0.004, -0.0015, 2e-4})
                       : lens_of("pinhole", {650, 655, 325, 238});
  s.T_2_1 = SE3(so3_exp(0.15 * random_direction(rng)), 0.7 * Vec3(-1, 0.2, 0.1).normalized());
  while (static_cast<int>(s.p_1.size()) < n) {
    const Vec3 p = rng.uniform(2, 6) * Vec3(rng.uniform(-0.4, 0.4), rng.uniform(-0.3, 0.3), 1);
    auto px1 = project(s.lens_1, p), px2 = project(s.lens_2, s.T_2_1 * p);
    if (!px1 || !px2) continue;
    *px1 += sigma_px * Vec2(rng.normal(), rng.normal());
    *px2 += sigma_px * Vec2(rng.normal(), rng.normal());
    if (static_cast<int>(s.p_1.size()) < n_wrong) px2 = Vec2(px2->x(), px2->y() + rng.uniform(30, 100));
    s.p_1.push_back(p);
    s.px1.push_back(*px1);
    s.px2.push_back(*px2);
  }
  return s;
}

TEST(TwoView, AKnownRigGivesMetres) {
  Rng rng(1);
  const Scene s = random_scene(rng, true, 80, 16, 0.2);
  const auto r = reconstruct(KnownRig{s.lens_1, s.lens_2, s.T_2_1}, s.px1, s.px2, {}).value();
  EXPECT_EQ(r.T_2_1, s.T_2_1);
  ASSERT_EQ(r.p_1_m.size(), 80u);
  for (std::size_t i = 0; i < 80; ++i) {
    ASSERT_EQ(r.p_1_m[i].has_value(), i >= 16) << i;
    // depth^2 / (baseline x 300 px) x 0.3 px: 5 cm at 6 m; five of its sigmas
    if (i >= 16) EXPECT_LT((*r.p_1_m[i] - s.p_1[i]).norm(), 0.25) << i;
  }
}

TEST(TwoView, KnownLensesGiveAllButTheScale) {
  Rng rng(2);
  for (int trial = 0; trial < 5; ++trial) {
    const Scene s = random_scene(rng, true, 80, 16, 0);
    const auto r = reconstruct(KnownLenses{s.lens_1, s.lens_2}, s.px1, s.px2, {}).value();
    EXPECT_NEAR(r.t_2_1_baselines.norm(), 1, 1e-12);
    EXPECT_LT((r.R_2_1 - s.T_2_1.R()).norm(), 1e-7);
    for (std::size_t i = 0; i < 80; ++i) {
      ASSERT_EQ(r.p_1_baselines[i].has_value(), i >= 16);
      if (i >= 16) EXPECT_LT((0.7 * *r.p_1_baselines[i] - s.p_1[i]).norm(), 1e-5) << i;
    }
    // The ambiguity is real: a world three times as large has the same pixels.
    for (std::size_t i = 16; i < 80; ++i) {
      const SE3 large(s.T_2_1.R(), 3 * s.T_2_1.t());
      EXPECT_LT((*project(s.lens_2, large * (3 * s.p_1[i])) - s.px2[i]).norm(), 1e-9);
    }
    const auto metric = with_baseline(r, 0.7);
    EXPECT_LT(box_minus(metric.T_2_1, s.T_2_1).norm(), 1e-6);
    EXPECT_LT((*metric.p_1_m[20] - s.p_1[20]).norm(), 1e-5);
    const auto known = reconstruct(KnownLensesAndBaseline{s.lens_1, s.lens_2, 0.7}, s.px1, s.px2, {}).value();
    EXPECT_EQ(known.T_2_1, metric.T_2_1);
    EXPECT_EQ(known.p_1_m, metric.p_1_m);
  }
}

// The 4x4 matrix G with X_i ~ G Y_i: from the equations that all 2x2 minors of [X, G Y] vanish.
Mat4 homography_of_space(const std::vector<Vec4>& Y, const std::vector<Vec4>& X) {
  MatX A = MatX::Zero(6 * static_cast<Eigen::Index>(X.size()), 16);
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < X.size(); ++i) {
    for (int a = 0; a < 4; ++a) {
      for (int b = a + 1; b < 4; ++b, ++row) {
        for (int c = 0; c < 4; ++c) {
          A(row, 4 * b + c) = X[i][a] * Y[i][c];
          A(row, 4 * a + c) = -X[i][b] * Y[i][c];
        }
      }
    }
  }
  const VecX g = null_vector(A).v;
  Mat4 G;
  for (int k = 0; k < 16; ++k) G(k / 4, k % 4) = g[k];
  return G;
}

TEST(TwoView, NothingKnownGivesSpaceUpToAHomography) {
  Rng rng(3);
  for (int trial = 0; trial < 5; ++trial) {
    const Scene s = random_scene(rng, false, 80, 16, 0);
    const auto r = reconstruct(NothingKnown{}, s.px1, s.px2, {}).value();
    std::vector<Vec4> truth, found;
    for (std::size_t i = 0; i < 80; ++i) {
      ASSERT_EQ(r.X[i].has_value(), i >= 16);
      if (i < 16) continue;
      truth.push_back(s.p_1[i].homogeneous());
      found.push_back(*r.X[i]);
    }
    const Mat4 G = homography_of_space(truth, found);
    double worst = 0;
    for (std::size_t i = 0; i < truth.size(); ++i)
      worst = std::max(worst, projective_distance(Vec4(G * truth[i]), found[i]));
    EXPECT_LT(worst, 1e-6);
    EXPECT_LT(projective_distance(Mat34(r.P1_px_X * G), Mat34(camera_matrix_k(s.lens_1) * SE3().matrix34())),
              1e-6);
    EXPECT_LT(
        projective_distance(Mat34(r.P2_px_X * G), Mat34(camera_matrix_k(s.lens_2) * s.T_2_1.matrix34())),
        1e-6);
    // It is no similarity: G moves the plane at infinity far from itself.
    EXPECT_GT(G.row(3).head<3>().norm(), 0.05 * G.row(3).norm());
    for (std::size_t i = 16; i < 80; ++i) {
      EXPECT_LT(((r.P2_px_X * *r.X[i]).hnormalized() - s.px2[i]).norm(), 1e-4);
    }
  }
}

TEST(TwoView, OneFunctionAnswersWhatIsKnown) {
  Rng rng(4);
  const Scene s = random_scene(rng, false, 60, 6, 0.2);
  const auto names = [&](const TwoViewKnowledge& known) {
    return std::string(ambiguity(reconstruct(known, s.px1, s.px2, {}).value()));
  };
  EXPECT_EQ(names(NothingKnown{}), "up to a projective transform");
  EXPECT_EQ(names(KnownLenses{s.lens_1, s.lens_2}), "up to scale");
  EXPECT_EQ(names(KnownLensesAndBaseline{s.lens_1, s.lens_2, 0.7}), "metric");
  EXPECT_EQ(names(KnownRig{s.lens_1, s.lens_2, s.T_2_1}), "metric");
}

TEST(TwoView, RefusesByName) {
  Rng rng(5);
  const Scene s = random_scene(rng, false, 60, 0, 0.2);
  const KnownRig rig{s.lens_1, s.lens_2, s.T_2_1};
  const auto none = reconstruct(rig, {}, {}, {});
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kDegenerate);
  // A rig without a baseline, and swapped views.
  const auto still = reconstruct(KnownRig{s.lens_1, s.lens_2, SE3()}, s.px1, s.px2, {});
  ASSERT_FALSE(still);
  EXPECT_THAT(still.error().message, HasSubstr("none of 60 pairs"));
  EXPECT_THAT(still.error().message, HasSubstr("one place"));
  std::vector<Vec2> flat_1, flat_2, turned;
  const SE3 turn(so3_exp(Vec3(0.05, 0.1, 0)), Vec3::Zero());
  for (const Vec3& p : s.p_1) {
    const Vec3 on_plane(p.x(), p.y(), 4 + 0.3 * p.x());
    flat_1.push_back(*project(s.lens_1, on_plane));
    flat_2.push_back(*project(s.lens_2, s.T_2_1 * on_plane));
    turned.push_back(*project(s.lens_2, turn * p));
  }
  EXPECT_EQ(reconstruct(NothingKnown{}, flat_1, flat_2, {}).error().code, ErrorCode::kDegenerate);
  EXPECT_EQ(reconstruct(KnownLenses{s.lens_1, s.lens_2}, s.px1, turned, {}).error().code,
            ErrorCode::kDegenerate);
  const auto few = [&](const TwoViewKnowledge& known, std::size_t n) {
    return reconstruct(known, std::span(s.px1).first(n), std::span(s.px2).first(n), {}).error().message;
  };
  EXPECT_THAT(few(NothingKnown{}, 7), HasSubstr("7 pairs; the relation of the two views needs 8"));
  EXPECT_THAT(few(KnownLenses{s.lens_1, s.lens_2}, 5), HasSubstr("needs 6"));
  EXPECT_THROW((void)reconstruct(rig, s.px1, {}, {}), std::invalid_argument);
  EXPECT_THROW((void)reconstruct(KnownLensesAndBaseline{s.lens_1, s.lens_2, 0}, s.px1, s.px2, {}),
               std::invalid_argument);
}

}  // namespace
}  // namespace plumbline::test

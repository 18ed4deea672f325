// SPDX-License-Identifier: Apache-2.0
// White box: the sums of the kernel, for each instruction set that this processor has, against the same sums
// made from the cost that Ceres sees, corner by corner.
#include "refine/view_kernel.hpp"

#include <ceres/cost_function.h>
#include <gtest/gtest.h>

#include "plumbline/geometry/so3.hpp"
#include "refine/kernel_sets.hpp"
#include "support/lens_samples.hpp"

namespace plumbline::test {
namespace {

using namespace detail;

// Corners of a board, bowed by bow_m, before the lens, with residuals of some pixels and weights of their
// own.
template <class L>
std::vector<Observation> observations(const L& lens, const SE3& T_cam_board, Rng& rng, int n,
                                      const Vec2& bow_m) {
  std::vector<Observation> list;
  for (const Vec3& p_cam : points_in_domain(lens, rng, 4 * n + 40)) {
    const auto px = lens.project(p_cam);
    // Straight behind a fisheye the rounding of the point itself moves the pixel.
    if (p_cam.z() < -0.99 * p_cam.norm()) continue;
    if (static_cast<int>(list.size()) == n || !px || (*px - Vec2(lens.cx, lens.cy)).norm() > 3000) continue;
    list.push_back(
        {T_cam_board.inverse() * p_cam, *px + Vec2(rng.normal(2), rng.normal(2)), rng.uniform(0.3, 3)});
    if (bow_m.isZero(0)) continue;
    list.back().bow_shape = Vec2(rng.uniform(0, 1), rng.uniform(0, 1));
    list.back().p_board.z() -= bow_m.dot(list.back().bow_shape);
  }
  return list;
}

template <class L>
class ViewKernel : public ::testing::Test {};
TYPED_TEST_SUITE(ViewKernel, LensTypes, LensTypeName);

TYPED_TEST(ViewKernel, SumsWhatCeresCostSays) {
  Rng rng(1);
  for (int trial = 0; trial < 20; ++trial) {
    const TypeParam lens = random_lens<TypeParam>(rng, trial % 2 ? 0.02 : 0.0);
    const SE3 T(so3_exp(Vec3(rng.normal(), rng.normal(), rng.normal())),
                Vec3(rng.normal(), rng.normal(), rng.normal()));
    // One corner, a multiple of the padding, more than a chunk.
    const bool bowed = trial % 4 >= 2;
    const Vec2 bow_m = bowed ? Vec2(0.3, -0.2) : Vec2(0, 0);
    const std::vector<Observation> list = observations(lens, T, rng,
                                                       trial == 0   ? 1
                                                       : trial == 1 ? 64
                                                                    : 150,
                                                       bow_m);
    ASSERT_FALSE(list.empty());
    constexpr int n = TypeParam::kNumParams;
    const int n_all = n + (bowed ? 9 : 7);
    MatX J(2 * list.size(), n_all);
    std::vector<double> r(2 * list.size());
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> J_lens(2 * list.size(), n),
        J_cam(2 * list.size(), 7), J_bow(2 * list.size(), 2);
    const SE3 identity;
    const Lens any = lens;
    const double* blocks[] = {params(any).data(), identity.qt.data(), T.qt.data(), bow_m.data()};
    // With T_cam_rig = identity, a step of the board is a step in the camera's frame.
    double* jacobians[] = {J_lens.data(), nullptr, J_cam.data(), J_bow.data()};
    ASSERT_TRUE(
        make_view_cost(any, list, Loss::kSquared, 1, false, bowed)->Evaluate(blocks, r.data(), jacobians));
    J.leftCols(n + 7) << J_lens, J_cam.leftCols(6),
        Eigen::Map<const VecX>(r.data(), static_cast<Eigen::Index>(r.size()));
    if (bowed) J.rightCols(2) = J_bow;
    const MatX expected = J.transpose() * J;
    const VecX scale = expected.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    std::vector<Observation> lifted = list;
    for (Observation& o : lifted) o.p_board.z() += bow_m.dot(o.bow_shape);
    const ViewCorners corners = view_corners(lifted, bowed);
    const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = T.R();
    const Vec3 t = T.t();
    for (const KernelSet* set : kernel_sets_here()) {
      std::vector<double> lower(static_cast<std::size_t>(n_all * (n_all + 1) / 2)),
          s(static_cast<std::size_t>(corners.n_padded()));
      KernelInput in{{params(any).data(), R.data(), t.data()},
                     {},
                     corners.points->data(),
                     corners.px.data(),
                     corners.n_padded(),
                     0,
                     1};
      if (bowed) in.bow_shape = in.points + 4 * in.n_padded;
      const double cost = set->functions[any.index()](in, lower.data(), s.data(), nullptr).cost;
      EXPECT_NEAR(cost, 0.5 * expected(n + 6, n + 6), 1e-11 * cost)
          << set->name;  // pixels of thousands beside residuals of one
      for (int i = 0; i < n_all; ++i) {
        for (int j = 0; j <= i; ++j) {
          // Rounding of a pixel of some thousands against a residual of one: 1e-12 and the sum of 300.
          EXPECT_NEAR(lower[static_cast<std::size_t>(i * (i + 1) / 2 + j)] * scale[i] * scale[j],
                      expected(i, j) * scale[i] * scale[j], 1e-9)
              << set->name << " " << i << " " << j;
        }
      }
      EXPECT_NEAR(set->functions[any.index()](in, nullptr, nullptr, nullptr).cost, cost, 1e-12 * cost);
    }
  }
}

// A board pose eliminated: L, B L^-T and B B' at the right places, by Eigen's own factorisation.
TEST(ViewKernelFunction, EliminatesABoardPose) {
  Rng rng(5);
  const std::vector<Segment> segments{{2, 5}, {9, 1}, {12, 20}};
  constexpr int kRows = 26, kAll = 40;
  for (const KernelSet* set : kernel_sets_here()) {
    const auto random = [&](Eigen::Index rows, Eigen::Index cols) {
      return MatX(MatX::NullaryExpr(rows, cols, [&] { return rng.normal(); }));
    };
    const MatX root = random(6, 9), before = random(kAll, kAll);
    Mat6 A = root * root.transpose();
    MatX B = random(kRows, 6), S = before;
    const MatX expected = B * A.inverse() * B.transpose();
    const Mat6 A_before = A;
    const MatX B_before = B;
    ASSERT_TRUE(set->eliminate(A.data(), B.data(), kRows));
    for (const auto [first, end] : {std::pair(0, 5), {5, 13}, {13, kAll}})  // in panels that cut segments
      set->add_outer(B.data(), kRows, segments.data(), 3, S.data(), kAll, first, end);
    const MatX L = A.triangularView<Eigen::Lower>();
    EXPECT_LT((L * L.transpose() - A_before).norm(), 1e-13 * A_before.norm()) << set->name;
    EXPECT_LT((B * L.transpose() - B_before).norm(), 1e-12 * B_before.norm()) << set->name;
    std::vector<int> place;
    for (const Segment& s : segments)
      for (int i = 0; i < s.n; ++i) place.push_back(s.first + i);
    MatX change = MatX::Zero(kAll, kAll);
    for (int i = 0; i < kRows; ++i)
      for (int j = 0; j <= i; ++j) change(place[i], place[j]) = expected(i, j);
    EXPECT_LT((S - before - change).norm(), 1e-10 * expected.norm()) << set->name;
    A = -A_before;
    EXPECT_FALSE(set->eliminate(A.data(), B.data(), kRows));
  }
}

// rho and the weights of a loss: gradient of the sum of rho by central differences along the residual.
TEST(ViewKernelFunction, LossesAreThoseOfTheReference) {
  Rng rng(2);
  const OpenCV5 lens{500, 505, 320, 240, {-0.2, 0.05, 1e-3, -1e-3, 0.01}};
  const SE3 T(Mat3::Identity(), Vec3(0, 0, 1));
  std::vector<Observation> list;
  for (int i = 0; i < 100; ++i) {
    const Vec3 p(rng.uniform(-0.4, 0.4), rng.uniform(-0.3, 0.3), rng.uniform(-0.1, 0.1));
    list.push_back({p, *lens.project(T * p) + Vec2(rng.normal(2), rng.normal(2)), rng.uniform(0.3, 3),
                    Vec2(rng.uniform(0, 1), rng.uniform(0, 1))});
  }
  const Vec2 bow_m(0.01, -0.02);
  const ViewCorners corners = view_corners(list, true);
  const Lens any = lens;
  for (const Loss loss : {Loss::kHuber, Loss::kCauchy}) {
    Gram gram;
    const ViewQuestion question{any, T, corners, loss, 1.5, bow_m};
    const double cost = accumulate_view(question, &gram).value();
    double expected = 0;
    for (const Observation& o : list) {
      const Vec3 p = o.p_board + Vec3(0, 0, bow_m.dot(o.bow_shape));
      const Vec2 r = o.weight * (*lens.project(T * p) - o.px);
      expected += 0.5 * rho(loss, 1.5, r.squaredNorm()).value;
    }
    EXPECT_NEAR(cost, expected, 1e-12 * expected);
    EXPECT_NEAR(accumulate_view(question, nullptr).value(), expected, 1e-12 * expected);
    for (int i = 0; i < 8; ++i) {
      const double h = 1e-6;
      ViewQuestion plus = question, minus = question;
      if (i < 6) {
        plus.T_cam_board = box_plus(T, h * Vec6::Unit(i));
        minus.T_cam_board = box_plus(T, -h * Vec6::Unit(i));
      } else {
        plus.bow_m[i - 6] += h;
        minus.bow_m[i - 6] -= h;
      }
      const double slope = (*accumulate_view(plus, nullptr) - *accumulate_view(minus, nullptr)) / (2 * h);
      EXPECT_NEAR(i < 6 ? gram(15, 9 + i) : gram(10 + i, 15), slope,
                  1e-5 * std::abs(slope) + 1e-3);  // h^2, and rounding of the cost over h
    }
  }
}

// The products of one state's derivatives with another's residuals, from the cost that Ceres sees.
TEST(ViewKernelFunction, MixesTwoStates) {
  Rng rng(4);
  const Lens a = OpenCV8{500, 505, 320, 240, {-0.2, 0.05, 1e-3, -1e-3, 0.01, 0.1, 0.02, 0.001}};
  const Lens b = OpenCV8{510, 500, 321, 242, {-0.1, 0.02, 0, 1e-3, 0.02, 0.2, 0.01, 0.002}};
  const SE3 T_a(Mat3::Identity(), Vec3(0, 0, 1)), T_b(so3_exp(Vec3(0.01, 0.02, -0.01)), Vec3(0.02, 0, 1.1)),
      identity;
  std::vector<Observation> list;
  for (int i = 0; i < 100; ++i) {
    const Vec3 p(rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(-0.1, 0.1));
    list.push_back({p, *project(a, T_a * p) + Vec2(rng.normal(), rng.normal()), rng.uniform(0.5, 2),
                    Vec2(rng.uniform(0, 1), rng.uniform(0, 1))});
  }
  for (const bool bowed : {false, true}) {
    const int n = bowed ? 20 : 18;
    const auto evaluate = [&](const Lens& lens, const SE3& T, const Vec2& bow_m, VecX& r, MatX& J) {
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> J_lens(200, 12), J_pose(200, 7),
          J_bow(200, 2);
      const double* blocks[] = {params(lens).data(), identity.qt.data(), T.qt.data(), bow_m.data()};
      double* jacobians[] = {J_lens.data(), nullptr, J_pose.data(), J_bow.data()};
      r.resize(200);
      ASSERT_TRUE(
          make_view_cost(lens, list, Loss::kSquared, 1, false, bowed)->Evaluate(blocks, r.data(), jacobians));
      J.resize(200, n);
      J.leftCols(18) << J_lens, J_pose.leftCols(6);
      if (bowed) J.rightCols(2) = J_bow;
    };
    const Vec2 bow_a(0.02, -0.01), bow_b(-0.01, 0.03);
    VecX r_a, r_b;
    MatX J_a, J_b;
    evaluate(a, T_a, bow_a, r_a, J_a);
    evaluate(b, T_b, bow_b, r_b, J_b);
    const ViewCorners corners = view_corners(list, bowed);
    const auto mixed = accumulate_second({a, T_a, corners, Loss::kSquared, 1, bow_a}, b, T_b, bow_b);
    ASSERT_TRUE(mixed);
    ASSERT_EQ(mixed->size(), n);
    const VecX expected = J_a.transpose() * r_b;
    EXPECT_LT((*mixed - expected).cwiseQuotient(J_a.colwise().norm().transpose()).norm(), 1e-10 * r_b.norm());
  }
}

TEST(ViewKernelFunction, RefusesACornerOutsideTheDomain) {
  const Lens lens = OpenCV5{500, 505, 320, 240, {-0.3, 0, 0, 0, 0}};  // turns back at r = 1.05
  const std::vector<Observation> list{{Vec3(0, 0, 1), Vec2(320, 240), 1},
                                      {Vec3(1.2, 0, 1), Vec2(500, 240), 1}};
  const ViewCorners corners = view_corners(list);
  EXPECT_FALSE(accumulate_view({lens, SE3(), corners}, nullptr));
  const ViewCorners one = view_corners({list[0]});
  EXPECT_TRUE(accumulate_view({lens, SE3(), one}, nullptr));
}

}  // namespace
}  // namespace plumbline::test

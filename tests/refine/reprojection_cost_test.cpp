// SPDX-License-Identifier: Apache-2.0
#include "refine/reprojection_cost.hpp"

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/manifold.h>

#include "refine_support.hpp"

namespace plumbline::test {
namespace {

using detail::make_pose_manifold;
using detail::make_view_cost;
using detail::Observation;

struct Case {
  Lens lens;
  SE3 T_cam_rig{so3_exp(Vec3(0.1, -0.2, 0.05)), Vec3(-0.1, 0.02, 0.01)};
  SE3 T_rig_board{so3_exp(Vec3(0.4, 0.3, -0.2)), Vec3(0.05, -0.08, 0.6)};
  std::vector<Observation> observations;
};

Case make_case(std::string_view name) {
  Case c{example_lens(name), {}, {}, {}};
  c.T_cam_rig = SE3(so3_exp(Vec3(0.1, -0.2, 0.05)), Vec3(-0.1, 0.02, 0.01));
  c.T_rig_board = SE3(so3_exp(Vec3(0.4, 0.3, -0.2)), Vec3(0.05, -0.08, 0.6));
  Rng rng(7);
  for (int i = 0; i < 12; ++i) {
    const Vec3 p(rng.uniform(0, 0.2), rng.uniform(0, 0.15), rng.uniform(0, 0.02));
    const Vec2 px = *project_by_opencv(c.lens, c.T_cam_rig * (c.T_rig_board * p));
    // small errors, and two corners far off
    const double error = i % 6 == 5 ? 20 : 0.4;
    c.observations.push_back({p, px + Vec2(rng.normal(error), rng.normal(error)), rng.uniform(0.5, 2)});
  }
  return c;
}

VecX residuals_of(const Case& c, Loss loss) {
  VecX r(2 * c.observations.size());
  const double* blocks[] = {params(c.lens).data(), c.T_cam_rig.qt.data(), c.T_rig_board.qt.data()};
  EXPECT_TRUE(make_view_cost(c.lens, c.observations, loss, 1.5)->Evaluate(blocks, r.data(), nullptr));
  return r;
}

TEST(ViewCost, JacobianAgreesWithDifferences) {
  for (std::string_view name : fixed_lens_names()) {
    for (Loss loss : {Loss::kSquared, Loss::kHuber, Loss::kCauchy}) {
      const Case c = make_case(name);
      const int n_lens = n_params(c.lens), n = static_cast<int>(2 * c.observations.size());
      using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      Rows J_k(n, n_lens), J_cam(n, 7), J_board(n, 7);
      VecX r(n);
      const double* blocks[] = {params(c.lens).data(), c.T_cam_rig.qt.data(), c.T_rig_board.qt.data()};
      double* jacobians[] = {J_k.data(), J_cam.data(), J_board.data()};
      ASSERT_TRUE(make_view_cost(c.lens, c.observations, loss, 1.5)->Evaluate(blocks, r.data(), jacobians));
      EXPECT_EQ(J_cam.col(6).norm(), 0.0);
      EXPECT_EQ(J_board.col(6).norm(), 0.0);
      // Central differences with steps of 1e-5 (of the focal length for fx, fy): their own error is about
      // 1e-7 of the column's size.
      const auto check = [&](const VecX& analytic, const VecX& plus, const VecX& minus, double step,
                             const std::string& what) {
        const VecX numeric = (plus - minus) / (2 * step);
        EXPECT_LT((analytic - numeric).norm(), 2e-6 * (1 + analytic.norm()))
            << name << " loss " << static_cast<int>(loss) << " " << what;
      };
      for (int i = 0; i < n_lens; ++i) {
        const double step = i < 4 ? 1e-3 : 1e-5;
        Case up = c, down = c;
        params(up.lens)[i] += step;
        params(down.lens)[i] -= step;
        check(J_k.col(i), residuals_of(up, loss), residuals_of(down, loss), step,
              std::string(param_names(c.lens)[i]));
      }
      for (int i = 0; i < 6; ++i) {
        const double step = 1e-6;
        Case up = c, down = c;
        up.T_cam_rig = box_plus(c.T_cam_rig, step * Vec6::Unit(i));
        down.T_cam_rig = box_plus(c.T_cam_rig, -step * Vec6::Unit(i));
        check(J_cam.col(i), residuals_of(up, loss), residuals_of(down, loss), step,
              "T_cam_rig " + std::to_string(i));
        up = c, down = c;
        up.T_rig_board = box_plus(c.T_rig_board, step * Vec6::Unit(i));
        down.T_rig_board = box_plus(c.T_rig_board, -step * Vec6::Unit(i));
        check(J_board.col(i), residuals_of(up, loss), residuals_of(down, loss), step,
              "T_rig_board " + std::to_string(i));
      }
    }
  }
}

TEST(ViewCost, HalfTheSquaresIsHalfTheSumOfRho) {
  const Case c = make_case("opencv5");
  const VecX plain = residuals_of(c, Loss::kSquared);
  const ceres::HuberLoss huber(1.5);
  const ceres::CauchyLoss cauchy(1.5);
  double sum_huber = 0, sum_cauchy = 0;
  for (Eigen::Index i = 0; i < plain.size(); i += 2) {
    double rho[3];
    huber.Evaluate(plain.segment<2>(i).squaredNorm(), rho);
    sum_huber += rho[0];
    cauchy.Evaluate(plain.segment<2>(i).squaredNorm(), rho);
    sum_cauchy += rho[0];
  }
  EXPECT_NEAR(residuals_of(c, Loss::kHuber).squaredNorm(), sum_huber, 1e-12 * sum_huber);
  EXPECT_NEAR(residuals_of(c, Loss::kCauchy).squaredNorm(), sum_cauchy, 1e-12 * sum_cauchy);
  EXPECT_LT(sum_huber, 0.5 * plain.squaredNorm());  // the two bad corners do matter here
}

TEST(ViewCost, ResidualIsWeightTimesProjectionMinusMeasured) {
  Case c = make_case("opencv8");
  const VecX r = residuals_of(c, Loss::kSquared);
  for (std::size_t i = 0; i < c.observations.size(); ++i) {
    const Observation& o = c.observations[i];
    const Vec2 px = *project_by_opencv(c.lens, c.T_cam_rig * (c.T_rig_board * o.p_board));
    EXPECT_LT((r.segment<2>(2 * static_cast<Eigen::Index>(i)) - o.weight * (px - o.px)).norm(), 1e-10);
  }
}

TEST(ViewCost, ACornerOutsideTheDomainRejectsTheEvaluation) {
  Case c = make_case("opencv5");
  c.T_rig_board = SE3(c.T_rig_board.R(), Vec3(0, 0, -0.6));  // behind the camera
  VecX r(2 * c.observations.size());
  const double* blocks[] = {params(c.lens).data(), c.T_cam_rig.qt.data(), c.T_rig_board.qt.data()};
  EXPECT_FALSE(
      make_view_cost(c.lens, c.observations, Loss::kSquared, 1)->Evaluate(blocks, r.data(), nullptr));
}

TEST(PoseManifold, PlusIsBoxPlus) {
  const auto manifold = make_pose_manifold();
  const SE3 T(so3_exp(Vec3(0.3, -2.0, 0.4)), Vec3(1, 2, 3));
  const Vec6 d = (Vec6() << 0.1, -0.2, 0.3, 0.5, -0.6, 0.7).finished();
  SE3 stepped;
  ASSERT_EQ(manifold->TangentSize(), 6);
  ASSERT_TRUE(manifold->Plus(T.qt.data(), d.data(), stepped.qt.data()));
  EXPECT_LT(box_minus(stepped, box_plus(T, d)).norm(), 1e-14);
  Vec6 back;
  ASSERT_TRUE(manifold->Minus(stepped.qt.data(), T.qt.data(), back.data()));
  EXPECT_LT((back - d).norm(), 1e-13);
}

TEST(PoseManifold, HeldComponentsOfTheRotationVectorStay) {
  const auto manifold = make_pose_manifold({true, false, false, false, true, false});
  const Vec3 w(0.7, -0.4, 0.9);
  const SE3 T(so3_exp(w), Vec3(1, 2, 3));
  ASSERT_EQ(manifold->TangentSize(), 4);
  const double d[] = {0.2, -0.3, 0.05, 0.06};
  SE3 stepped;
  ASSERT_TRUE(manifold->Plus(T.qt.data(), d, stepped.qt.data()));
  EXPECT_LT((so3_log(stepped.R()) - Vec3(0.7, -0.4 + 0.2, 0.9 - 0.3)).norm(), 1e-13);
  EXPECT_LT((stepped.t() - Vec3(1.05, 2, 3.06)).norm(), 1e-15);
  // PlusJacobian maps a small step onto [dw | dt] of box_plus, to first order.
  Eigen::Matrix<double, 7, 4, Eigen::RowMajor> J;
  ASSERT_TRUE(manifold->PlusJacobian(T.qt.data(), J.data()));
  for (int i = 0; i < 4; ++i) {
    Vec4 small = 1e-6 * Vec4::Unit(i);
    ASSERT_TRUE(manifold->Plus(T.qt.data(), small.data(), stepped.qt.data()));
    EXPECT_LT((box_minus(stepped, T) / 1e-6 - J.col(i).head<6>()).norm(), 1e-5) << i;
  }
}

}  // namespace
}  // namespace plumbline::test

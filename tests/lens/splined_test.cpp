// SPDX-License-Identifier: Apache-2.0
// mrcal as the referee of its own lens, and what every lens must do besides.
#include "plumbline/lens/splined.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/lens_samples.hpp"

extern "C" {
#include <mrcal/mrcal.h>
}

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

struct Shape {
  int order, n_x, n_y, fov_x_deg;
};
const std::vector<Shape> kShapes{{3, 30, 20, 170}, {2, 30, 20, 170}, {3, 11, 8, 60},
                                 {2, 8, 11, 60},   {3, 14, 14, 250}, {2, 4, 3, 100}};

// A smooth correction (a polynomial's values) and a rough one on top of it.
Splined random_splined(const Shape& shape, Rng& rng, double rough = 0.01) {
  Splined lens(shape.order, shape.n_x, shape.n_y, shape.fov_x_deg);
  lens.k[0] = rng.uniform(300, 2000), lens.k[1] = lens.k[0] * rng.uniform(0.95, 1.05);
  lens.k[2] = rng.uniform(300, 3000), lens.k[3] = rng.uniform(200, 2000);
  const double cell = 1 / lens.knots_per_unit();
  for (int j = 0; j < lens.n_y; ++j) {
    for (int i = 0; i < lens.n_x; ++i) {
      const Vec2 u = lens.knot(i, j), c = 0.02 * (u.squaredNorm() - 1) * u;
      for (int axis = 0; axis < 2; ++axis)
        lens.k[static_cast<std::size_t>(lens.control_point(i, j) + axis)] =
            c[axis] / (1 + u.squaredNorm()) + rng.normal(rough * cell);
    }
  }
  return lens;
}

// Points all over the domain, some close to its border.
std::vector<Vec3> points_in(const Splined& lens, Rng& rng, int n) {
  std::vector<Vec3> points;
  const Vec2 reach = lens.reach();
  for (int i = 0; i < n; ++i) {
    Vec2 u(rng.uniform(-1, 1) * reach.x(), rng.uniform(-1, 1) * reach.y());
    if (i % 10 == 0) u[i / 10 % 2] = (i % 20 == 0 ? 1 : -1) * (1 - 1e-9) * reach[i / 10 % 2];
    const Vec3 p = std::pow(10, rng.uniform(-1, 2)) * ray_of_stereographic(u);
    if (lens.project(p)) points.push_back(p);
  }
  return points;
}

TEST(Splined, PixelsAndJacobiansAreMrcals) {
  Rng rng(1);
  int n_points = 0;
  double worst_px = 0, worst_J = 0;
  for (const Shape& s : kShapes) {
    for (int trial = 0; trial < 5; ++trial) {
      const Splined lens = random_splined(s, rng);
      mrcal_lensmodel_t model;
      const std::string name =
          fmt::format("LENSMODEL_SPLINED_STEREOGRAPHIC_order={}_Nx={}_Ny={}_fov_x_deg={}", s.order, s.n_x,
                      s.n_y, s.fov_x_deg);
      ASSERT_TRUE(mrcal_lensmodel_from_name(&model, name.c_str())) << name;
      const int n = mrcal_lensmodel_num_params(&model);
      ASSERT_EQ(n, static_cast<int>(lens.k.size()));
      for (const Vec3& p : points_in(lens, rng, 150)) {
        const mrcal_point3_t p_mrcal{.xyz = {p.x(), p.y(), p.z()}};
        mrcal_point2_t q;
        mrcal_point3_t dq_dp[2];
        Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> dq_dk(2, n);
        ASSERT_TRUE(mrcal_project(&q, dq_dp, dq_dk.data(), &p_mrcal, 1, &model, lens.k.data()));
        Mat23 J_px_p, truth_p;
        JacLens J_px_k;
        const auto px = project(Lens(lens), p, &J_px_p, &J_px_k);
        ASSERT_TRUE(px);
        truth_p << dq_dp[0].x, dq_dp[0].y, dq_dp[0].z, dq_dp[1].x, dq_dp[1].y, dq_dp[1].z;
        worst_px = std::max(worst_px, (*px - Vec2(q.x, q.y)).norm());
        worst_J = std::max(worst_J, (J_px_p - truth_p).cwiseAbs().maxCoeff() / truth_p.cwiseAbs().maxCoeff());
        // Every column of the control points is f times a weight below 1; fx and fy have m.
        for (int row = 0; row < 2; ++row) {
          const double scale = dq_dk.row(row).cwiseAbs().maxCoeff();
          worst_J = std::max(worst_J, (J_px_k.row(row) - dq_dk.row(row)).cwiseAbs().maxCoeff() / scale);
        }
        ++n_points;
      }
    }
  }
  EXPECT_GT(n_points, 3000);
  EXPECT_LT(worst_px, 1e-9);
  EXPECT_LT(worst_J, 1e-9);
  RecordProperty("worst_px", std::to_string(std::log10(worst_px)));
  RecordProperty("worst_J", std::to_string(std::log10(worst_J)));
}

// The recursion of Cox and de Boor: the B-spline of this order at distance t from its middle.
double b_spline(int order, double t) {
  if (order == 0) return t >= -0.5 && t < 0.5 ? 1 : 0;
  const double h = 0.5 * (order + 1);
  return ((t + h) * b_spline(order - 1, t + 0.5) + (h - t) * b_spline(order - 1, t - 0.5)) / order;
}

TEST(Splined, IsASumOfBSplinesOverStereographicCoordinates) {
  Rng rng(2);
  for (const Shape& s : kShapes) {
    const Splined lens = random_splined(s, rng);
    const double edge_u = 2 * std::tan(s.fov_x_deg * std::numbers::pi / 180 / 4);
    EXPECT_NEAR(lens.reach().x(), edge_u, 1e-12 * edge_u);
    for (const Vec3& p : points_in(lens, rng, 50)) {
      const double theta = std::atan2(p.head<2>().norm(), p.z()), phi = std::atan2(p.y(), p.x());
      const Vec2 u = 2 * std::tan(0.5 * theta) * Vec2(std::cos(phi), std::sin(phi));
      EXPECT_LT((stereographic(p) - u).norm(), 1e-12);
      Vec2 m = u;
      for (int j = 0; j < lens.n_y; ++j) {
        for (int i = 0; i < lens.n_x; ++i) {
          const Vec2 d = (u - lens.knot(i, j)) * lens.knots_per_unit();
          const auto c = static_cast<std::size_t>(lens.control_point(i, j));
          m += b_spline(s.order, d.x()) * b_spline(s.order, d.y()) * Vec2(lens.k[c], lens.k[c + 1]);
        }
      }
      const Vec2 px(lens.k[0] * m.x() + lens.k[2], lens.k[1] * m.y() + lens.k[3]);
      EXPECT_LT((*lens.project(p) - px).norm(), 1e-9);
    }
  }
}

TEST(Splined, UnprojectionIsTheInverse) {
  Rng rng(3);
  for (const Shape& s : kShapes) {
    for (int trial = 0; trial < 5; ++trial) {
      const Lens lens = random_splined(s, rng, 0.05);
      for (const Vec3& p : points_in(std::get<Splined>(lens), rng, 100)) {
        const Vec2 px = project(lens, p).value();
        const auto ray = unproject(lens, px);
        ASSERT_TRUE(ray) << p.transpose();
        EXPECT_NEAR(ray->norm(), 1, 1e-15);
        EXPECT_LT((*project(lens, *ray) - px).norm(), 1e-9);
        EXPECT_LT((*ray - p.normalized()).norm(), 1e-10);  // a pixel error of 1e-10 over f = 300, stretched
      }
    }
  }
}

TEST(Splined, SaysNothingOutsideItsDomain) {
  Rng rng(4);
  const Splined lens = random_splined({3, 30, 20, 170}, rng, 0);
  const Vec2 reach = lens.reach();
  for (const double sign : {-1.0, 1.0}) {
    EXPECT_TRUE(lens.project(ray_of_stereographic(Vec2(sign * (1 - 1e-12) * reach.x(), 0))));
    EXPECT_FALSE(lens.project(ray_of_stereographic(Vec2(sign * (1 + 1e-12) * reach.x(), 0))));
    EXPECT_TRUE(lens.project(ray_of_stereographic(Vec2(0, sign * (1 - 1e-12) * reach.y()))));
    EXPECT_FALSE(lens.project(ray_of_stereographic(Vec2(0, sign * (1 + 1e-12) * reach.y()))));
  }
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const Vec3& p : {Vec3(0, 0, -1), Vec3(0, 0, 0), Vec3(nan, 0, 1), Vec3(0, inf, 1), Vec3(0, 0, inf),
                        Vec3(1e308, 1e308, 1)}) {
    EXPECT_FALSE(lens.project(p)) << p.transpose();
  }
  for (const Vec2& px : {Vec2(nan, 0), Vec2(0, inf), Vec2(1e9, 0), Vec2(-1e9, 1e9)})
    EXPECT_FALSE(unproject(Lens(lens), px)) << px.transpose();
  // Nothing, or a ray that projects there; and where the surface is folded, nothing.
  Splined folded = lens;
  folded.k[static_cast<std::size_t>(folded.control_point(20, 10))] += 1;
  int n_lost = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec2 u(rng.uniform(-1, 1) * reach.x(), rng.uniform(-1, 1) * reach.y());
    Mat23 J;
    const auto px = folded.project(ray_of_stereographic(u), &J);
    n_lost += !px;
    if (!px) continue;
    Mat3 oriented;
    oriented << J, ray_of_stereographic(u).transpose();
    EXPECT_GT(oriented.determinant(), 0) << u.transpose();
    if (const auto ray = unproject(Lens(folded), *px)) {
      EXPECT_LT((*folded.project(*ray) - *px).norm(), 1e-9);
    }
  }
  EXPECT_GT(n_lost, 5);
  EXPECT_LT(n_lost, 100);
  Splined broken = lens;
  broken.k[static_cast<std::size_t>(broken.control_point(14, 10))] = nan;
  EXPECT_FALSE(broken.project(Vec3(0, 0, 1)));
}

TEST(Splined, SparseDerivativesAreTheDenseOnes) {
  Rng rng(5);
  for (const Shape& s : kShapes) {
    const Lens lens = random_splined(s, rng);
    for (const Vec3& p : points_in(std::get<Splined>(lens), rng, 20)) {
      SparseJac sparse;
      JacLens dense;
      Mat23 J_a, J_b;
      EXPECT_EQ(project_sparse(lens, p, &J_a, &sparse), project(lens, p, &J_b, &dense));
      EXPECT_EQ(J_a, J_b);
      EXPECT_EQ(sparse.n, 4 + 2 * (s.order + 1) * (s.order + 1));
      for (int i = 0; i < sparse.n; ++i) {
        EXPECT_EQ(dense.col(sparse.index[i]), sparse.J[i]);
        if (i > 0) {
          EXPECT_LT(sparse.index[i - 1], sparse.index[i]);
        }
        dense.col(sparse.index[i]).setZero();
      }
      EXPECT_TRUE(dense.isZero(0));
    }
  }
  const Lens plain = OpenCV5{500, 501, 320, 240, {-0.2, 0.05, 1e-3, -1e-3, 0.01}};
  SparseJac sparse;
  JacLens dense;
  project(plain, Vec3(0.2, 0.1, 1), nullptr, &dense);
  project_sparse(plain, Vec3(0.2, 0.1, 1), nullptr, &sparse);
  for (int i = 0; i < 9; ++i) EXPECT_EQ(sparse.J[i], dense.col(i));
}

TEST(Splined, IsMadeFromItsSpec) {
  const Lens lens = make_lens("splined:30x20:170", {640, 480}, 300).value();
  EXPECT_EQ(lens_name(lens), "splined");
  EXPECT_EQ(lens_spec(lens), "splined:30x20:170");
  EXPECT_EQ(n_params(lens), 1204);
  EXPECT_TRUE(is_sparse(lens) && holds_core(lens));
  const auto names = param_names(lens);
  EXPECT_EQ(names.size(), 1204u);
  EXPECT_EQ(names[4], "x0_0");
  EXPECT_EQ(names[1203], "y29_19");
  EXPECT_EQ(*project(lens, Vec3(0, 0, 2)), Vec2(319.5, 239.5));
  EXPECT_EQ(lens_spec(make_lens("splined:8x9:60:2", {640, 480}, 300).value()), "splined:8x9:60:2");
  // By default the whole image fits.
  for (const double f : {150.0, 600.0, 3000.0}) {
    const Lens fits = make_lens("splined", {640, 480}, f).value();
    EXPECT_TRUE(unproject(fits, {-0.5, -0.5}) && unproject(fits, {639.5, 479.5})) << lens_spec(fits);
    Rng rng(6);
    for (double& k : params(const_cast<Lens&>(fits)).subspan(4)) k = rng.normal(1e-3);
    const Lens again = make_lens(lens_spec(fits), params(fits)).value();
    EXPECT_EQ(project(again, Vec3(0.1, 0.05, 1)), project(fits, Vec3(0.1, 0.05, 1)));
  }
  const auto error_of = [](const std::string& spec) {
    const auto made = make_lens(spec, {640, 480}, 300);
    return made ? "" : made.error().text();
  };
  EXPECT_THAT(error_of("splined:30x20"), HasSubstr("NXxNY:FOV_X_DEG[:ORDER] is needed"));
  EXPECT_THAT(error_of("splined:30x20:170:4"), HasSubstr("order 4 is neither 2 nor 3"));
  EXPECT_THAT(error_of("splined:3x20:170"), HasSubstr("3x20 knots: 4 to 500 each way"));
  EXPECT_THAT(error_of("splined:30x20:360"), HasSubstr("360 degrees"));
  EXPECT_THAT(error_of("splined:a:170"), HasSubstr("not understood"));
  EXPECT_THAT(error_of("kb4:3"), HasSubstr("lens kb4 has no options"));
  EXPECT_THAT(make_lens("splined:30x20:170", std::vector<double>(10, 1.0)).error().text(),
              HasSubstr("has 1204 parameters, 10 are given"));
}

}  // namespace
}  // namespace plumbline::test

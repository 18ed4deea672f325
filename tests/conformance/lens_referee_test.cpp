// SPDX-License-Identifier: Apache-2.0
// OpenCV and mrcal as referees, for the lenses that they have too. Only here lenses are matched with foreign
// names.
#include <gtest/gtest.h>

#include <functional>
#include <opencv2/calib3d.hpp>
#include <opencv2/ccalib/omnidir.hpp>
#include <tuple>
#include <utility>

#include "support/lens_samples.hpp"

extern "C" {
#include <mrcal/mrcal.h>
}

namespace plumbline {
namespace {

using namespace test;

constexpr double kPx = 1e-9;  // what the referees may differ by [px]

constexpr const char* mrcal_name(std::string_view name) {
  if (name == "pinhole") return "LENSMODEL_PINHOLE";
  if (name == "opencv4") return "LENSMODEL_OPENCV4";
  if (name == "opencv5") return "LENSMODEL_OPENCV5";
  if (name == "opencv8") return "LENSMODEL_OPENCV8";
  if (name == "opencv12") return "LENSMODEL_OPENCV12";
  return nullptr;
}
constexpr bool opencv_has(std::string_view name) { return name == "kb4" || mrcal_name(name); }

// The lenses that a referee has too.
template <bool kHas, class L>
using Only = std::conditional_t<kHas, std::tuple<L>, std::tuple<>>;
template <class... L>
auto mrcals(std::variant<L...>*)
    -> decltype(test::types_of(std::tuple_cat(std::declval<Only<mrcal_name(L::kName) != nullptr, L>>()...)));
template <class... L>
auto opencvs(std::variant<L...>*)
    -> decltype(test::types_of(std::tuple_cat(std::declval<Only<opencv_has(L::kName), L>>()...)));

// Lenses as strong as glass is, and points that fall within a few image widths: further out a pixel has no
// 1e-9.
template <class L>
struct Case {
  L lens;
  std::vector<Vec3> points;
};

template <class L>
std::vector<Case<L>> cases(double widest_deg) {
  std::vector<Case<L>> all;
  Rng rng(11);
  for (int i = 0; i < 60; ++i) {
    Case<L> c{random_lens<L>(rng, i % 3 == 0 ? 0.0 : i % 3 == 1 ? 0.02 : 0.2), {}};
    for (const Vec3& p : points_in_domain(c.lens, rng, 120)) {
      const double theta_deg = std::atan2(p.head<2>().norm(), p.z()) * 180 / std::numbers::pi;
      if (theta_deg < widest_deg && c.lens.project(p)->norm() < 5000) c.points.push_back(p);
    }
    if (c.points.size() > 10) all.push_back(c);
  }
  return all;
}

template <class L>
class MrcalReferee : public ::testing::Test {};
TYPED_TEST_SUITE(MrcalReferee, decltype(mrcals(static_cast<Lens*>(nullptr))), LensTypeName);

template <class L>
class OpenCvReferee : public ::testing::Test {};
TYPED_TEST_SUITE(OpenCvReferee, decltype(opencvs(static_cast<Lens*>(nullptr))), LensTypeName);

// Largest difference of a Jacobian entry, relative to its column's largest entry or 1.
double column_error(const Eigen::Ref<const MatX>& J, const Eigen::Ref<const MatX>& truth) {
  double worst = 0;
  for (int i = 0; i < J.cols(); ++i) {
    worst = std::max(worst, (J.col(i) - truth.col(i)).cwiseAbs().maxCoeff() /
                                std::max(1.0, truth.col(i).cwiseAbs().maxCoeff()));
  }
  return worst;
}

TYPED_TEST(MrcalReferee, PixelsAndJacobians) {
  mrcal_lensmodel_t model;
  ASSERT_TRUE(mrcal_lensmodel_from_name(&model, mrcal_name(TypeParam::kName)));
  ASSERT_EQ(mrcal_lensmodel_num_params(&model), TypeParam::kNumParams);
  int n_points = 0;
  for (const auto& [lens, points] : cases<TypeParam>(89)) {
    for (const Vec3& p : points) {
      const mrcal_point3_t p_mrcal{.xyz = {p.x(), p.y(), p.z()}};
      mrcal_point2_t q;
      mrcal_point3_t dq_dp[2];
      Eigen::Matrix<double, 2, TypeParam::kNumParams, Eigen::RowMajor> dq_dk;
      ASSERT_TRUE(mrcal_project(&q, dq_dp, dq_dk.data(), &p_mrcal, 1, &model, &lens.fx));
      Mat23 J_px_p, truth_p;
      JacParams<TypeParam> J_px_k;
      const Vec2 px = lens.project(p, &J_px_p, &J_px_k).value();
      truth_p << dq_dp[0].x, dq_dp[0].y, dq_dp[0].z, dq_dp[1].x, dq_dp[1].y, dq_dp[1].z;
      EXPECT_LT((px - Vec2(q.x, q.y)).norm(), kPx);
      EXPECT_LT((J_px_p - truth_p).cwiseAbs().maxCoeff() / std::max(1.0, truth_p.cwiseAbs().maxCoeff()), kPx);
      EXPECT_LT(column_error(J_px_k, dq_dk), kPx) << "\n" << J_px_k << "\n\n" << dq_dk;
      ++n_points;
    }
  }
  EXPECT_GT(n_points, 3000);
}

// cv::projectPoints' Jacobian: rotation vector (3), translation (3), focal lengths (2), centre (2),
// distortion. With no rotation d px / d translation is our J_px_p; our parameters are its columns from 6 on.
TYPED_TEST(OpenCvReferee, PixelsAndJacobians) {
  const bool fisheye = TypeParam::kName == "kb4";
  int n_points = 0;
  // cv::fisheye::projectPoints is wrong from 90 degrees on.
  for (const auto& [lens, points] : cases<TypeParam>(89)) {
    std::vector<cv::Point3d> p_cv;
    for (const Vec3& p : points) p_cv.emplace_back(p.x(), p.y(), p.z());
    const cv::Matx33d K(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
    const int n_distortion = TypeParam::kNumParams - 4;
    const cv::Mat d =
        n_distortion == 0 ? cv::Mat() : cv::Mat(n_distortion, 1, CV_64F, const_cast<double*>(&lens.fx + 4));
    const cv::Vec3d zero(0, 0, 0);
    std::vector<cv::Point2d> px_cv;
    cv::Mat J_cv;  // fisheye: focal lengths, centre, distortion (4), rotation vector, translation, skew
    if (fisheye) {
      cv::fisheye::projectPoints(p_cv, px_cv, zero, zero, K, d, 0, J_cv);
    } else {
      cv::projectPoints(p_cv, zero, zero, K, d, px_cv, J_cv);
    }
    const int first_k = fisheye ? 0 : 6, first_t = fisheye ? 11 : 3;
    for (std::size_t i = 0; i < points.size(); ++i) {
      Mat23 J_px_p, truth_p;
      JacParams<TypeParam> J_px_k, truth_k;
      const Vec2 px = lens.project(points[i], &J_px_p, &J_px_k).value();
      for (int r = 0; r < 2; ++r) {
        const double* row = J_cv.ptr<double>(static_cast<int>(2 * i) + r);
        for (int k = 0; k < TypeParam::kNumParams; ++k) truth_k(r, k) = row[first_k + k];
        for (int k = 0; k < 3; ++k) truth_p(r, k) = row[first_t + k];
      }
      EXPECT_LT((px - Vec2(px_cv[i].x, px_cv[i].y)).norm(), kPx);
      EXPECT_LT(column_error(J_px_k, truth_k), kPx) << "\n" << J_px_k << "\n\n" << truth_k;
      EXPECT_LT((J_px_p - truth_p).cwiseAbs().maxCoeff() / std::max(1.0, truth_p.cwiseAbs().maxCoeff()), kPx);
      ++n_points;
    }
  }
  EXPECT_GT(n_points, 3000);
}

// cv::omnidir's Jacobian: rotation vector (3), translation (3), fx fy, skew, cx cy, xi, k1 k2 p1 p2.
void expect_matches_omnidir(const std::vector<Case<Mei>>& all, const std::function<Lens(const Mei&)>& ours,
                            const std::function<MatX(const MatX&, const Mei&)>& derivatives_of_ours) {
  int n_points = 0;
  for (const auto& [mei, points] : all) {
    std::vector<cv::Point3d> p_cv;
    for (const Vec3& p : points) p_cv.emplace_back(p.x(), p.y(), p.z());
    const cv::Matx33d K(mei.fx, 0, mei.cx, 0, mei.fy, mei.cy, 0, 0, 1);
    const cv::Vec4d d(mei.d[0], mei.d[1], mei.d[2], mei.d[3]);
    std::vector<cv::Point2d> px_cv;
    cv::Mat J_cv;
    cv::omnidir::projectPoints(p_cv, px_cv, cv::Vec3d(), cv::Vec3d(), K, mei.xi, d, J_cv);
    const Lens lens = ours(mei);
    for (std::size_t i = 0; i < points.size(); ++i) {
      Mat23 J_px_p, truth_p;
      JacLens J_px_k;
      MatX truth_k(2, 9);
      const Vec2 px = project(lens, points[i], &J_px_p, &J_px_k).value();
      for (int r = 0; r < 2; ++r) {
        const double* row = J_cv.ptr<double>(static_cast<int>(2 * i) + r);
        for (int k = 0; k < 3; ++k) truth_p(r, k) = row[3 + k];
        truth_k.row(r) << row[6], row[7], row[9], row[10], row[11], row[12], row[13], row[14], row[15];
      }
      EXPECT_LT((px - Vec2(px_cv[i].x, px_cv[i].y)).norm(), kPx);
      EXPECT_LT((J_px_p - truth_p).cwiseAbs().maxCoeff() / std::max(1.0, truth_p.cwiseAbs().maxCoeff()), kPx);
      EXPECT_LT(column_error(MatX(J_px_k), derivatives_of_ours(truth_k, mei)), kPx) << truth_k;
      ++n_points;
    }
  }
  EXPECT_GT(n_points, 3000);
}

TEST(OmnidirReferee, MeiPixelsAndJacobians) {
  expect_matches_omnidir(
      cases<Mei>(179), [](const Mei& mei) { return Lens(mei); }, [](const MatX& J, const Mei&) { return J; });
}

// Without distortion mei is ucm in other parameters: alpha = xi / (1 + xi), f = gamma / (1 + xi).
TEST(OmnidirReferee, UcmPixelsAndJacobians) {
  std::vector<Case<Mei>> all = cases<Mei>(179);
  for (auto& [mei, points] : all) {
    mei.d = {};
    std::erase_if(points, [&mei = mei](const Vec3& p) {
      const auto px = mei.project(p);
      return !px || px->norm() > 5000;
    });
  }
  expect_matches_omnidir(
      all,
      [](const Mei& mei) {
        const double s = 1 + mei.xi;
        return Lens(UnifiedCamera{mei.fx / s, mei.fy / s, mei.cx, mei.cy, mei.xi / s});
      },
      [](const MatX& J, const Mei& mei) {
        // gamma = f / (1 - alpha), xi = alpha / (1 - alpha)
        const double s = 1 + mei.xi;
        MatX ours(2, 5);
        ours << J.col(0) * s, J.col(1) * s, J.col(2), J.col(3),
            s * (J.col(0) * mei.fx + J.col(1) * mei.fy) + s * s * J.col(4);
        return ours;
      });
}

}  // namespace
}  // namespace plumbline

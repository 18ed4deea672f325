// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/rectify.hpp"

#include <gmock/gmock.h>

#include <opencv2/calib3d.hpp>

#include "plumbline/rectify/remap.hpp"
#include "rectify/rigs.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

template <class M>
cv::Mat to_cv(const M& m) {
  cv::Mat out(static_cast<int>(m.rows()), static_cast<int>(m.cols()), CV_64F);
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) out.at<double>(r, c) = m(r, c);
  }
  return out;
}

template <class M>
void from_cv(const cv::Mat& m, M& out) {
  for (int r = 0; r < m.rows; ++r) {
    for (int c = 0; c < m.cols; ++c) out(r, c) = m.at<double>(r, c);
  }
}

struct NamedRig {
  std::string name;
  Rig rig;
  bool vertical;
};

std::vector<NamedRig> rigs() {
  const Camera left = perspective("left"), right = perspective("right", -0.30);
  Camera turned = right;
  turned.size = {480, 640};
  turned.lens = OpenCV5{532, 533, 235, 342, {-0.28, 0.05, 0.001, -0.0005, 0.02}};
  return {
      {"horizontal", pair(left, right, {0.1, 0.002, -0.003}, {0.01, -0.02, 0.005}), false},
      {"second camera on the left", pair(left, right, {-0.1, 0.002, 0.003}, {0.01, 0.02, 0.005}), false},
      {"vertical, second below", pair(left, right, {0.003, 0.12, 0.002}, {0.02, 0.01, -0.01}), true},
      {"vertical, second above", pair(left, right, {0.003, -0.12, 0.002}, {0.02, 0.01, -0.01}), true},
      {"toed-in by 20 degrees each", pair(left, right, {0.3, 0, 0.01}, {0, -40 * kDegree, 0}), false},
      {"second upside down", pair(left, right, {0.1, 0.001, 0}, {0.01, -0.01, 179 * kDegree}), false},
      {"second turned by a quarter", pair(left, turned, {0.1, 0.001, 0}, {0.01, 0.01, 90 * kDegree}), false},
      {"second turned back by a quarter, below",
       pair(left, turned, {0.0, 0.1, 0}, {0.01, 0.01, -91 * kDegree}), true},
      {"roll of 30 degrees", pair(left, right, {0.1, 0.02, 0}, {0, 0, 30 * kDegree}), false},
      {"fisheye of 150 degrees",
       pair(fisheye("left", 150), fisheye("right", 150), {0.1, 0, 0.002}, {0.02, 0.03, 0}), false},
      {"fisheye of 190 degrees",
       pair(fisheye("left", 190), fisheye("right", 190), {0.1, 0, 0.002}, {0.02, 0.03, 0}), false},
      {"mixed lenses", pair(left, fisheye("right", 170), {0.2, 0.01, 0}, {0.02, -0.1, 0.03}), false},
      {"mixed the other way", pair(fisheye("left", 170), right, {0.2, 0.01, 0}, {0.02, -0.1, 0.03}), false},
  };
}

// The heart of the matter: a point in space comes to lie in the same row (column for vertical) of both
// images, the disparity is f B / Z along the axis, and Q leads back to the point in the first camera's
// rectified frame.
TEST(RectifyStereo, PointsShareTheRowAndQLeadsBack) {
  Rng rng(7);
  for (const auto& [name, rig, vertical] : rigs()) {
    SCOPED_TRACE(name);
    for (double alpha : {0.0, 0.5, 1.0}) {
      const auto r = rectify_stereo(rig, 0, 1, {alpha, {}});
      ASSERT_TRUE(r) << r.error().text();
      EXPECT_EQ(r->vertical, vertical);
      const int along = vertical ? 1 : 0, across = 1 - along;
      int seen = 0;
      for (int i = 0; i < 200; ++i) {
        const Vec3 p(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(1, 6));
        const auto a = rectified_px(rig, *r, 0, p), b = rectified_px(rig, *r, 1, p);
        if (!a || !b) continue;
        ++seen;
        EXPECT_NEAR((*a)[across], (*b)[across], 1e-9);
        const double disparity = (*a)[along] - (*b)[along];
        const Vec4 X = r->Q * Vec4(a->x(), a->y(), disparity, 1);
        const Vec3 expected = r->R_rect_cam[0] * p;
        EXPECT_LT((X.head<3>() / X[3] - expected).norm(), 1e-9);
        const Vec3 p2 = r->P[1] * expected.homogeneous();  // P2 takes points of the first rectified frame
        EXPECT_LT((p2.hnormalized() - *b).norm(), 1e-9);
        // and the pixel of the original image is led there by rectify_pixel
        const auto px = project(rig.cameras[1].lens, rig.T_cam_rig[1] * p);
        if (!px) continue;
        const auto moved = rectify_pixel(*r, rig.cameras[1].lens, 1, *px);
        ASSERT_TRUE(moved);
        // 1e-7: a lens that compresses its border turns the unprojection's 1e-10 px into more
        EXPECT_LT((*moved - *b).norm(), 1e-7 * (1 + b->norm()));
      }
      EXPECT_GT(seen, 100);
    }
  }
}

TEST(RectifyStereo, FirstCamerasUpStaysUp) {
  for (const auto& [name, rig, vertical] : rigs()) {
    SCOPED_TRACE(name);
    const auto r = rectify_stereo(rig, 0, 1);
    ASSERT_TRUE(r);
    for (int i : {0, 1}) EXPECT_NEAR(r->R_rect_cam[i].determinant(), 1, 1e-12);
    // The first camera's x and y axes keep their direction within half of what the rig is rolled.
    EXPECT_GT(r->R_rect_cam[0](0, 0), std::cos(25 * kDegree));
    EXPECT_GT(r->R_rect_cam[0](1, 1), std::cos(25 * kDegree));
    // The second camera's image is turned to match: what is up for the first camera is up there too.
    const Mat3 R_2_1 = rig.T_cam_rig[1].R();
    EXPECT_GT((r->R_rect_cam[1] * R_2_1)(1, 1), std::cos(25 * kDegree));
    EXPECT_GT((r->R_rect_cam[1] * R_2_1)(0, 0), std::cos(25 * kDegree));
  }
}

TEST(RectifyStereo, CamerasKeepTheirOrder) {
  const auto right = rectify_stereo(rigs()[0].rig, 0, 1), left = rectify_stereo(rigs()[1].rig, 0, 1);
  EXPECT_LT(right->P[1](0, 3), 0);
  EXPECT_NEAR(right->P[1](0, 3), -right->P[0](0, 0) * right->baseline_m, 1e-12);
  EXPECT_GT(left->P[1](0, 3), 0);
  EXPECT_LT(rectify_stereo(rigs()[2].rig, 0, 1)->P[1](1, 3), 0);
  EXPECT_GT(rectify_stereo(rigs()[3].rig, 0, 1)->P[1](1, 3), 0);
}

TEST(RectifyStereo, AgreesWithOpenCV) {
  Rng rng(3);
  for (int i = 0; i < 40; ++i) {
    const bool vertical = i % 2 == 1;
    const double sign = i % 4 < 2 ? 1 : -1;
    Vec3 centre(rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02));
    centre[vertical] = 0.15 * sign;
    const Vec3 w(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1));
    const Rig rig = pair(perspective("a", -0.1), perspective("b", -0.15), centre, w);
    cv::Mat K[2], D[2], R, T, R1, R2, P1, P2, Q;
    for (int c : {0, 1}) {
      const auto k = params(rig.cameras[c].lens);
      K[c] = to_cv(camera_matrix_k(rig.cameras[c].lens));
      D[c] = cv::Mat(1, 5, CV_64F, const_cast<double*>(k.data() + 4)).clone();
    }
    R = to_cv(Mat3(rig.T_cam_rig[1].R()));
    T = to_cv(Vec3(rig.T_cam_rig[1].t()));
    for (double alpha : {0.0, 1.0}) {
      cv::stereoRectify(K[0], D[0], K[1], D[1], {640, 480}, R, T, R1, R2, P1, P2, Q, cv::CALIB_ZERO_DISPARITY,
                        alpha);
      const auto ours = rectify_stereo(rig, 0, 1, {alpha, {}});
      ASSERT_TRUE(ours) << ours.error().text();
      Mat3 cv_R1, cv_R2;
      Mat34 cv_P1, cv_P2;
      Mat4 cv_Q;
      from_cv(R1, cv_R1), from_cv(R2, cv_R2), from_cv(P1, cv_P1), from_cv(P2, cv_P2), from_cv(Q, cv_Q);
      EXPECT_LT((ours->R_rect_cam[0] - cv_R1).norm(), 1e-9);
      EXPECT_LT((ours->R_rect_cam[1] - cv_R2).norm(), 1e-9);
      // OpenCV takes 9 x 9 samples through an approximate undistortion, to column 640 of an image that ends
      // at 639, and at alpha 0 a rectangle inside the outline that is not the largest: ours shows as much or
      // up to a seventh more.
      const double ratio = ours->P[0](0, 0) / cv_P1(0, 0);
      EXPECT_LT(ratio, 1.005) << "alpha " << alpha << " case " << i;
      EXPECT_GT(ratio, alpha == 0.0 ? 0.85 : 0.995) << "alpha " << alpha << " case " << i;
      EXPECT_NEAR(ours->P[0](0, 2), cv_P1(0, 2), 1.0);
      EXPECT_NEAR(ours->P[0](1, 2), cv_P1(1, 2), 1.0);
      EXPECT_NEAR(ours->P[1](vertical, 3) / ours->P[1](0, 0), cv_P2(vertical, 3) / cv_P2(0, 0), 1e-9);
      EXPECT_NEAR(ours->Q(3, 2), cv_Q(3, 2), 1e-9);
      EXPECT_EQ(ours->P[1](!vertical, 3), 0);
    }
  }
}

// image_pipeline PR 1128: fisheye pairs came out with a negative focal length and no valid pixel. Here: 108
// configurations of field of view, convergence, roll and alpha, none of which may.
TEST(RectifyStereo, FocalLengthIsPositiveForEveryFisheye) {
  int n = 0;
  for (double fov : {100.0, 140.0, 160.0, 175.0, 185.0, 195.0}) {
    for (double turn : {-25.0, 0.0, 25.0}) {
      for (double roll : {0.0, 20.0}) {
        const Rig rig = pair(fisheye("left", fov, {400, 300}), fisheye("right", fov, {400, 300}),
                             {0.1, 0.003, 0.001}, Vec3(0.02, turn * kDegree, roll * kDegree));
        double previous = 1e9;
        for (double alpha : {0.0, 0.5, 1.0}) {
          SCOPED_TRACE(testing::Message()
                       << "fov " << fov << " turn " << turn << " roll " << roll << " alpha " << alpha);
          const auto r = rectify_stereo(rig, 0, 1, {alpha, {}});
          ASSERT_TRUE(r) << r.error().text();
          EXPECT_GT(r->P[0](0, 0), 0);
          EXPECT_EQ(r->P[0](0, 0), r->P[1](0, 0));
          EXPECT_EQ(r->P[0](0, 0), r->P[0](1, 1));
          EXPECT_LE(r->P[0](0, 0), previous);  // more is seen with more alpha
          previous = r->P[0](0, 0);
          ++n;
          if (alpha != 0.0 && alpha != 1.0) continue;
          for (int i : {0, 1}) {
            const RemapMaps maps = rectification_maps(*r, rig.cameras[i], i);
            if (alpha == 0.0)
              EXPECT_EQ(maps.valid_fraction, 1.0);
            else
              EXPECT_GT(maps.valid_fraction, 0.03);
          }
        }
      }
    }
  }
  EXPECT_EQ(n, 108);
}

TEST(RectifyStereo, AlphaZeroShowsOnlyValidPixels) {
  for (const auto& [name, rig, vertical] : rigs()) {
    SCOPED_TRACE(name);
    const auto r = rectify_stereo(rig, 0, 1, {0.0, {}});
    for (int i : {0, 1}) {
      const RemapMaps maps = rectification_maps(*r, rig.cameras[i], i);
      EXPECT_EQ(maps.valid_fraction, 1.0);
      const cv::Mat white(rig.cameras[i].size.height, rig.cameras[i].size.width, CV_8UC1, cv::Scalar(255));
      double low = 0;
      cv::minMaxLoc(remap_image(white, maps), &low);
      EXPECT_EQ(low, 255);  // bilinear interpolation takes in no black
    }
    // and it cannot show more: one part in 50 of focal length less, and a border pixel is lost somewhere
    StereoRectification wider = *r;
    const double cx = r->P[0](0, 2), cy = r->P[0](1, 2), f = r->P[0](0, 0);
    const Vec2 middle(0.5 * (r->size.width - 1), 0.5 * (r->size.height - 1));
    for (Mat34& P : wider.P) {
      P(0, 0) = P(1, 1) = 0.98 * f;
      P(0, 2) =
          name.find("fisheye") == 0 || name.find("mixed") == 0 ? middle.x() - 0.98 * (middle.x() - cx) : cx;
      P(1, 2) =
          name.find("fisheye") == 0 || name.find("mixed") == 0 ? middle.y() - 0.98 * (middle.y() - cy) : cy;
    }
    double least = 1;
    bool capped = false;  // where the cap of the half angle limits it, the maps stay valid
    for (int i : {0, 1}) least = std::min(least, rectification_maps(wider, rig.cameras[i], i).valid_fraction);
    const double corner =
        std::atan(Vec2(std::max(cx, r->size.width - cx), std::max(cy, r->size.height - cy)).norm() / f);
    capped = corner > (kMaxHalfAngle_deg - 1) * kDegree;
    if (!capped) EXPECT_LT(least, 1.0);
  }
}

TEST(RectifyStereo, AlphaOneKeepsEverySourcePixel) {
  for (const auto& [name, rig, vertical] : rigs()) {
    SCOPED_TRACE(name);
    const auto r = rectify_stereo(rig, 0, 1, {1.0, {}});
    int kept = 0, beyond_cap = 0;
    for (int i : {0, 1}) {
      const Camera& camera = rig.cameras[i];
      for (int y = 0; y < camera.size.height; y += 7) {
        for (int x = 0; x < camera.size.width; x += 7) {
          const auto ray = unproject(camera.lens, Vec2(x, y));
          if (!ray) continue;
          const Vec3 p = r->R_rect_cam[i] * *ray;
          if (std::atan2(p.head<2>().norm(), p.z()) > (kMaxHalfAngle_deg - 1e-6) * kDegree) {
            ++beyond_cap;
            continue;
          }
          const auto px = rectify_pixel(*r, camera.lens, i, Vec2(x, y));
          ASSERT_TRUE(px);
          EXPECT_GE(px->minCoeff(), -1e-2);
          EXPECT_LE(px->x(), r->size.width - 1 + 1e-2);
          EXPECT_LE(px->y(), r->size.height - 1 + 1e-2);
          ++kept;
        }
      }
    }
    EXPECT_GT(kept, 2000);
    if (name.find("fisheye") == std::string::npos && name.find("mixed") == std::string::npos)
      EXPECT_EQ(beyond_cap, 0);
  }
}

TEST(RectifyStereo, AnotherSizeShowsTheSame) {
  const auto small = rectify_stereo(rigs()[0].rig, 0, 1),
             big = rectify_stereo(rigs()[0].rig, 0, 1, {0.0, {1280, 960}});
  EXPECT_EQ(big->size, (ImageSize{1280, 960}));
  EXPECT_NEAR(big->P[0](0, 0) / small->P[0](0, 0), 2, 0.01);
}

TEST(RectifyStereo, RefusesWhatHasNoCommonPlane) {
  const Camera c = perspective("left"), d = perspective("right");
  const auto zero = rectify_stereo(pair(c, d, {0, 0, 0}, {0, 0.1, 0}), 0, 1);
  ASSERT_FALSE(zero);
  EXPECT_EQ(zero.error().code, ErrorCode::kDegenerate);
  const auto forward = rectify_stereo(pair(c, d, {0.005, 0, 0.1}, {0, 0, 0}), 0, 1);
  ASSERT_FALSE(forward);
  EXPECT_EQ(forward.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(forward.error().text(), testing::HasSubstr("2.9 degrees"));  // atan(0.005 / 0.1)
  EXPECT_THAT(forward.error().text(), testing::HasSubstr("left"));
  const auto apart = rectify_stereo(pair(c, d, {0.1, 0, 0}, {130 * kDegree, 0, 0}), 0, 1);
  ASSERT_FALSE(apart);
  EXPECT_EQ(apart.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(apart.error().text(), testing::HasSubstr("130.0 degrees apart"));
  Rig one{{c}, {SE3()}};
  EXPECT_EQ(rectify_stereo(one, 0, 1).error().code, ErrorCode::kUnsupported);
  EXPECT_EQ(rectify_stereo(rigs()[0].rig, 0, 2).error().code, ErrorCode::kUnsupported);
  EXPECT_THROW((void)rectify_stereo(rigs()[0].rig, 0, 1, {1.5, {}}), std::invalid_argument);
}

// A calibration whose corners are exact projections: no difference across the lines; a row shifted in one
// image shows.
TEST(VerticalRms, IsZeroForTheTruthAndSeesAShift) {
  Calibration cal;
  cal.rig = rigs()[0].rig;
  cal.data.targets = {*make_target(Chessboard{9, 6, 0.025})};
  cal.data.frames = {"0"};
  cal.T_rig_board = {SE3(so3_exp(Vec3(0.2, 0.3, 0.1)), Vec3(-0.1, -0.05, 0.6))};
  for (int cam : {0, 1}) {
    cal.data.cameras.push_back({cal.rig.cameras[cam].name, cal.rig.cameras[cam].size});
    View view{cam, 0, "x", {}, ""};
    for (int p = 0; p < 54; ++p) view.corners.push_back({p, *predict(cal, view, p), 1});
    cal.fits.push_back(std::vector<CornerFit>(54));
    cal.data.views.push_back(view);
  }
  const auto r = rectify_stereo(cal.rig, 0, 1);
  ASSERT_TRUE(r);
  EXPECT_LT(vertical_rms_px(*r, cal).value(), 1e-8);
  // Corners of another board with the same numbers are no partners of these.
  cal.data.targets.push_back(cal.data.targets[0]);
  cal.data.views.push_back(cal.data.views[0]);
  cal.data.views.back().target = 1;
  for (Corner& c : cal.data.views.back().corners) c.px.y() += 20;
  cal.fits.push_back(cal.fits[0]);
  EXPECT_LT(vertical_rms_px(*r, cal).value(), 1e-8);
  for (Corner& c : cal.data.views[1].corners) c.px.y() += 0.5;
  EXPECT_NEAR(vertical_rms_px(*r, cal).value(), 0.5 * r->P[0](0, 0) / 533, 0.03);
  for (CornerFit& fit : cal.fits[1]) fit.outlier = true;
  EXPECT_FALSE(vertical_rms_px(*r, cal).has_value());
}

TEST(UndistortedCamera, AgreesWithOpenCV) {
  const Camera camera = perspective("left", -0.1);
  const auto k = params(camera.lens);
  cv::Mat K, D = cv::Mat(1, 5, CV_64F, const_cast<double*>(k.data() + 4)).clone();
  K = to_cv(camera_matrix_k(camera.lens));
  for (double alpha : {0.0, 0.3, 1.0}) {
    const cv::Mat N = cv::getOptimalNewCameraMatrix(K, D, {640, 480}, alpha, {800, 500});
    const auto ours = undistorted_camera(camera, alpha, {800, 500});
    ASSERT_TRUE(ours);
    // OpenCV 4.6 lays column 640 of an image that ends at 639 on the last column of the new one: one part in
    // 640 and 480, to which its 9 x 9 samples and approximate undistortion add a little.
    EXPECT_NEAR(ours->fx / N.at<double>(0, 0), 640.0 / 639.0, 7e-4) << alpha;
    EXPECT_NEAR(ours->fy / N.at<double>(1, 1), 480.0 / 479.0, 7e-4) << alpha;
    EXPECT_NEAR(ours->cx, N.at<double>(0, 2), 1.0) << alpha;
    EXPECT_NEAR(ours->cy, N.at<double>(1, 2), 1.0) << alpha;
  }
}

TEST(UndistortedCamera, ShowsOnlyValidPixelsOrAllOfThem) {
  for (const Camera& camera :
       {perspective("a"), perspective("b", 0.2), fisheye("c", 150), fisheye("d", 190)}) {
    const auto valid = undistorted_camera(camera, 0.0);
    ASSERT_TRUE(valid);
    EXPECT_GT(valid->fx, 0);
    const RemapMaps maps = remap_maps(camera, Mat3::Identity(), camera_matrix_k(Lens(*valid)), camera.size);
    EXPECT_GT(maps.valid_fraction, 1 - 1e-5);
    const auto all = undistorted_camera(camera, 1.0);
    for (int x = 0; x < camera.size.width; x += 13) {
      const auto ray = unproject(camera.lens, Vec2(x, 0));
      if (!ray || std::atan2(ray->head<2>().norm(), ray->z()) > kMaxHalfAngle_deg * kDegree) continue;
      const auto px = all->project(*ray);
      ASSERT_TRUE(px);
      EXPECT_GE(px->y(), -0.01);
    }
  }
  Camera off = perspective("off");
  params(off.lens)[2] = -300;
  EXPECT_EQ(undistorted_camera(off, 0).error().code, ErrorCode::kDegenerate);
}

}  // namespace
}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/render.hpp"

#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {

BoardDrawing drawing_of(const TargetSpec& spec) { return draw_target(*make_target(spec)).value().at(0); }

SE3 pose(const Vec3& w, const Vec3& t) { return SE3(so3_exp(w), t); }

// A white sheet with one shape.
BoardDrawing sheet(double half_m) {
  BoardDrawing d;
  d.low = Vec2::Constant(-half_m);
  d.high = Vec2::Constant(half_m);
  return d;
}

// Outline of a shape on the board, finely divided.
std::vector<Vec3> outline(const Disc& disc) {
  std::vector<Vec3> points;
  for (int i = 0; i < 2000; ++i) {
    const double a = 2 * std::numbers::pi * i / 2000;
    points.emplace_back(disc.centre.x() + disc.radius * std::cos(a),
                        disc.centre.y() + disc.radius * std::sin(a), 0);
  }
  return points;
}
std::vector<Vec3> outline(const Box& box) {
  const Vec2 corners[4] = {box.low, {box.high.x(), box.low.y()}, box.high, {box.low.x(), box.high.y()}};
  std::vector<Vec3> points;
  for (int side = 0; side < 4; ++side) {
    for (int i = 0; i < 200; ++i) {
      const Vec2 p = corners[side] + i / 200.0 * (corners[(side + 1) % 4] - corners[side]);
      points.emplace_back(p.x(), p.y(), 0);
    }
  }
  return points;
}

struct Blob {
  double area = 0;
  Vec2 centroid = Vec2::Zero();
};

// Area and centroid of a polygon in the image.
Blob of_polygon(const std::vector<Vec2>& p) {
  Blob blob;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Vec2 &a = p[i], &b = p[(i + 1) % p.size()];
    const double cross = a.x() * b.y() - a.y() * b.x();
    blob.area += cross / 2;
    blob.centroid += cross / 6 * (a + b);
  }
  blob.centroid /= blob.area;
  blob.area = std::abs(blob.area);
  return blob;
}

// The same of the dark pixels, by how dark they are.
Blob of_image(const cv::Mat& levels, double white, double black) {
  Blob blob;
  for (int r = 0; r < levels.rows; ++r) {
    for (int c = 0; c < levels.cols; ++c) {
      const double ink = (white - levels.at<float>(r, c)) / (white - black);
      blob.area += ink;
      blob.centroid += ink * Vec2(c, r);
    }
  }
  blob.centroid /= blob.area;
  return blob;
}

// The shape on a sheet that is as white as the background and fills the image, so that only the shape is
// dark.
Blob rendered(BoardDrawing drawing, const Lens& lens, ImageSize size, const SE3& T) {
  RenderOptions options;
  options.background_grey = options.white_grey;
  return of_image(render_grey_levels({drawing}, camera_rays(lens, size), T, options), options.white_grey,
                  options.black_grey);
}

std::vector<Vec2> projected_by_opencv(const std::vector<Vec3>& points, const SE3& T, const Lens& lens) {
  std::vector<cv::Point3d> object;
  for (const Vec3& p : points) object.emplace_back(p.x(), p.y(), p.z());
  const Vec3 w = so3_log(T.R()), t = T.t();
  const cv::Vec3d rvec(w.x(), w.y(), w.z()), tvec(t.x(), t.y(), t.z());
  const auto k = params(lens);
  const cv::Matx33d K(k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1);
  const std::vector<double> D(k.begin() + 4, k.end());
  std::vector<cv::Point2d> px;
  if (lens_name(lens) == "kb4")
    cv::fisheye::projectPoints(object, px, cv::Affine3d(rvec, tvec), K, D);
  else
    cv::projectPoints(object, rvec, tvec, K, D, px);
  std::vector<Vec2> out;
  for (const auto& p : px) out.emplace_back(p.x, p.y);
  return out;
}

const ImageSize kSize{320, 240};
Lens opencv8() {
  return *make_lens("opencv8", std::vector<double>{230, 235, 161.3, 118.2, -0.3, 0.12, 1e-3, -2e-3, -0.01,
                                                   0.02, -0.01, 0.002});
}
Lens kb4(double focal = 110) {
  return *make_lens("kb4",
                    std::vector<double>{focal, 1.01 * focal, 158.7, 121.4, -0.02, 0.01, -0.005, 0.001});
}

TEST(Render, ShapesLieWhereOpenCvProjectsThem) {
  const std::vector<SE3> poses{pose({0.1, -0.2, 0.3}, {0.02, -0.01, 0.4}),
                               pose({0.5, 0.4, -0.7}, {-0.1, 0.08, 0.35}),
                               pose({-0.8, 0.1, 1.0}, {0.12, 0.1, 0.5})};
  const Disc disc{{0.01, -0.02}, 0.03};
  const Box box{{-0.03, -0.02}, {0.025, 0.03}};
  for (const Lens& lens : {opencv8(), kb4()}) {
    // Within a pixel the lens is taken as a homography: on a sheet seen at the angle a from its normal, the
    // middle of a pixel's side is off by up to tan(a) / (4 f) px (docs/synth.md). The poses tilt by up to 50
    // degrees.
    const double curvature_px = 0.3 / params(lens)[0];
    for (const SE3& T : poses) {
      BoardDrawing d = sheet(0.1), b = sheet(0.1);
      d.discs.push_back(disc);
      b.boxes.push_back(box);
      const Blob disc_expected = of_polygon(projected_by_opencv(outline(disc), T, lens));
      const Blob disc_seen = rendered(d, lens, kSize, T);
      EXPECT_LT((disc_seen.centroid - disc_expected.centroid).norm(), curvature_px) << lens_name(lens);
      EXPECT_NEAR(disc_seen.area / disc_expected.area, 1, 1e-4);
      const Blob box_expected = of_polygon(projected_by_opencv(outline(box), T, lens));
      const Blob box_seen = rendered(b, lens, kSize, T);
      EXPECT_LT((box_seen.centroid - box_expected.centroid).norm(), curvature_px) << lens_name(lens);
      EXPECT_NEAR(box_seen.area / box_expected.area, 1, 1e-4);
    }
  }
}

// Pixel (0, 0) is the centre of the top-left pixel: a board point that projects to (100.25, 60) with an edge
// through it splits pixel 100 at three quarters.
TEST(Render, AnEdgeSplitsAPixelByItsArea) {
  const Lens lens = *make_lens("pinhole", std::vector<double>{200, 200, 100, 60});
  BoardDrawing d = sheet(0.2);
  d.boxes.push_back({{0.25 / 200, -0.1}, {0.1, 0.1}});  // at depth 1 m the left edge is at u = 100.25
  RenderOptions o;
  o.white_grey = 200, o.black_grey = 0;
  const cv::Mat levels =
      render_grey_levels({d}, camera_rays(lens, {201, 121}), SE3(Mat3::Identity(), {0, 0, 1}), o);
  EXPECT_NEAR(levels.at<float>(60, 99), 200, 1e-3);
  EXPECT_NEAR(levels.at<float>(60, 100), 150, 1e-3);  // white from 99.5 to 100.25
  EXPECT_NEAR(levels.at<float>(60, 101), 0, 1e-3);
}

// A second road to the same picture: the drawing as a fine raster, warped by OpenCV into an image 8 times as
// large, and averaged. No shift, no mirror, no wrong scale.
TEST(Render, AgreesWithAWarpedRaster) {
  const TargetSpec spec = Charuco{5, 7, 0.03, 0.022, "4X4_50", 0};
  const BoardDrawing d = drawing_of(spec);
  const Lens lens = *make_lens("pinhole", std::vector<double>{300, 305, 158.2, 122.1});
  const SE3 T = pose({0.35, -0.4, 0.2}, {-0.05, -0.06, 0.33});
  RenderOptions o;
  const cv::Mat ours = render_grey_levels({d}, camera_rays(lens, kSize), T, o);

  constexpr double kPerM = 20000;  // 0.05 mm a cell
  const Vec2 sheet_size = d.sheet_high() - d.sheet_low();
  cv::Mat1b raster(static_cast<int>(std::lround(sheet_size.y() * kPerM)),
                   static_cast<int>(std::lround(sheet_size.x() * kPerM)),
                   static_cast<unsigned char>(o.white_grey));
  for (const Box& box : d.boxes) {
    const Vec2 low = kPerM * (box.low - d.sheet_low()), size = kPerM * (box.high - box.low);
    const auto whole = [](double x) { return static_cast<int>(std::lround(x)); };
    raster(cv::Rect(whole(low.x()), whole(low.y()), whole(size.x()), whole(size.y()))).setTo(o.black_grey);
  }
  constexpr int kTimes = 8;
  Mat3 board_raster, large_px;  // cell (i, j) has its centre at (i + 0.5) / kPerM
  board_raster << 1 / kPerM, 0, d.sheet_low().x() + 0.5 / kPerM, 0, 1 / kPerM,
      d.sheet_low().y() + 0.5 / kPerM, 0, 0, 1;
  large_px << kTimes, 0, 0.5 * (kTimes - 1), 0, kTimes, 0.5 * (kTimes - 1), 0, 0, 1;
  Mat3 P;
  P << T.R().col(0), T.R().col(1), T.t();
  const Mat3 H = large_px * camera_matrix_k(lens) * P * board_raster;
  cv::Matx33d warp;
  for (int i = 0; i < 9; ++i) warp.val[i] = H(i / 3, i % 3);
  cv::Mat large, theirs;
  cv::warpPerspective(raster, large, warp, {kTimes * kSize.width, kTimes * kSize.height}, cv::INTER_NEAREST,
                      cv::BORDER_CONSTANT, cv::Scalar(o.background_grey));
  cv::resize(large, theirs, {kSize.width, kSize.height}, 0, 0, cv::INTER_AREA);
  theirs.convertTo(theirs, CV_32F);
  cv::Mat difference = cv::abs(ours - theirs);
  double worst = 0;
  cv::minMaxLoc(difference, nullptr, &worst);
  EXPECT_LT(cv::mean(difference)[0], 0.25);  // 8x8 samples of a pixel are off by a few levels at edges
  EXPECT_LE(worst, 25.5);                    // an edge along a row of samples: 1/8 of 200 levels
  EXPECT_LT(std::abs(cv::mean(ours)[0] - cv::mean(theirs)[0]), 0.05);
  const cv::Point2d shift = cv::phaseCorrelate(ours, theirs);
  EXPECT_LT(std::hypot(shift.x, shift.y), 5e-3);
}

// Beyond 90 degrees cv::fisheye is wrong; our own projection, tested against automatic differentiation and
// mrcal's convention elsewhere, says where the shape is: 105 degrees from the axis, behind the camera.
TEST(Render, AFisheyeSeesBehindItself) {
  const Lens lens = kb4(70);
  const double theta = 105 * std::numbers::pi / 180;
  const Vec3 direction(std::sin(theta), 0, std::cos(theta));
  const SE3 T(so3_exp(Vec3(0, theta, 0)) * so3_exp(Vec3(0.2, -0.3, 0.5)), 0.5 * direction);
  const Box box{{-0.05, -0.04}, {0.05, 0.06}};
  std::vector<Vec2> px;
  for (const Vec3& p : outline(box)) {
    ASSERT_LT((T * p).z(), 0);
    px.push_back(project(lens, T * p).value());
  }
  BoardDrawing d = sheet(0.12);
  d.boxes.push_back(box);
  const Blob expected = of_polygon(px), seen = rendered(d, lens, {340, 240}, T);
  EXPECT_LT((seen.centroid - expected.centroid).norm(),
            0.3 / 70);  // the lens curvature within a pixel, as above
  EXPECT_NEAR(seen.area / expected.area, 1, 1e-4);
}

TEST(Render, NearerSheetsHideFartherOnesAndBacksArePlain) {
  const Lens lens = *make_lens("pinhole", std::vector<double>{200, 200, 160, 120});
  const CameraRays rays = camera_rays(lens, kSize);
  BoardDrawing far = sheet(0.2), near = sheet(0.05);
  far.boxes.push_back({{-0.2, -0.2}, {0.2, 0.2}});  // all black
  near.T_target_board = SE3(Mat3::Identity(), {0, 0, -0.3});
  const SE3 T(Mat3::Identity(), {0, 0, 1});
  RenderOptions o;
  for (const auto& order : {std::vector{far, near}, std::vector{near, far}}) {
    const cv::Mat image = render(order, rays, T, o);
    EXPECT_EQ(image.at<unsigned char>(120, 160), 225);  // the near white sheet
    EXPECT_EQ(image.at<unsigned char>(120, 185), 25);   // beside it the far black one
    EXPECT_EQ(image.at<unsigned char>(120, 215), 120);  // beside both
  }
  const SE3 turned = T * SE3(so3_exp(Vec3(0, std::numbers::pi, 0)), Vec3::Zero());
  EXPECT_EQ(render({far}, rays, turned, o).at<unsigned char>(120, 160), 90);
  // An AprilGrid's printed side is the one that z points out of.
  BoardDrawing up = far;
  up.y_up = true;
  EXPECT_EQ(render({up}, rays, T, o).at<unsigned char>(120, 160), 90);
  EXPECT_EQ(render({up}, rays, turned, o).at<unsigned char>(120, 160), 25);
}

TEST(Render, ManySheetsAtOnceAgreeWithOneAtATime) {
  // Two panels that meet at a right angle: pixels away from the common edge must be what each panel gives
  // alone.
  const BoardDrawing a = drawing_of(Charuco{4, 4, 0.03, 0.022, "4X4_50", 0});
  BoardDrawing b = drawing_of(Charuco{4, 4, 0.03, 0.022, "4X4_50", 8});
  b.T_target_board =
      SE3(so3_exp(Vec3(0, -std::numbers::pi / 2, 0)), Vec3(a.sheet_high().x(), 0, b.sheet_low().x()));
  const SE3 T = pose({0.2, 0.7, 0.1}, {-0.05, -0.03, 0.35});
  const CameraRays rays = camera_rays(opencv8(), kSize);
  RenderOptions o;
  const cv::Mat both = render({a, b}, rays, T, o), first = render({a}, rays, T, o),
                second = render({b}, rays, T, o);
  int n_seen = 0, n_odd = 0;
  for (int r = 0; r < both.rows; ++r) {
    for (int c = 0; c < both.cols; ++c) {
      const int x = both.at<unsigned char>(r, c), p = first.at<unsigned char>(r, c),
                q = second.at<unsigned char>(r, c);
      n_seen += p != 120 || q != 120;
      n_odd += std::abs(x - p) > 25 && std::abs(x - q) > 25;
    }
  }
  EXPECT_GT(n_seen, 5000);
  EXPECT_LT(n_odd, 300);  // along the common edge and the rims only
}

TEST(Render, TheImageDoesNotDependOnTheNumberOfThreads) {
  const BoardDrawing d = drawing_of(AprilGrid{3, 3, 0.04, 0.3});
  const SE3 T = pose({std::numbers::pi, 0.1, 0}, {-0.07, 0.07, 0.4});
  RenderOptions o;
  o.noise_grey = 3, o.texture_grey = 15, o.blur_sigma_px = 0.7, o.vignetting = 0.3, o.seed = 5,
  o.n_threads = 1;
  const cv::Mat one = render({d}, camera_rays(kb4(), kSize, 1), T, o);
  o.n_threads = 4;
  const cv::Mat four = render({d}, camera_rays(kb4(), kSize, 4), T, o);
  EXPECT_EQ(cv::countNonZero(one != four), 0);
  o.seed = 6;
  EXPECT_GT(cv::countNonZero(one != render({d}, camera_rays(kb4(), kSize), T, o)), 10000);
}

TEST(Render, NoiseAndVignettingAreWhatTheyAreSaidToBe) {
  RenderOptions o;
  o.noise_grey = 4;
  const CameraRays rays = camera_rays(opencv8(), kSize);
  const cv::Mat noisy = render({}, rays, SE3(), o);
  cv::Scalar mean, sigma;
  cv::meanStdDev(noisy, mean, sigma);
  EXPECT_NEAR(mean[0], 120, 0.1);
  EXPECT_NEAR(sigma[0], std::sqrt(16 + 1.0 / 12), 0.05);  // 76,800 pixels; rounding adds 1/12
  o = {};
  o.vignetting = 0.5;
  const cv::Mat levels = render_grey_levels({}, rays, SE3(), o);
  EXPECT_NEAR(levels.at<float>(0, 0), 60, 1e-3);
  EXPECT_NEAR(levels.at<float>(120, 160), 120, 1e-2);
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "detect/tangent_view.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "plumbline/rig/validity.hpp"

namespace plumbline::detail {
namespace {

constexpr double kDeg = std::numbers::pi / 180;
constexpr double kOneView = 55 * kDeg;    ///< up to which one view shows it all
constexpr double kHalfAngle = 50 * kDeg;  ///< of each of several
constexpr double kInnerRing = 50 * kDeg, kOuterRing = 85 * kDeg, kOuterFrom = 95 * kDeg;
constexpr int kRingViews = 6;
constexpr int kMostPx = 1800;  ///< per side; larger ones are reduced
constexpr int kMapStep = 4;    ///< px between the places for which the lens is asked
constexpr float kNowhere = -1e5F;

/// The ray of the outermost pixel that has one, from the middle towards a place on the image's border.
Vec3 border_ray(const Camera& camera, const Vec2& middle, const Vec2& border) {
  for (double s = 1; s > 0.2; s -= 0.04) {
    if (const auto ray = unproject(camera, middle + s * (border - middle))) return *ray;
  }
  return Vec3::UnitZ();
}

std::vector<Vec3> border_rays(const Camera& camera) {
  const double w = camera.size.width - 1, h = camera.size.height - 1;
  const Vec2 middle(w / 2, h / 2);
  std::vector<Vec3> rays;
  for (int i = 0; i < 8; ++i) {
    const double s = i / 8.0;
    for (const Vec2& p : {Vec2(s * w, 0), Vec2(w, s * h), Vec2((1 - s) * w, h), Vec2(0, (1 - s) * h)})
      rays.push_back(border_ray(camera, middle, p));
  }
  return rays;
}

/// Pixels per radian around a direction.
std::optional<double> px_per_rad(const Lens& lens, const Vec3& direction) {
  Mat23 J;
  if (!project(lens, direction, &J)) return std::nullopt;
  const Vec3 a = direction.unitOrthogonal(), b = direction.cross(a);
  return std::sqrt(std::abs((J * a).x() * (J * b).y() - (J * a).y() * (J * b).x()));
}

void fill_map(const Camera& camera, TangentView& view) {
  const cv::Size grid((view.size.width - 1) / kMapStep + 2, (view.size.height - 1) / kMapStep + 2);
  cv::Mat nodes(grid, CV_32FC2);
  for (int r = 0; r < grid.height; ++r) {
    for (int c = 0; c < grid.width; ++c) {
      const auto px = camera_px(camera, view, Vec2(c * kMapStep, r * kMapStep));
      nodes.at<cv::Vec2f>(r, c) = px ? cv::Vec2f(static_cast<float>(px->x()), static_cast<float>(px->y()))
                                     : cv::Vec2f(kNowhere, kNowhere);
    }
  }
  view.map.create(view.size.height, view.size.width, CV_32FC2);
  for (int y = 0; y < view.size.height; ++y) {
    auto* row = view.map.ptr<cv::Vec2f>(y);
    const int r = y / kMapStep;
    const float v = static_cast<float>(y % kMapStep) / kMapStep;
    for (int x = 0; x < view.size.width; ++x) {
      const int c = x / kMapStep;
      const float u = static_cast<float>(x % kMapStep) / kMapStep;
      const auto *a = nodes.ptr<cv::Vec2f>(r) + c, *b = nodes.ptr<cv::Vec2f>(r + 1) + c;
      const bool is_known =
          a[0][0] > kNowhere && a[1][0] > kNowhere && b[0][0] > kNowhere && b[1][0] > kNowhere;
      row[x] = is_known ? (a[0] * (1 - u) + a[1] * u) * (1 - v) + (b[0] * (1 - u) + b[1] * u) * v
                        : cv::Vec2f(kNowhere, kNowhere);
    }
  }
}

/// A view of the rays with |x / z| <= half.x, |y / z| <= half.y after turning by R.
std::optional<TangentView> make_view(const Camera& camera, const Mat3& R_view_cam, const Vec2& half) {
  const auto focal = px_per_rad(camera.lens, R_view_cam.row(2).transpose());
  if (!focal) return std::nullopt;
  TangentView view;
  view.R_view_cam = R_view_cam;
  view.focal_px = std::min(*focal, kMostPx / (2 * half.maxCoeff()));
  view.size = {static_cast<int>(2 * half.x() * view.focal_px),
               static_cast<int>(2 * half.y() * view.focal_px)};
  if (view.size.width < 32 || view.size.height < 32) return std::nullopt;
  fill_map(camera, view);
  return view;
}

}  // namespace

std::vector<TangentView> tangent_views(const Camera& camera) {
  double widest = 0;
  Vec2 half = Vec2::Constant(0.05);
  for (const Vec3& ray : border_rays(camera)) {
    widest = std::max(widest, std::acos(std::clamp(ray.z(), -1.0, 1.0)));
    if (ray.z() > 0.1) half = half.cwiseMax((ray.head<2>() / ray.z()).cwiseAbs());
  }
  std::vector<TangentView> out;
  const auto add = [&](const Mat3& R, const Vec2& h) {
    if (auto view = make_view(camera, R, h)) out.push_back(*std::move(view));
  };
  if (widest <= kOneView) {
    add(Mat3::Identity(), half);
    return out;
  }
  const Vec2 square = Vec2::Constant(std::tan(kHalfAngle));
  add(Mat3::Identity(), square);
  for (const double ring : {kInnerRing, kOuterRing}) {
    if (ring == kOuterRing && widest < kOuterFrom) continue;
    for (int i = 0; i < kRingViews; ++i) {
      const double around = 2 * std::numbers::pi * i / kRingViews;
      const Vec3 axis(-std::sin(around), std::cos(around), 0);  // z turns towards (cos, sin, 0)
      add(Eigen::AngleAxisd(ring, axis).toRotationMatrix().transpose(), square);
    }
  }
  return out;
}

cv::Mat warp(const cv::Mat& grey, const TangentView& view) {
  cv::Mat out;
  cv::remap(grey, out, view.map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::mean(grey));
  return out;
}

std::optional<Vec2> camera_px(const Camera& camera, const TangentView& view, const Vec2& view_px) {
  const Vec2 middle((view.size.width - 1) / 2.0, (view.size.height - 1) / 2.0);
  const Vec2 p = (view_px - middle) / view.focal_px;
  return project(camera, view.R_view_cam.transpose() * Vec3(p.x(), p.y(), 1));
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
// A world that OpenCV projects, and the files of it that `plumbline geometry` reads.
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <random>

#include "plumbline/core/types.hpp"
#include "support/support.hpp"

namespace plumbline::test {

using Json = nlohmann::json;

inline Mat3 to_eigen(const cv::Matx33d& M) {
  Mat3 out;
  for (int i = 0; i < 9; ++i) out(i / 3, i % 3) = M(i / 3, i % 3);
  return out;
}

/// A JSON list of numbers, or of rows of numbers, row by row.
inline VecX numbers_of(const Json& json) {
  std::vector<double> all;
  for (const Json& item : json) {
    if (item.is_number()) all.push_back(item);
    if (item.is_array()) all.insert(all.end(), item.begin(), item.end());
  }
  return Eigen::Map<VecX>(all.data(), static_cast<Eigen::Index>(all.size()));
}
inline Mat3 mat3_of(const Json& json) {
  const VecX v = numbers_of(json);
  EXPECT_EQ(v.size(), 9);
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}
inline Vec3 vec3_of(const Json& json) {
  const VecX v = numbers_of(json);
  EXPECT_EQ(v.size(), 3);
  return v;
}

/// Two views of 40 points of space (or of a plane) by one Brown-Conrady camera.
struct World {
  cv::Matx33d K{600, 0, 330, 0, 610, 235, 0, 0, 1};
  cv::Mat distortion = (cv::Mat_<double>(1, 5) << -0.2, 0.05, 0.001, -0.001, 0.0);
  cv::Vec3d rvec_1{0.1, -0.05, 0.02}, tvec_1{-0.1, 0.05, 2.0}, rvec_2{0.05, 0.15, -0.03},
      tvec_2{-0.6, 0.1, 2.1};
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> px1, px2;

  explicit World(bool flat = false, bool distorted = true, double noise_px = 0, int n = 40) {
    if (!distorted) distortion = cv::Mat::zeros(1, 5, CV_64F);
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int i = 0; i < n; ++i) {
      const double x = uniform(random), y = uniform(random), z = uniform(random);
      points.emplace_back(0.7 * x, 0.5 * y, flat ? 0.0 : 0.4 * z);
    }
    cv::projectPoints(points, rvec_1, tvec_1, K, distortion, px1);
    cv::projectPoints(points, rvec_2, tvec_2, K, distortion, px2);
    std::normal_distribution<double> normal(0, noise_px);
    for (auto* px : {&px1, &px2}) {
      for (cv::Point2d& p : *px)
        if (noise_px > 0) p += cv::Point2d(normal(random), normal(random));
    }
  }

  Mat3 R1() const { return rotation(rvec_1); }
  Mat3 R2() const { return rotation(rvec_2); }
  Vec3 t1() const { return {tvec_1[0], tvec_1[1], tvec_1[2]}; }
  Vec3 t2() const { return {tvec_2[0], tvec_2[1], tvec_2[2]}; }
  Mat3 R_2_1() const { return R2() * R1().transpose(); }
  Vec3 t_2_1() const { return t2() - R_2_1() * t1(); }

  static Mat3 rotation(const cv::Vec3d& rvec) {
    cv::Matx33d R;
    cv::Rodrigues(rvec, R);
    return to_eigen(R);
  }

  std::string camera_yaml(const std::string& name = "cam") const {
    return fmt::format(
        "camera_name: {}\nimage_width: 640\nimage_height: 480\ncamera_matrix: {{rows: 3, cols: 3, data: "
        "[{}, 0, {}, 0, {}, {}, 0, 0, 1]}}\ndistortion_model: plumb_bob\ndistortion_coefficients: "
        "{{rows: 1, cols: 5, data: [{}, {}, {}, {}, {}]}}\nrectification_matrix: {{rows: 3, cols: 3, "
        "data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}\nprojection_matrix: {{rows: 3, cols: 4, data: [{}, 0, {}, "
        "0, 0, {}, {}, 0, 0, 0, 1, 0]}}\n",
        name, K(0, 0), K(0, 2), K(1, 1), K(1, 2), distortion.at<double>(0), distortion.at<double>(1),
        distortion.at<double>(2), distortion.at<double>(3), distortion.at<double>(4), K(0, 0), K(0, 2),
        K(1, 1), K(1, 2));
  }
  std::string sights_csv() const {
    std::string text = "X,Y,Z,u,v\n";
    for (std::size_t i = 0; i < points.size(); ++i)
      text += fmt::format("{:.17g},{:.17g},{:.17g},{:.17g},{:.17g}\n", points[i].x, points[i].y, points[i].z,
                          px1[i].x, px1[i].y);
    return text;
  }
  std::string matches_csv() const {
    std::string text = "u1,v1,u2,v2\n";
    for (std::size_t i = 0; i < points.size(); ++i)
      text += fmt::format("{:.17g},{:.17g},{:.17g},{:.17g}\n", px1[i].x, px1[i].y, px2[i].x, px2[i].y);
    return text;
  }
  /// A transform as 12 numbers, row by row.
  static std::string pose_text(const Mat3& R, const Vec3& t) {
    std::string text;
    for (int r = 0; r < 3; ++r)
      text += fmt::format("{:.17g} {:.17g} {:.17g} {:.17g}\n", R(r, 0), R(r, 1), R(r, 2), t[r]);
    return text;
  }
};

}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
// Homographies: from points, among outliers, and back to the motion.
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "geometry/geometry.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/homography.hpp"
#include "plumbline/linear/plane_motion.hpp"
#include "plumbline/refine/homography.hpp"

namespace plumbline::bench {
namespace {

// A plane before two cameras, 0.5 px of noise in both images.
struct PlaneProblem {
  Mat3 K1, K2, R;
  Vec3 t_over_d, normal_1;
  Mat3 H;
  Pairs pairs;
};

Mat3 random_turn(Rng& rng, double size) {
  const double a = rng.normal(size), b = rng.normal(size);
  return so3_exp(Vec3(a, b, rng.normal(size)));
}

std::vector<PlaneProblem> plane_problems(int n_problems, int n_points, double outlier_share,
                                         std::uint64_t seed) {
  Rng rng(seed);
  std::vector<PlaneProblem> list;
  while (static_cast<int>(list.size()) < n_problems) {
    PlaneProblem p;
    p.K1 = random_k(rng), p.K2 = random_k(rng);
    p.R = random_turn(rng, 0.15);
    const double x = rng.normal(0.2), y = rng.normal(0.2);
    p.t_over_d = Vec3(x, y, rng.normal(0.2));
    const double nx = rng.normal(0.4);
    p.normal_1 = Vec3(nx, rng.normal(0.4), 1).normalized();
    p.H = p.K2 * (p.R + p.t_over_d * p.normal_1.transpose()) * p.K1.inverse();
    int seen = 0;
    for (int tries = 0; tries < 20 * n_points && seen < n_points; ++tries) {
      const Vec2 a = random_pixel(rng);
      const Vec3 q = p.H * a.homogeneous();
      if (!(q.z() > 0.1) || !in_image(q.hnormalized())) continue;
      const Vec2 b = rng.uniform() < outlier_share ? random_pixel(rng) : noisy(rng, q.hnormalized());
      p.pairs.add(noisy(rng, a), b);
      ++seen;
    }
    if (seen == n_points) list.push_back(std::move(p));
  }
  return list;
}

// Root mean square over a 5 x 5 grid of the image of the distance between the two predictions [px].
double transfer_error_px(const Mat3& H, const Mat3& truth) {
  double sum = 0;
  int n = 0;
  for (int i = 0; i < 5; ++i) {
    for (int j = 0; j < 5; ++j) {
      const Vec3 a(i * 0.25 * (kSize.width - 1), j * 0.25 * (kSize.height - 1), 1);
      const Vec3 b = truth * a;
      if (b.z() < 0.1 || !in_image(b.hnormalized())) continue;
      sum += ((H * a).hnormalized() - b.hnormalized()).squaredNorm();
      ++n;
    }
  }
  return n > 0 ? std::sqrt(sum / n) : 0.0;
}

double error_px(const PlaneProblem& p, const Mat3& H) { return transfer_error_px(H, p.H); }

std::optional<Mat3> answer_of(const cv::Mat& H) {
  if (H.empty()) return std::nullopt;
  return to_mat3(H);
}

void add_from_points(std::vector<Method>& list) {
  const std::string group = "homography, 100 points [px]";
  const auto problems = share(plane_problems(200, 100, 0, 1));
  list.push_back(method(
      group, "homography", 10, problems,
      [](const PlaneProblem& p) -> std::optional<Mat3> {
        const auto H = homography(p.pairs.px1, p.pairs.px2);
        if (!H) return std::nullopt;
        return *H;
      },
      error_px));
  list.push_back(method(
      group, "homography + refine_homography", 10, problems,
      [](const PlaneProblem& p) -> std::optional<Mat3> {
        const auto H = homography(p.pairs.px1, p.pairs.px2);
        if (!H) return std::nullopt;
        const auto refined =
            refine_homography(*H, p.pairs.px1, p.pairs.px2, kNoise_px, HomographyNoise::kBoth);
        if (!refined) return std::nullopt;
        return refined->H;
      },
      error_px));
  list.push_back(method(
      group, "cv::findHomography(0)", 10, problems,
      [](const PlaneProblem& p) { return answer_of(cv::findHomography(p.pairs.cv1, p.pairs.cv2, 0)); },
      error_px));
}

void add_among_outliers(std::vector<Method>& list) {
  const std::string group = "homography, 300 points, 40 % outliers [px]";
  const auto problems = share(plane_problems(200, 300, 0.4, 2));
  list.push_back(method(
      group, "homography_ransac", 10, problems,
      [](const PlaneProblem& p) -> std::optional<Mat3> {
        const auto found = homography_ransac(p.pairs.px1, p.pairs.px2, {.inlier_px = 2, .confidence = 0.999});
        if (!found) return std::nullopt;
        return found->model;
      },
      error_px));
  for (const auto& [name, how] : {std::pair{"cv::findHomography(RANSAC)", int(cv::RANSAC)},
                                  std::pair{"cv::findHomography(USAC_DEFAULT)", int(cv::USAC_DEFAULT)}}) {
    list.push_back(method(
        group, name, 10, problems,
        [how = how](const PlaneProblem& p) {
          return answer_of(
              cv::findHomography(p.pairs.cv1, p.pairs.cv2, how, 2.0, cv::noArray(), 2000, 0.999));
        },
        error_px));
  }
}

// The error of the answer nearest to the truth: both give several.
void add_decomposition(std::vector<Method>& list) {
  const std::string group = "homography into R, t and n [deg]";
  const auto problems = share(plane_problems(200, 4, 0, 3));
  using Rotations = std::vector<Mat3>;
  const auto nearest = [](const PlaneProblem& p, const Rotations& all) {
    double best = 180;
    for (const Mat3& R : all) best = std::min(best, angle_deg(Mat3(R * p.R.transpose())));
    return best;
  };
  list.push_back(method(
      group, "plane_motions", 1, problems,
      [](const PlaneProblem& p) -> std::optional<Rotations> {
        const auto motions = plane_motions(p.H, p.K1, p.K2);
        if (!motions) return std::nullopt;
        Rotations all;
        for (const PlaneMotion& m : *motions) all.push_back(m.R);
        return all;
      },
      nearest));
  list.push_back(method(
      group, "cv::decomposeHomographyMat", 1, problems,
      [](const PlaneProblem& p) -> std::optional<Rotations> {
        // OpenCV knows one K only: hand it the homography of the normalised images.
        std::vector<cv::Mat> R, t, n;
        cv::decomposeHomographyMat(cv::Mat(to_cv(Mat3(p.K2.inverse() * p.H * p.K1))),
                                   cv::Mat::eye(3, 3, CV_64F), R, t, n);
        Rotations all;
        for (const cv::Mat& r : R) all.push_back(to_mat3(r));
        return all;
      },
      nearest));
}

}  // namespace

void add_plane_methods(std::vector<Method>& list) {
  add_from_points(list);
  add_among_outliers(list);
  add_decomposition(list);
}

}  // namespace plumbline::bench

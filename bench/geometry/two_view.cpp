// SPDX-License-Identifier: Apache-2.0
// Fundamental and essential matrices: from points, minimal, and among outliers.
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "geometry/geometry.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/essential.hpp"
#include "plumbline/linear/fundamental.hpp"
#include "plumbline/refine/fundamental.hpp"
#include "plumbline/refine/relative_pose.hpp"

namespace plumbline::bench {
namespace {

// A scene with depth before two cameras of one kind, 0.5 px of noise in both images.
struct SceneProblem {
  Mat3 K;
  cv::Matx33d cv_K;
  Lens lens = Pinhole{};
  SE3 T_2_1;
  Mat3 F;
  Pairs pairs;    // noisy, perhaps with outliers
  Pairs minimal;  // the first five or seven, exact
  Pairs truth;    // exact, others than `pairs`
};

SE3 random_motion(Rng& rng) {
  const double a = rng.normal(0.1), b = rng.normal(0.1), c = rng.normal(0.1);
  const double x = rng.normal(), y = rng.normal();
  return {so3_exp(Vec3(a, b, c)), Vec3(x, y, 0.5 * rng.normal()).normalized()};
}

std::vector<SceneProblem> scene_problems(int n_problems, int n_points, double outlier_share,
                                         std::uint64_t seed) {
  Rng rng(seed);
  std::vector<SceneProblem> list;
  while (static_cast<int>(list.size()) < n_problems) {
    SceneProblem p;
    p.K = random_k(rng);
    p.cv_K = to_cv(p.K);
    p.lens = Pinhole{p.K(0, 0), p.K(1, 1), p.K(0, 2), p.K(1, 2)};
    p.T_2_1 = random_motion(rng);
    p.F = p.K.transpose().inverse() * skew(p.T_2_1.t()) * p.T_2_1.R() * p.K.inverse();
    const auto pair = [&]() -> std::optional<std::pair<Vec2, Vec2>> {
      const Vec2 a = random_pixel(rng);
      const Vec3 x = p.T_2_1 * Vec3(rng.uniform(4, 12) * (p.K.inverse() * a.homogeneous()));
      const Vec2 b = (p.K * x).hnormalized();
      if (x.z() < 0.5 || !in_image(b)) return std::nullopt;
      return std::pair{a, b};
    };
    for (int tries = 0; tries < 20 * n_points && p.pairs.px1.size() < static_cast<std::size_t>(n_points);
         ++tries) {
      const auto ab = pair();
      if (!ab) continue;
      if (p.minimal.px1.size() < 7) p.minimal.add(ab->first, ab->second);
      const Vec2 b = rng.uniform() < outlier_share ? random_pixel(rng) : noisy(rng, ab->second);
      p.pairs.add(noisy(rng, ab->first), b);
      if (const auto other = pair()) p.truth.add(other->first, other->second);
    }
    if (p.pairs.px1.size() == static_cast<std::size_t>(n_points) && p.truth.px1.size() > 5)
      list.push_back(std::move(p));
  }
  return list;
}

// Root mean square Sampson distance of exact pairs from F [px], written out here once more.
double error_px(const SceneProblem& p, const Mat3& F) {
  double sum = 0;
  for (std::size_t i = 0; i < p.truth.px1.size(); ++i) {
    const Vec3 a = p.truth.px1[i].homogeneous(), b = p.truth.px2[i].homogeneous();
    const Vec3 l2 = F * a, l1 = F.transpose() * b;
    sum += std::pow(b.dot(l2), 2) / (l2.head<2>().squaredNorm() + l1.head<2>().squaredNorm());
  }
  return std::sqrt(sum / static_cast<double>(p.truth.px1.size()));
}

std::optional<Mat3> answer_of(const cv::Mat& F) {
  if (F.rows != 3 || F.cols != 3) return std::nullopt;
  return to_mat3(F);
}

void add_fundamental(std::vector<Method>& list) {
  const std::string group = "fundamental matrix, 100 points [px]";
  const auto problems = share(scene_problems(200, 100, 0, 11));
  list.push_back(method(
      group, "fundamental_8point", 10, problems,
      [](const SceneProblem& p) -> std::optional<Mat3> {
        const auto F = fundamental_8point(p.pairs.px1, p.pairs.px2);
        if (!F) return std::nullopt;
        return *F;
      },
      error_px));
  list.push_back(method(
      group, "fundamental_8point + refine_fundamental", 10, problems,
      [](const SceneProblem& p) -> std::optional<Mat3> {
        const auto F = fundamental_8point(p.pairs.px1, p.pairs.px2);
        if (!F) return std::nullopt;
        const auto refined = refine_fundamental(*F, p.pairs.px1, p.pairs.px2, kNoise_px);
        if (!refined) return std::nullopt;
        return refined->F;
      },
      error_px));
  list.push_back(method(
      group, "cv::findFundamentalMat(8POINT)", 10, problems,
      [](const SceneProblem& p) {
        return answer_of(cv::findFundamentalMat(p.pairs.cv1, p.pairs.cv2, cv::FM_8POINT));
      },
      error_px));
}

void add_seven_points(std::vector<Method>& list) {
  const std::string group = "fundamental matrix, 7 exact points [px]";
  const auto problems = share(scene_problems(1000, 8, 0, 12));
  using Answers = std::vector<Mat3>;
  const auto nearest = [](const SceneProblem& p, const Answers& all) {
    double best = 1e9;
    for (const Mat3& F : all) best = std::min(best, error_px(p, F));
    return best;
  };
  list.push_back(method(
      group, "fundamental_7point", 0.01, problems,
      [](const SceneProblem& p) -> std::optional<Answers> {
        const auto all = fundamental_7point(p.minimal.px1, p.minimal.px2);
        if (!all) return std::nullopt;
        return *all;
      },
      nearest));
  list.push_back(method(
      group, "cv::findFundamentalMat(7POINT)", 0.01, problems,
      [](const SceneProblem& p) -> std::optional<Answers> {
        const cv::Mat M = cv::findFundamentalMat(p.minimal.cv1, p.minimal.cv2, cv::FM_7POINT);
        Answers all;
        for (int r = 0; r + 3 <= M.rows; r += 3) all.push_back(to_mat3(M.rowRange(r, r + 3)));
        return all;
      },
      nearest));
}

void add_robust_fundamental(std::vector<Method>& list) {
  const std::string group = "fundamental matrix, 300 points, 40 % outliers [px]";
  const auto problems = share(scene_problems(200, 300, 0.4, 13));
  list.push_back(method(
      group, "fundamental_ransac", 10, problems,
      [](const SceneProblem& p) -> std::optional<Mat3> {
        const auto found =
            fundamental_ransac(p.pairs.px1, p.pairs.px2, {.inlier_px = 1.5, .confidence = 0.999});
        if (!found) return std::nullopt;
        return found->model;
      },
      error_px));
  for (const auto& [name, how] : {std::pair{"cv::findFundamentalMat(RANSAC)", int(cv::FM_RANSAC)},
                                  std::pair{"cv::findFundamentalMat(USAC_DEFAULT)", int(cv::USAC_DEFAULT)}}) {
    list.push_back(method(
        group, name, 10, problems,
        [how = how](const SceneProblem& p) {
          return answer_of(cv::findFundamentalMat(p.pairs.cv1, p.pairs.cv2, how, 1.5, 0.999, 5000));
        },
        error_px));
  }
}

void add_five_points(std::vector<Method>& list) {
  const std::string group = "essential matrix, 5 exact points [px]";
  const auto problems = share(scene_problems(1000, 8, 0, 16));
  using Answers = std::vector<Mat3>;
  const auto nearest = [](const SceneProblem& p, const Answers& all) {
    double best = 1e9;
    for (const Mat3& E : all)
      best = std::min(best, error_px(p, p.K.transpose().inverse() * E * p.K.inverse()));
    return best;
  };
  list.push_back(method(
      group, "essential_5point", 0.01, problems,
      [](const SceneProblem& p) -> std::optional<Answers> {
        std::array<Vec3, 5> a, b;
        for (std::size_t i = 0; i < 5; ++i) {
          a[i] = unproject(p.lens, p.minimal.px1[i]).value();
          b[i] = unproject(p.lens, p.minimal.px2[i]).value();
        }
        const auto all = essential_5point(a, b);
        if (!all) return std::nullopt;
        return *all;
      },
      nearest));
  list.push_back(method(
      group, "cv::findEssentialMat", 0.01, problems,
      [](const SceneProblem& p) -> std::optional<Answers> {
        const std::vector<cv::Point2d> a(p.minimal.cv1.begin(), p.minimal.cv1.begin() + 5);
        const std::vector<cv::Point2d> b(p.minimal.cv2.begin(), p.minimal.cv2.begin() + 5);
        const cv::Mat M = cv::findEssentialMat(a, b, cv::Mat(p.cv_K));
        Answers all;
        for (int r = 0; r + 3 <= M.rows; r += 3) all.push_back(to_mat3(M.rowRange(r, r + 3)));
        return all;
      },
      nearest));
}

// Direction of the baseline, which is what noise hits hardest.
double direction_error_deg(const SceneProblem& p, const SE3& T_2_1) {
  return angle_deg(T_2_1.t(), p.T_2_1.t());
}

std::optional<SE3> opencv_pose(const SceneProblem& p, int how) {
  cv::Mat mask;
  const cv::Mat E =
      cv::findEssentialMat(p.pairs.cv1, p.pairs.cv2, cv::Mat(p.cv_K), how, 0.999, 1.5, 5000, mask);
  if (E.rows != 3) return std::nullopt;
  cv::Mat R, t;
  cv::recoverPose(E, p.pairs.cv1, p.pairs.cv2, cv::Mat(p.cv_K), R, t, mask);
  return SE3(to_mat3(R), Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2)));
}

void add_robust_essential(std::vector<Method>& list, double outlier_share, const std::string& group,
                          std::uint64_t seed) {
  const auto problems = share(scene_problems(200, 300, outlier_share, seed));
  const auto ours = [](const SceneProblem& p) -> std::optional<Found<RelativePose>> {
    const auto found =
        essential_ransac(p.lens, p.lens, p.pairs.px1, p.pairs.px2, {.inlier_px = 1.5, .confidence = 0.999});
    if (!found) return std::nullopt;
    return *found;
  };
  list.push_back(method(
      group, "essential_ransac", 5, problems,
      [ours](const SceneProblem& p) -> std::optional<SE3> {
        const auto found = ours(p);
        if (!found) return std::nullopt;
        return found->model.T_2_1;
      },
      direction_error_deg));
  list.push_back(method(
      group, "essential_ransac + refine_relative_pose", 5, problems,
      [ours](const SceneProblem& p) -> std::optional<SE3> {
        const auto found = ours(p);
        if (!found) return std::nullopt;
        std::vector<Vec2> px1, px2;
        for (std::size_t i = 0; i < p.pairs.px1.size(); ++i) {
          if (!found->consensus.inlier[i]) continue;
          px1.push_back(p.pairs.px1[i]), px2.push_back(p.pairs.px2[i]);
        }
        const auto refined = refine_relative_pose(found->model.T_2_1, p.lens, p.lens, px1, px2, kNoise_px);
        if (!refined) return std::nullopt;
        return refined->T_2_1;
      },
      direction_error_deg));
  for (const auto& [name, how] :
       {std::pair{"cv::findEssentialMat(RANSAC) + recoverPose", int(cv::RANSAC)},
        std::pair{"cv::findEssentialMat(USAC_DEFAULT) + recoverPose", int(cv::USAC_DEFAULT)}}) {
    list.push_back(method(
        group, name, 5, problems, [how = how](const SceneProblem& p) { return opencv_pose(p, how); },
        direction_error_deg));
  }
}

}  // namespace

void add_two_view_methods(std::vector<Method>& list) {
  add_fundamental(list);
  add_seven_points(list);
  add_robust_fundamental(list);
  add_five_points(list);
  add_robust_essential(list, 0.0, "essential matrix, 300 points [deg of baseline]", 14);
  add_robust_essential(list, 0.4, "essential matrix, 300 points, 40 % outliers [deg of baseline]", 15);
}

}  // namespace plumbline::bench

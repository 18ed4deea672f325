// SPDX-License-Identifier: Apache-2.0
// The pose of a camera whose lens is known, and the camera matrix of one whose lens is not.
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <span>

#include "geometry/geometry.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/linear/camera_matrix.hpp"
#include "plumbline/linear/p3p.hpp"
#include "plumbline/linear/pose.hpp"
#include "plumbline/refine/pose.hpp"

namespace plumbline::bench {
namespace {

const std::vector<double> kDistortion{-0.28, 0.1, 1e-3, -5e-4, -0.01};

struct PoseProblem {
  Lens lens;
  cv::Matx33d cv_K;
  SE3 T_cam_world;
  std::vector<Vec3> p_world;
  std::vector<Vec2> px;      // noisy, perhaps with outliers
  std::array<Vec3, 4> rays;  // of the first four points, exact
  std::vector<cv::Point3d> cv_p;
  std::vector<cv::Point2d> cv_px, cv_exact_px;
};

Vec3 random_point(Rng& rng, bool flat) {
  const double x = rng.uniform(-1, 1), y = rng.uniform(-1, 1);
  return {x, y, flat ? 0.0 : rng.uniform(-1, 1)};
}

std::vector<PoseProblem> pose_problems(int n_problems, int n_points, bool flat, double outlier_share,
                                       std::uint64_t seed) {
  Rng rng(seed);
  std::vector<PoseProblem> list;
  while (static_cast<int>(list.size()) < n_problems) {
    PoseProblem p;
    const double f = rng.uniform(700, 1400);
    p.lens = OpenCV5{
        f, f, 640, 480, kDistortion[0], kDistortion[1], kDistortion[2], kDistortion[3], kDistortion[4]};
    p.cv_K = cv::Matx33d(f, 0, 640, 0, f, 480, 0, 0, 1);
    const double a = rng.uniform(-0.8, 0.8), b = rng.uniform(-0.8, 0.8);
    const double x = rng.uniform(-0.3, 0.3), y = rng.uniform(-0.3, 0.3);
    p.T_cam_world = SE3(so3_exp(Vec3(a, b, rng.uniform(-2, 2))), Vec3(x, y, rng.uniform(3, 6)));
    for (int i = 0; i < n_points; ++i) {
      const Vec3 q = random_point(rng, flat);
      const auto exact = project(p.lens, p.T_cam_world * q);
      if (!exact || !in_image(*exact)) break;
      const Vec2 px = rng.uniform() < outlier_share ? random_pixel(rng) : noisy(rng, *exact);
      if (i < 4) p.rays[static_cast<std::size_t>(i)] = (p.T_cam_world * q).normalized();
      p.p_world.push_back(q), p.px.push_back(px);
      p.cv_p.emplace_back(q.x(), q.y(), q.z());
      p.cv_px.emplace_back(px.x(), px.y()), p.cv_exact_px.emplace_back(exact->x(), exact->y());
    }
    if (p.px.size() == static_cast<std::size_t>(n_points)) list.push_back(std::move(p));
  }
  return list;
}

// Distance of the camera centre from the truth, in thousandths of the distance to the points.
double error_permille(const PoseProblem& p, const SE3& T) {
  return 1000 * (T.centre() - p.T_cam_world.centre()).norm() / p.T_cam_world.t().norm();
}

std::optional<SE3> answer_of(const cv::Mat& rvec, const cv::Mat& tvec) {
  const Vec3 w(rvec.at<double>(0), rvec.at<double>(1), rvec.at<double>(2));
  const Vec3 t(tvec.at<double>(0), tvec.at<double>(1), tvec.at<double>(2));
  if (!w.allFinite() || !t.allFinite()) return std::nullopt;
  return SE3(so3_exp(w), t);
}

Method opencv_pnp(const std::string& group, const std::string& name, int how,
                  std::shared_ptr<const std::vector<PoseProblem>> problems) {
  return method(
      group, name, 100, std::move(problems),
      [how](const PoseProblem& p) -> std::optional<SE3> {
        cv::Mat rvec, tvec;
        if (!cv::solvePnP(p.cv_p, p.cv_px, p.cv_K, kDistortion, rvec, tvec, false, how)) return std::nullopt;
        return answer_of(rvec, tvec);
      },
      error_permille);
}

std::optional<SE3> ours_linear(const PoseProblem& p) {
  const auto T = pose_from_points(p.lens, p.p_world, p.px);
  if (!T) return std::nullopt;
  return *T;
}

std::optional<SE3> ours_refined(const PoseProblem& p) {
  const auto T = pose_from_points(p.lens, p.p_world, p.px);
  if (!T) return std::nullopt;
  const auto refined = refine_pose(*T, p.lens, p.p_world, p.px, kNoise_px);
  if (!refined) return std::nullopt;
  return refined->T_cam_world;
}

void add_from_points(std::vector<Method>& list) {
  const std::string solid = "pose, 50 points in space, opencv5 [permille]";
  const auto in_space = share(pose_problems(200, 50, false, 0, 21));
  list.push_back(method(solid, "pose_from_points", 100, in_space, ours_linear, error_permille));
  list.push_back(
      method(solid, "pose_from_points + refine_pose", 100, in_space, ours_refined, error_permille));
  list.push_back(opencv_pnp(solid, "cv::solvePnP(EPNP)", cv::SOLVEPNP_EPNP, in_space));
  list.push_back(opencv_pnp(solid, "cv::solvePnP(SQPNP)", cv::SOLVEPNP_SQPNP, in_space));
  list.push_back(opencv_pnp(solid, "cv::solvePnP(ITERATIVE)", cv::SOLVEPNP_ITERATIVE, in_space));
  const std::string flat = "pose, 54 points of a board, opencv5 [permille]";
  const auto on_board = share(pose_problems(200, 54, true, 0, 22));
  list.push_back(method(flat, "pose_from_points", 100, on_board, ours_linear, error_permille));
  list.push_back(method(flat, "pose_from_points + refine_pose", 100, on_board, ours_refined, error_permille));
  list.push_back(opencv_pnp(flat, "cv::solvePnP(IPPE)", cv::SOLVEPNP_IPPE, on_board));
  list.push_back(opencv_pnp(flat, "cv::solvePnP(SQPNP)", cv::SOLVEPNP_SQPNP, on_board));
  list.push_back(opencv_pnp(flat, "cv::solvePnP(ITERATIVE)", cv::SOLVEPNP_ITERATIVE, on_board));
}

void add_three_points(std::vector<Method>& list) {
  const std::string group = "pose, 3 exact points [permille]";
  const auto problems = share(pose_problems(1000, 8, false, 0, 23));
  using Answers = std::vector<SE3>;
  const auto nearest = [](const PoseProblem& p, const Answers& all) {
    double best = 1e9;
    for (const SE3& T : all) best = std::min(best, error_permille(p, T));
    return best;
  };
  list.push_back(method(
      group, "p3p", 0.1, problems,
      [](const PoseProblem& p) -> std::optional<Answers> {
        const std::span<const Vec3, 3> world(p.p_world.data(), 3), rays(p.rays.data(), 3);
        const auto all = p3p(world, rays);
        return Answers(all.begin(), all.end());
      },
      nearest));
  for (const auto& [name, how] : {std::pair{"cv::solveP3P(P3P)", int(cv::SOLVEPNP_P3P)},
                                  std::pair{"cv::solveP3P(AP3P)", int(cv::SOLVEPNP_AP3P)}}) {
    list.push_back(method(
        group, name, 0.1, problems,
        [how = how](const PoseProblem& p) -> std::optional<Answers> {
          const std::vector<cv::Point3d> X(p.cv_p.begin(), p.cv_p.begin() + 3);
          std::vector<cv::Point2d> x;
          for (std::size_t i = 0; i < 3; ++i)
            x.emplace_back(p.rays[i].x() / p.rays[i].z(), p.rays[i].y() / p.rays[i].z());
          std::vector<cv::Mat> rvecs, tvecs;
          cv::solveP3P(X, x, cv::Mat::eye(3, 3, CV_64F), cv::noArray(), rvecs, tvecs, how);
          Answers all;
          for (std::size_t i = 0; i < rvecs.size(); ++i) {
            if (const auto T = answer_of(rvecs[i], tvecs[i])) all.push_back(*T);
          }
          return all;
        },
        nearest));
  }
}

void add_among_outliers(std::vector<Method>& list) {
  const std::string group = "pose, 200 points, 50 % outliers, opencv5 [permille]";
  const auto problems = share(pose_problems(200, 200, false, 0.5, 24));
  list.push_back(method(
      group, "pose_ransac", 100, problems,
      [](const PoseProblem& p) -> std::optional<SE3> {
        const auto found = pose_ransac(p.lens, p.p_world, p.px, {.inlier_px = 2, .confidence = 0.999});
        if (!found) return std::nullopt;
        return found->model;
      },
      error_permille));
  for (const auto& [name, how] : {std::pair{"cv::solvePnPRansac(P3P)", int(cv::SOLVEPNP_P3P)},
                                  std::pair{"cv::solvePnPRansac(ITERATIVE)", int(cv::SOLVEPNP_ITERATIVE)}}) {
    list.push_back(method(
        group, name, 100, problems,
        [how = how](const PoseProblem& p) -> std::optional<SE3> {
          cv::Mat rvec, tvec, inliers;
          if (!cv::solvePnPRansac(p.cv_p, p.cv_px, p.cv_K, kDistortion, rvec, tvec, false, 1000, 2.0F, 0.999,
                                  inliers, how))
            return std::nullopt;
          return answer_of(rvec, tvec);
        },
        error_permille));
  }
}

void add_decomposition(std::vector<Method>& list) {
  const std::string group = "camera matrix into K, R, C [permille]";
  const auto problems = share(pose_problems(200, 8, false, 0, 25));
  const auto P_of = [](const PoseProblem& p) {
    return Mat34(camera_matrix_k(p.lens) * p.T_cam_world.matrix34());
  };
  list.push_back(method(
      group, "decompose_camera_matrix", 1, problems,
      [P_of](const PoseProblem& p) -> std::optional<SE3> {
        const auto parts = decompose_camera_matrix(P_of(p));
        if (!parts) return std::nullopt;
        return parts->T_cam_world();
      },
      error_permille));
  list.push_back(method(
      group, "cv::decomposeProjectionMatrix", 1, problems,
      [P_of](const PoseProblem& p) -> std::optional<SE3> {
        const Mat34 P = P_of(p);
        cv::Matx34d cv_P;
        for (int r = 0; r < 3; ++r)
          for (int c = 0; c < 4; ++c) cv_P(r, c) = P(r, c);
        cv::Mat K, R, C;
        cv::decomposeProjectionMatrix(cv_P, K, R, C);
        const Mat3 rotation = to_mat3(R);
        const Vec3 centre = Vec3(C.at<double>(0), C.at<double>(1), C.at<double>(2)) / C.at<double>(3);
        return SE3(rotation, -rotation * centre);
      },
      error_permille));
}

}  // namespace

void add_pose_methods(std::vector<Method>& list) {
  add_from_points(list);
  add_three_points(list);
  add_among_outliers(list);
  add_decomposition(list);
}

}  // namespace plumbline::bench

// SPDX-License-Identifier: Apache-2.0
#include "detect/planar.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>

namespace plumbline::detail {
namespace {

constexpr double kAgreement = 0.35;  ///< of a marker's side; a marker one place away is wrong by more than 1

std::vector<cv::Point2d> to_cv(std::span<const Vec2> points) {
  std::vector<cv::Point2d> out;
  for (const Vec2& p : points) out.emplace_back(p.x(), p.y());
  return out;
}

/// Largest corner error of b as predicted from a's own four corners, relative to b's side.
double prediction_error(const std::optional<Mat3>& H_a, const PlacedQuad& b) {
  if (!H_a) return 1e9;
  double worst = 0;
  for (int i = 0; i < 4; ++i) {
    const auto predicted = map_point(*H_a, b.board[i]);
    if (!predicted) return 1e9;
    worst = std::max(worst, (*predicted - b.px[i]).norm());
  }
  return worst / side_px(b.px);
}

int find_root(std::vector<int>& parent, int i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

struct Agreement {
  int partners = 0;
  double error = 0;
};

}  // namespace

std::optional<Mat3> fit_plane(std::span<const Vec2> board, std::span<const Vec2> px) {
  if (board.size() < 4) return std::nullopt;
  const cv::Mat H = cv::findHomography(to_cv(board), to_cv(px), 0);
  if (H.empty()) return std::nullopt;
  Mat3 out;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out(r, c) = H.at<double>(r, c);
  if (!out.allFinite()) return std::nullopt;
  if ((out.row(2) * board[0].homogeneous())(0) < 0) out = -out;
  return out;
}

std::optional<Mat3> square_to_quad(const std::array<Vec2, 4>& px) {
  const Vec2 a = px[1] - px[2], b = px[3] - px[2], sum = px[0] - px[1] + px[2] - px[3];
  const double det = a.x() * b.y() - a.y() * b.x();
  const double g = (sum.x() * b.y() - sum.y() * b.x()) / det, h = (a.x() * sum.y() - a.y() * sum.x()) / det;
  // w is 1 + g x + h y: positive on the whole square.
  if (!(1 + g > 1e-6 && 1 + h > 1e-6 && 1 + g + h > 1e-6)) return std::nullopt;
  Mat3 H;
  H.col(0) << px[1] - px[0] + g * px[1], g;
  H.col(1) << px[3] - px[0] + h * px[3], h;
  H.col(2) << px[0], 1;
  return H;
}

std::optional<Vec2> map_point(const Mat3& H, const Vec2& p) {
  const Vec3 q = H * p.homogeneous();
  if (!(q.z() > 1e-12)) return std::nullopt;
  return Vec2(q.hnormalized());
}

Mat2 map_jacobian(const Mat3& H, const Vec2& p) {
  const Vec3 q = H * p.homogeneous();
  const Vec2 px = q.hnormalized();
  Mat2 J = H.topLeftCorner<2, 2>();
  J -= px * H.block<1, 2>(2, 0);
  return J / q.z();
}

double narrow_height(const Mat2& J) {
  const double longer = std::max(J.col(0).norm(), J.col(1).norm());
  return longer > 0 ? std::abs(J.determinant()) / longer : 0;
}

double side_px(const std::array<Vec2, 4>& px) {
  double sum = 0;
  for (int i = 0; i < 4; ++i) sum += (px[(i + 1) % 4] - px[i]).norm();
  return sum / 4;
}

namespace {

/// The n quads (of those listed) nearest to `p_board`, nearest first; ties by index.
std::vector<int> nearest_quads(std::span<const PlacedQuad> quads, std::span<const int> among,
                               const Vec2& p_board, int n) {
  std::vector<int> order(among.begin(), among.end());
  const auto distance = [&](int i) { return (quads[i].board_centre() - p_board).squaredNorm(); };
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return distance(a) < distance(b); });
  if (static_cast<int>(order.size()) > n) order.resize(n);
  return order;
}

}  // namespace

std::optional<Mat3> plane_of(const PlacedQuad& quad) {
  const auto H = square_to_quad(quad.px);
  if (!H) return std::nullopt;
  Mat3 board_from_unit = Mat3::Identity();
  board_from_unit.block<2, 1>(0, 0) = quad.board[1] - quad.board[0];
  board_from_unit.block<2, 1>(0, 1) = quad.board[3] - quad.board[0];
  board_from_unit.block<2, 1>(0, 2) = quad.board[0];
  return Mat3(*H * board_from_unit.inverse());
}

ConsistentQuads consistent_quads(std::span<const PlacedQuad> quads) {
  const int n = static_cast<int>(quads.size());
  std::vector<std::optional<Mat3>> H(n);
  std::vector<int> parent(n), all(n);
  for (int i = 0; i < n; ++i) {
    H[i] = plane_of(quads[i]);
    parent[i] = all[i] = i;
  }
  // Neighbours: the nearest quads on the board, those of the same id not counted.
  constexpr int kNeighbours = 8;
  std::vector<Agreement> agreement(n);
  for (int i = 0; i < n; ++i) {
    int seen = 0;
    for (int j : nearest_quads(quads, all, quads[i].board_centre(), n)) {
      if (quads[j].id == quads[i].id) continue;
      if (++seen > 2 * kNeighbours) break;
      const double error = std::max(prediction_error(H[i], quads[j]), prediction_error(H[j], quads[i]));
      const double steps = (quads[j].board_centre() - quads[i].board_centre()).norm() /
                           (quads[i].board[1] - quads[i].board[0]).norm();
      // A marker's own four corners foretell less well the farther they reach.
      if (error > kAgreement * std::max(1.0, steps / 2)) continue;
      ++agreement[i].partners;
      agreement[i].error += error;
      parent[find_root(parent, i)] = find_root(parent, j);
    }
  }
  std::map<int, std::map<int, int>> components;  // root -> id -> the best quad of that id
  for (int i = 0; i < n; ++i) {
    auto& best = components[find_root(parent, i)];
    const auto [at, is_new] = best.try_emplace(quads[i].id, i);
    if (is_new) continue;
    const Agreement &a = agreement[i], &b = agreement[at->second];
    if (a.partners > b.partners || (a.partners == b.partners && a.error < b.error)) at->second = i;
  }
  ConsistentQuads result;
  const auto largest =
      std::max_element(components.begin(), components.end(),
                       [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (largest == components.end()) return result;
  for (const auto& [id, i] : largest->second) {
    result.index.push_back(i);
  }
  std::sort(result.index.begin(), result.index.end());
  return result;
}

}  // namespace plumbline::detail

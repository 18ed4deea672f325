// SPDX-License-Identifier: Apache-2.0
#include "coverage.hpp"

#include <algorithm>
#include <cmath>

namespace plumbline::detail {
namespace {

// Homography of the unit square (0,0) (1,0) (1,1) (0,1) to a quad (Heckbert 1989, "Fundamentals of texture
// mapping and image warping", section 2.2.3).
Mat3 square_to_quad(const Quad& q) {
  const Vec2 d1 = q[1] - q[2], d2 = q[3] - q[2], s = q[0] - q[1] + q[2] - q[3];
  const double determinant = d1.x() * d2.y() - d1.y() * d2.x();
  const double g = determinant == 0 ? 0 : (s.x() * d2.y() - s.y() * d2.x()) / determinant;
  const double h = determinant == 0 ? 0 : (d1.x() * s.y() - d1.y() * s.x()) / determinant;
  const Vec2 a = q[1] - q[0] + g * q[1], b = q[3] - q[0] + h * q[3];
  Mat3 H;
  H << a.x(), b.x(), q[0].x(), a.y(), b.y(), q[0].y(), g, h, 1;
  return H;
}

Mat3 adjugate(const Mat3& m) {
  Mat3 a;
  a.row(0) = m.col(1).cross(m.col(2));
  a.row(1) = m.col(2).cross(m.col(0));
  a.row(2) = m.col(0).cross(m.col(1));
  return a;
}

// A convex polygon of at most 8 corners: four of the pixel, and one more for each side of a box that cuts it.
struct Polygon {
  std::array<Vec2, 12> p;
  int n = 0;
};

// Keeps the part with sign * (coordinate - limit) >= 0 (Sutherland and Hodgman 1974).
void clip(Polygon& polygon, int axis, double limit, double sign) {
  Polygon kept;
  for (int i = 0; i < polygon.n; ++i) {
    const Vec2 &a = polygon.p[i], &b = polygon.p[(i + 1) % polygon.n];
    const double da = sign * (a[axis] - limit), db = sign * (b[axis] - limit);
    if (da >= 0) kept.p[kept.n++] = a;
    if ((da >= 0) != (db >= 0)) kept.p[kept.n++] = a + da / (da - db) * (b - a);
  }
  polygon = kept;
}

}  // namespace

ShapeIndex::ShapeIndex(const BoardDrawing& drawing) : drawing_(&drawing), low_(drawing.low) {
  const int n_boxes = static_cast<int>(drawing.boxes.size()),
            n_discs = static_cast<int>(drawing.discs.size());
  const Vec2 size = drawing.size();
  // About one shape per cell.
  const double side = std::sqrt(size.x() * size.y() / std::max(1, n_boxes + n_discs));
  for (int axis = 0; axis < 2; ++axis) {
    n_cells_[axis] = std::clamp(static_cast<int>(size[axis] / side), 1, 1000);
    cell_size_[axis] = size[axis] / n_cells_[axis];
  }
  cells_.resize(static_cast<std::size_t>(n_cells_[0] * n_cells_[1]));
  const auto add = [&](int shape, const Vec2& low, const Vec2& high) {
    for (int y = cell(low.y(), 1); y <= cell(high.y(), 1); ++y) {
      for (int x = cell(low.x(), 0); x <= cell(high.x(), 0); ++x)
        cells_[y * n_cells_[0] + x].push_back(shape);
    }
  };
  for (int i = 0; i < n_boxes; ++i) add(i, drawing.boxes[i].low, drawing.boxes[i].high);
  for (int i = 0; i < n_discs; ++i) {
    const Vec2 r = Vec2::Constant(drawing.discs[i].radius);
    add(n_boxes + i, drawing.discs[i].centre - r, drawing.discs[i].centre + r);
  }
}

int ShapeIndex::cell(double x, int axis) const {
  const double i = (x - low_[axis]) / cell_size_[axis];
  return static_cast<int>(std::clamp(i, 0.0, n_cells_[axis] - 1.0));
}

void ShapeIndex::find(const Vec2& low, const Vec2& high, std::vector<int>& found) const {
  found.clear();
  if ((high.array() < drawing_->low.array()).any() || (low.array() > drawing_->high.array()).any()) return;
  const int x0 = cell(low.x(), 0), x1 = cell(high.x(), 0), y0 = cell(low.y(), 1), y1 = cell(high.y(), 1);
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const auto& shapes = cells_[static_cast<std::size_t>(y * n_cells_[0] + x)];
      found.insert(found.end(), shapes.begin(), shapes.end());
    }
  }
  if (x0 == x1 && y0 == y1) return;  // ascending as inserted
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
}

bool ShapeIndex::is_black(const Vec2& p) const {
  if ((p.array() < drawing_->low.array()).any() || (p.array() > drawing_->high.array()).any()) return false;
  for (const int i : cells_[static_cast<std::size_t>(cell(p.y(), 1) * n_cells_[0] + cell(p.x(), 0))]) {
    const int n_boxes = static_cast<int>(drawing_->boxes.size());
    if (i < n_boxes) {
      const Box& box = drawing_->boxes[i];
      if ((p.array() >= box.low.array()).all() && (p.array() <= box.high.array()).all()) return true;
    } else {
      const Disc& disc = drawing_->discs[i - n_boxes];
      if ((p - disc.centre).squaredNorm() <= disc.radius * disc.radius) return true;
    }
  }
  return false;
}

PixelArea::PixelArea(const Quad& quad) : quad_(quad) {
  low_ = quad[0].cwiseMin(quad[1]).cwiseMin(quad[2]).cwiseMin(quad[3]);
  high_ = quad[0].cwiseMax(quad[1]).cwiseMax(quad[2]).cwiseMax(quad[3]);
  H_board_px_ = square_to_quad(quad);
  H_px_board_ = adjugate(H_board_px_);
}

double PixelArea::in_box(const Box& box) const {
  if ((low_.array() >= box.high.array()).any() || (high_.array() <= box.low.array()).any()) return 0;
  if ((low_.array() >= box.low.array()).all() && (high_.array() <= box.high.array()).all()) return 1;
  Polygon polygon;
  std::copy(quad_.begin(), quad_.end(), polygon.p.begin());
  polygon.n = 4;
  for (int axis = 0; axis < 2 && polygon.n > 0; ++axis) {
    clip(polygon, axis, box.low[axis], 1);
    clip(polygon, axis, box.high[axis], -1);
  }
  if (polygon.n < 3) return 0;
  // The area is taken in the image: on a tilted board equal areas are not equal light.
  double twice_area = 0;
  const auto to_px = [this](const Vec2& p) -> Vec2 { return (H_px_board_ * p.homogeneous()).hnormalized(); };
  const Vec2 first = to_px(polygon.p[0]);
  Vec2 before = to_px(polygon.p[1]);
  for (int i = 2; i < polygon.n; ++i) {
    const Vec2 here = to_px(polygon.p[i]);
    twice_area +=
        (before.x() - first.x()) * (here.y() - first.y()) - (before.y() - first.y()) * (here.x() - first.x());
    before = here;
  }
  return std::clamp(0.5 * std::abs(twice_area), 0.0, 1.0);
}

double PixelArea::in_disc(const Disc& disc) const {
  const Vec2 nearest = disc.centre.cwiseMax(low_).cwiseMin(high_);
  const double rr = disc.radius * disc.radius;
  if ((nearest - disc.centre).squaredNorm() >= rr) return 0;
  int n_inside = 0;
  for (const Vec2& p : quad_) n_inside += (p - disc.centre).squaredNorm() <= rr;
  if (n_inside == 4) return 1;
  // The disc in the pixel: u' M u <= 0 for u = (x, y, 1) of the unit square.
  Mat3 C = Mat3::Identity();
  C(0, 2) = C(2, 0) = -disc.centre.x();
  C(1, 2) = C(2, 1) = -disc.centre.y();
  C(2, 2) = disc.centre.squaredNorm() - rr;
  const Mat3 M = H_board_px_.transpose() * C * H_board_px_;
  // Lines across the pixel in the direction in which the edge is crossed most steeply, each cut exactly; the
  // mean of 32 of them.
  const Vec3 gradient = M * Vec3(0.5, 0.5, 1);
  const int along = std::abs(gradient.x()) > std::abs(gradient.y()) ? 0 : 1, across = 1 - along;
  constexpr int kLines = 32;
  double sum = 0;
  for (int i = 0; i < kLines; ++i) {
    const double u = (i + 0.5) / kLines;
    const double a = M(along, along), half_b = M(along, across) * u + M(along, 2);
    const double c = M(across, across) * u * u + 2 * M(across, 2) * u + M(2, 2);
    const double discriminant = half_b * half_b - a * c;
    if (!(discriminant > 0) || !(a > 0)) continue;
    const double root = std::sqrt(discriminant);
    sum += std::max(0.0, std::min(1.0, (-half_b + root) / a) - std::max(0.0, (-half_b - root) / a));
  }
  return sum / kLines;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include "refine/spline_view.hpp"

#include <algorithm>
#include <cmath>

namespace plumbline::detail {

bool place_corners(const Splined& lens, const SE3& T_cam_board, const ViewCorners& corners,
                   int* first_knots) {
  const Mat3 R = T_cam_board.R();
  const Vec3 t = T_cam_board.t();
  const int n = corners.n_padded();
  const double* at = corners.points->data();
  for (int i = 0; i < corners.n; ++i) {
    const auto first = lens.first_knots(stereographic(R * Vec3(at[i], at[n + i], at[2 * n + i]) + t));
    if (!first) return false;
    first_knots[2 * i] = (*first)[0], first_knots[2 * i + 1] = (*first)[1];
  }
  return true;
}

void SplinePatch::add(const Splined& lens, const int* first_knots, int n_corners) {
  for (int c = 0; c < n_corners; ++c) {
    const int x = first_knots[2 * c], y = first_knots[2 * c + 1];
    for (int j = y; j <= y + lens.order; ++j) {
      KnotRange& range = ranges[static_cast<std::size_t>(j)];
      const bool empty = range.to == 0;
      range.from = empty ? x : std::min(range.from, x);
      range.to = std::max(range.to, x + lens.order + 1);
    }
  }
}

void SplinePatch::lay_out(const Splined& lens, int lens_at, int row, std::vector<Segment>& segments) {
  first_row = row;
  n_rows = 0;
  row_of_knots.assign(ranges.size(), 0);
  for (int j = 0; j < lens.n_y; ++j) {
    const KnotRange& range = ranges[static_cast<std::size_t>(j)];
    if (range.to == 0) continue;
    const int n = 2 * (range.to - range.from);
    row_of_knots[static_cast<std::size_t>(j)] = n_rows - 2 * range.from;
    segments.push_back({lens_at + lens.control_point(range.from, j), n});
    n_rows += n;
  }
}

void SplineSums::clear(const Splined& lens, int n_columns) {
  band.assign(static_cast<std::size_t>(kSplineBand * lens.n_x * lens.n_y), 0.0);
  strip.setZero(2 * lens.n_x * lens.n_y, n_columns);
  g.setZero(2 * lens.n_x * lens.n_y);
}

void SplineSums::add(const SplineSums& other) {
  for (std::size_t i = 0; i < band.size(); ++i) band[i] += other.band[i];
  strip += other.strip;
  g += other.g;
}

std::optional<double> accumulate_spline(const ViewQuestion& q, const int* first_knots,
                                        const SplinePatch& patch, Gram& gram, std::vector<double>& band,
                                        MatX& control) {
  const auto& lens = std::get<Splined>(q.lens);
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = q.T_cam_board.R();
  const Vec3 t = q.T_cam_board.t();
  const double cost = best_kernels().spline({.at = {lens.k.data(), R.data(), t.data()},
                                             .order = lens.order,
                                             .n_x = lens.n_x,
                                             .n_y = lens.n_y,
                                             .knots_per_unit = lens.knots_per_unit(),
                                             .points = q.corners.points->data(),
                                             .px = q.corners.px.data(),
                                             .n = q.corners.n,
                                             .n_padded = q.corners.n_padded(),
                                             .first_knots = first_knots,
                                             .row_of_knots = patch.row_of_knots.data(),
                                             .n_rows = patch.n_rows,
                                             .loss = static_cast<int>(q.loss),
                                             .loss_scale = q.loss_scale},
                                            {gram.lower, band.data(), control.data()});
  if (!std::isfinite(cost)) return std::nullopt;
  return cost;
}

void expand_band(const Splined& lens, const std::vector<double>& band, int lens_at, MatX& A) {
  const double square[2] = {lens.k[0] * lens.k[0], lens.k[1] * lens.k[1]};
  for (int j = 0; j < lens.n_y; ++j) {
    for (int i = 0; i < lens.n_x; ++i) {
      const double* own = &band[static_cast<std::size_t>(kSplineBand * (j * lens.n_x + i))];
      const int at = lens_at + lens.control_point(i, j);
      for (int dj = 0; dj <= lens.order && j + dj < lens.n_y; ++dj) {
        for (int di = dj == 0 ? 0 : -lens.order; di <= lens.order; ++di) {
          if (i + di < 0 || i + di >= lens.n_x) continue;
          const int to = lens_at + lens.control_point(i + di, j + dj);
          for (int axis = 0; axis < 2; ++axis) A(to + axis, at + axis) += square[axis] * own[7 * dj + 3 + di];
        }
      }
    }
  }
}

double add_regularisation(const Lens& lens, double scale, int lens_at, MatX& A, VecX& g) {
  const auto k = params(lens);
  double sum = 0;
  for (const PriorRow& row : priors(lens)) {
    const double w[2] = {scale * row.weight[0], scale * row.weight[1]};
    const int at[2] = {row.index[0], row.index[1]};
    const double r = w[0] * k[static_cast<std::size_t>(at[0])] + w[1] * k[static_cast<std::size_t>(at[1])];
    sum += r * r;
    for (int i = 0; i < 2; ++i) {
      g[lens_at + at[i]] += w[i] * r;
      for (int j = 0; j < 2; ++j) {
        if (at[i] >= at[j]) A(lens_at + at[i], lens_at + at[j]) += w[i] * w[j];
      }
    }
  }
  return 0.5 * sum;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
// The kernel of splined lenses, for the view_kernel_*.cpp. A corner touches few of a spline's many
// parameters, so it is the corner's own small products that are made several numbers at a time here, not
// several corners. Internal linkage on purpose: see view_kernel_sets.hpp.
#include "refine/view_kernel_sets.hpp"

namespace plumbline::detail {
namespace {

// Values and slopes of the kOrder + 1 uniform B-splines that are not zero at x, the distance from the knot
// after the first of them (lens/splined.cpp).
template <int kOrder>
inline __attribute__((always_inline)) void splines_at(double x, double* value, double* slope) {
  if constexpr (kOrder == 2) {
    value[0] = 0.5 * (0.5 - x) * (0.5 - x), value[1] = 0.75 - x * x, value[2] = 0.5 * (0.5 + x) * (0.5 + x);
    slope[0] = x - 0.5, slope[1] = -2 * x, slope[2] = x + 0.5;
  } else {
    const double y = 1 - x;
    value[0] = y * y * y / 6, value[1] = 2.0 / 3 - x * x * (1 - 0.5 * x);
    value[2] = 2.0 / 3 - y * y * (1 - 0.5 * y), value[3] = x * x * x / 6;
    slope[0] = -0.5 * y * y, slope[1] = x * (1.5 * x - 2), slope[2] = y * (2 - 1.5 * y),
    slope[3] = 0.5 * x * x;
  }
}

// m = u + c(u), d(m)/d(u), and how much each control point has of c.
template <int kOrder>
struct SplineAt {
  double m[2], J[4], weight[kOrder + 1][kOrder + 1];
};

template <int kOrder>
inline __attribute__((always_inline)) void evaluate_spline(const SplineInput& in, int first_x, int first_y,
                                                           double u_x, double u_y, SplineAt<kOrder>& at) {
  constexpr int kN = kOrder + 1;
  const double s = in.knots_per_unit;
  double value_x[kN], slope_x[kN], value_y[kN], slope_y[kN];
  splines_at<kOrder>(u_x * s + 0.5 * (in.n_x - 1) - (first_x + 1), value_x, slope_x);
  splines_at<kOrder>(u_y * s + 0.5 * (in.n_y - 1) - (first_y + 1), value_y, slope_y);
  double c[2] = {0, 0}, along_x[2] = {0, 0}, along_y[2] = {0, 0};
  for (int j = 0; j < kN; ++j) {
    const double* row = in.at.k + 4 + 2 * ((first_y + j) * in.n_x + first_x);
    double value[2] = {0, 0}, slope[2] = {0, 0};
    for (int i = 0; i < kN; ++i) {
      for (int axis = 0; axis < 2; ++axis) {
        value[axis] += value_x[i] * row[2 * i + axis];
        slope[axis] += slope_x[i] * row[2 * i + axis];
      }
      at.weight[j][i] = value_y[j] * value_x[i];
    }
    for (int axis = 0; axis < 2; ++axis) {
      c[axis] += value_y[j] * value[axis];
      along_x[axis] += value_y[j] * slope[axis];
      along_y[axis] += slope_y[j] * value[axis];
    }
  }
  at.m[0] = u_x + c[0], at.m[1] = u_y + c[1];
  at.J[0] = 1 + s * along_x[0], at.J[1] = s * along_y[0];
  at.J[2] = s * along_x[1], at.J[3] = 1 + s * along_y[1];
}

// sum_ij += the products of the weights of the corner's control points with each other, wherever the second
// does not come before the first in the grid.
template <int kOrder>
inline __attribute__((always_inline)) void add_band(const SplineInput& in, const SplineAt<kOrder>& at,
                                                    double factor, int first_x, int first_y, double* band) {
  constexpr int kN = kOrder + 1;
  for (int j = 0; j < kN; ++j) {
    for (int i = 0; i < kN; ++i) {
      const double w = factor * at.weight[j][i];
      double* own = band + kSplineBand * ((first_y + j) * in.n_x + first_x + i) + 3 - i;
      for (int dj = 0; j + dj < kN; ++dj) {
        for (int e = 0; e < kN; ++e) own[7 * dj + e] += w * at.weight[j + dj][e];
      }
    }
  }
}

// The columns of the two Jacobian rows of a corner [focal length, centre | dw dt | residual], padded.
constexpr int kSplineColumnsPadded = (kSplineColumns + 3) / 4 * 4;
struct SplineRowPair {
  double T[2][kSplineColumnsPadded];
};

template <int kOrder>
inline __attribute__((always_inline)) void add_control(const SplineInput& in, const SplineAt<kOrder>& at,
                                                       const SplineRowPair& rows, double factor, int first_x,
                                                       int first_y, double* control) {
  constexpr int kN = kOrder + 1;
  double weight[kN][2 * kN];  // of x and y in turn, as the control points lie in memory
  for (int j = 0; j < kN; ++j) {
    for (int i = 0; i < kN; ++i) weight[j][2 * i] = weight[j][2 * i + 1] = at.weight[j][i];
  }
  const double f[2] = {factor * in.at.k[0], factor * in.at.k[1]};
  for (int c = 0; c < kSplineColumns; ++c) {
    double a[2 * kN];
    for (int i = 0; i < kN; ++i) a[2 * i] = f[0] * rows.T[0][c], a[2 * i + 1] = f[1] * rows.T[1][c];
    for (int j = 0; j < kN; ++j) {
      double* out = control + c * in.n_rows + in.row_of_knots[first_y + j] + 2 * first_x;
      for (int e = 0; e < 2 * kN; ++e) out[e] += weight[j][e] * a[e];
    }
  }
}

inline __attribute__((always_inline)) void add_gram(const SplineRowPair& rows, double factor,
                                                    double (*sums)[kSplineColumns][kSplineColumnsPadded]) {
  for (int axis = 0; axis < 2; ++axis) {
    const double* T = rows.T[axis];
#pragma GCC unroll 9
    for (int i = 0; i < kSplineColumns; ++i) {
      const double w = factor * T[i];
      for (int j = 0; j < (i / 4 + 1) * 4; ++j) sums[axis][i][j] += w * T[j];
    }
  }
}

inline void write_spline_gram(const double (*sums)[kSplineColumns][kSplineColumnsPadded], double* gram) {
  for (int i = 0; i < kSplineGram * (kSplineGram + 1) / 2; ++i) gram[i] = 0;
  for (int axis = 0; axis < 2; ++axis) {
    const auto row_of = [axis](int c) { return c == 0 ? axis : c == 1 ? 2 + axis : c + 2; };
    for (int i = 0; i < kSplineColumns; ++i) {
      for (int j = 0; j <= i; ++j) gram[row_of(i) * (row_of(i) + 1) / 2 + row_of(j)] += sums[axis][i][j];
    }
  }
}

// rho' and half of rho.
inline __attribute__((always_inline)) double weigh_corner(int loss, double scale, double s,
                                                          double& half_rho) {
  half_rho = 0.5 * s;
  if (loss == 1) {
    const double root = __builtin_sqrt(s);
    if (!(root > scale)) return 1;
    half_rho = scale * root - 0.5 * scale * scale;
    return scale / root;
  }
  if (loss == 2) {
    const double squares = s / (scale * scale);
    half_rho = 0.5 * scale * scale * __builtin_log1p(squares);
    return 1 / (1 + squares);
  }
  return 1;
}

template <int kOrder>
double run_spline_of(const SplineInput& in, const SplineOutput& out) {
  const double *R = in.at.R, *t = in.at.t, fx = in.at.k[0], fy = in.at.k[1];
  double sums[2][kSplineColumns][kSplineColumnsPadded] = {};
  double cost = 0;
  for (int p = 0; p < in.n; ++p) {
    const double X = in.points[p], Y = in.points[in.n_padded + p], Z = in.points[2 * in.n_padded + p];
    const double q[3] = {R[0] * X + R[1] * Y + R[2] * Z, R[3] * X + R[4] * Y + R[5] * Z,
                         R[6] * X + R[7] * Y + R[8] * Z};
    const double x = q[0] + t[0], y = q[1] + t[1], z = q[2] + t[2];
    const double n = __builtin_sqrt(x * x + y * y + z * z), scale = 2 / (n + z);
    const double u_x = scale * x, u_y = scale * y;
    const int first_x = in.first_knots[2 * p], first_y = in.first_knots[2 * p + 1];
    SplineAt<kOrder> at;
    evaluate_spline<kOrder>(in, first_x, first_y, u_x, u_y, at);
    if (!(at.J[0] * at.J[3] - at.J[1] * at.J[2] > 0)) return __builtin_nan("");
    const double weight = in.points[3 * in.n_padded + p];
    const double e[2] = {fx * at.m[0] + in.at.k[2] - in.px[p],
                         fy * at.m[1] + in.at.k[3] - in.px[in.n_padded + p]};
    double half_rho;
    const double factor =
        weight * weight *
        weigh_corner(in.loss, in.loss_scale, weight * weight * (e[0] * e[0] + e[1] * e[1]), half_rho);
    cost += half_rho;
    // d(u)/d(p_cam) = scale I - u (scale / 2) (p / n + e_z)'
    const double h = -0.5 * scale, g[3] = {h * x / n, h * y / n, h * (z / n + 1)};
    SplineRowPair rows{};
    for (int axis = 0; axis < 2; ++axis) {
      const double f = axis == 0 ? fx : fy, a = f * at.J[2 * axis], b = f * at.J[2 * axis + 1];
      const double along = a * u_x + b * u_y;
      const double J[3] = {a * scale + along * g[0], b * scale + along * g[1], along * g[2]};
      double* T = rows.T[axis];
      T[0] = at.m[axis], T[1] = 1;
      T[2] = q[1] * J[2] - q[2] * J[1], T[3] = q[2] * J[0] - q[0] * J[2], T[4] = q[0] * J[1] - q[1] * J[0];
      T[5] = J[0], T[6] = J[1], T[7] = J[2], T[8] = e[axis];
    }
    add_gram(rows, factor, sums);
    add_band<kOrder>(in, at, factor, first_x, first_y, out.band);
    add_control<kOrder>(in, at, rows, factor, first_x, first_y, out.control);
  }
  write_spline_gram(sums, out.gram);
  return cost;
}

double run_spline(const SplineInput& in, const SplineOutput& out) {
  return in.order == 2 ? run_spline_of<2>(in, out) : run_spline_of<3>(in, out);
}

}  // namespace
}  // namespace plumbline::detail

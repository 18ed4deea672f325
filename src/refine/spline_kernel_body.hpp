// SPDX-License-Identifier: Apache-2.0
#pragma once
// The kernel of splined lenses, for the view_kernel_*.cpp. A corner touches few of a spline's many
// parameters, so it is the corner's own small products that are made several numbers at a time here, not
// several corners. Internal linkage on purpose: see view_kernel_sets.hpp.
#include "refine/view_kernel_sets.hpp"

namespace plumbline::detail {
namespace {

// Four doubles, whatever the registers hold. No function of this file is called from another, so that how
// such vectors are passed is nobody else's business.
#pragma GCC diagnostic ignored "-Wpsabi"
typedef double Four __attribute__((vector_size(32)));
inline __attribute__((always_inline)) Four load4(const double* p) {
  Four a;
  __builtin_memcpy(&a, p, sizeof a);
  return a;
}
inline __attribute__((always_inline)) void add4(double* p, Four a) {
  const Four sum = load4(p) + a;
  __builtin_memcpy(p, &sum, sizeof sum);
}

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

// m = u + c(u), d(m)/d(u), and how much each control point has of c, row by row; beyond the order zeros.
struct SplineAt {
  double m[2], J[4];
  Four weight[4];
};

template <int kOrder>
inline __attribute__((always_inline)) void evaluate_spline(const SplineInput& in, int first_x, int first_y,
                                                           double u_x, double u_y, SplineAt& at) {
  constexpr int kN = kOrder + 1;
  const double s = in.knots_per_unit;
  double value_x[4] = {}, slope_x[4] = {}, value_y[4] = {}, slope_y[4] = {};
  splines_at<kOrder>(u_x * s + 0.5 * (in.n_x - 1) - (first_x + 1), value_x, slope_x);
  splines_at<kOrder>(u_y * s + 0.5 * (in.n_y - 1) - (first_y + 1), value_y, slope_y);
  const Four weights_x = load4(value_x);
  double c[2] = {0, 0}, along_x[2] = {0, 0}, along_y[2] = {0, 0};
#pragma GCC unroll 4
  for (int j = 0; j < kN; ++j) {
    const double* row = in.at.k + 4 + 2 * ((first_y + j) * in.n_x + first_x);
    double value[2] = {0, 0}, slope[2] = {0, 0};
#pragma GCC unroll 4
    for (int i = 0; i < kN; ++i) {
      for (int axis = 0; axis < 2; ++axis) {
        value[axis] += value_x[i] * row[2 * i + axis];
        slope[axis] += slope_x[i] * row[2 * i + axis];
      }
    }
    at.weight[j] = value_y[j] * weights_x;
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

// Of each of the corner's control points the products of its weight with those that do not come before it in
// the grid.
template <int kOrder>
inline __attribute__((always_inline)) void add_band(const SplineInput& in, const SplineAt& at, double factor,
                                                    int first_x, int first_y, double* band) {
  constexpr int kN = kOrder + 1;
#pragma GCC unroll 4
  for (int j = 0; j < kN; ++j) {
    const Four row = factor * at.weight[j];
#pragma GCC unroll 4
    for (int i = 0; i < kN; ++i) {
      double* own = band + kSplineBand * ((first_y + j) * in.n_x + first_x + i) + 3 - i;
#pragma GCC unroll 4
      for (int dj = 0; j + dj < kN; ++dj) add4(own + 7 * dj, row[i] * at.weight[j + dj]);
    }
  }
}

// The columns of the two Jacobian rows of a corner [focal length, centre | dw dt | residual | bow], padded.
constexpr int kSplineColumnsPadded = (kSplineColumns + 2 + 3) / 4 * 4;
struct SplineRowPair {
  double T[2][kSplineColumnsPadded];
};

template <int kOrder, int kColumns>
inline __attribute__((always_inline)) void add_control(const SplineInput& in, const SplineAt& at,
                                                       const SplineRowPair& rows, double factor, int first_x,
                                                       int first_y, double* control) {
  constexpr int kN = kOrder + 1;
  const Four f = {factor * in.at.k[0], factor * in.at.k[1], factor * in.at.k[0], factor * in.at.k[1]};
#pragma GCC unroll 4
  for (int j = 0; j < kN; ++j) {
    const Four w = at.weight[j];  // of x and y in turn, as the control points lie in memory
    const Four left = f * Four{w[0], w[0], w[1], w[1]}, right = f * Four{w[2], w[2], w[3], w[3]};
    double* out = control + (in.row_of_knots[first_y + j] + 2 * first_x);
#pragma GCC unroll 11
    for (int c = 0; c < kColumns; ++c) {
      const Four a = {rows.T[0][c], rows.T[1][c], rows.T[0][c], rows.T[1][c]};
      add4(out + c * in.n_rows, left * a);
      add4(out + c * in.n_rows + 4, right * a);
    }
  }
}

// sums[axis][i][..] += T_i T, as far as the lower triangle needs it.
template <int kColumns>
inline __attribute__((always_inline)) void add_gram(const SplineRowPair& rows, double factor,
                                                    double (*sums)[kColumns][kSplineColumnsPadded]) {
  for (int axis = 0; axis < 2; ++axis) {
    const double* T = rows.T[axis];
#pragma GCC unroll 11
    for (int i = 0; i < kColumns; ++i) {
#pragma GCC unroll 3
      for (int j = 0; j <= i; j += 4) add4(sums[axis][i] + j, factor * T[i] * load4(T + j));
    }
  }
}

template <int kColumns>
inline void write_spline_gram(const double (*sums)[kColumns][kSplineColumnsPadded], double* gram) {
  for (int i = 0; i < (kColumns + 2) * (kColumns + 3) / 2; ++i) gram[i] = 0;
  for (int axis = 0; axis < 2; ++axis) {
    const auto row_of = [axis](int c) { return c == 0 ? axis : c == 1 ? 2 + axis : c + 2; };
    for (int i = 0; i < kColumns; ++i) {
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

template <int kOrder, bool kBowed>
double run_spline_of(const SplineInput& in, const SplineOutput& out) {
  constexpr int kColumns = kSplineColumns + (kBowed ? 2 : 0);
  const double *R = in.at.R, *t = in.at.t, fx = in.at.k[0], fy = in.at.k[1];
  double sums[2][kColumns][kSplineColumnsPadded] = {};
  double cost = 0;
  for (int p = 0; p < in.n; ++p) {
    const double X = in.points[p], Y = in.points[in.n_padded + p];
    double Z = in.points[2 * in.n_padded + p];
    if constexpr (kBowed)
      Z += in.bow_m[0] * in.points[4 * in.n_padded + p] + in.bow_m[1] * in.points[5 * in.n_padded + p];
    const double q[3] = {R[0] * X + R[1] * Y + R[2] * Z, R[3] * X + R[4] * Y + R[5] * Z,
                         R[6] * X + R[7] * Y + R[8] * Z};
    const double x = q[0] + t[0], y = q[1] + t[1], z = q[2] + t[2];
    const double n = __builtin_sqrt(x * x + y * y + z * z), scale = 2 / (n + z);
    const double u_x = scale * x, u_y = scale * y;
    const int first_x = in.first_knots[2 * p], first_y = in.first_knots[2 * p + 1];
    SplineAt at;
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
      if constexpr (kBowed) {
        const double lift = R[2] * J[0] + R[5] * J[1] + R[8] * J[2];
        for (int i = 0; i < 2; ++i) T[9 + i] = lift * in.points[(4 + i) * in.n_padded + p];
      }
    }
    add_gram<kColumns>(rows, factor, sums);
    add_band<kOrder>(in, at, factor, first_x, first_y, out.band);
    add_control<kOrder, kColumns>(in, at, rows, factor, first_x, first_y, out.control);
  }
  write_spline_gram<kColumns>(sums, out.gram);
  return cost;
}

double run_spline(const SplineInput& in, const SplineOutput& out) {
  if (in.bow_m) return in.order == 2 ? run_spline_of<2, true>(in, out) : run_spline_of<3, true>(in, out);
  return in.order == 2 ? run_spline_of<2, false>(in, out) : run_spline_of<3, false>(in, out);
}

}  // namespace
}  // namespace plumbline::detail

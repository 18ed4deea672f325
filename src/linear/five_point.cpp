// SPDX-License-Identifier: Apache-2.0
// Five pairs leave a space E = x X + y Y + z Z + w W of four dimensions, and the ten cubic equations of an
// essential matrix, 2 E E' E - trace(E E') E = 0 and det E = 0, pick up to ten points of it. Elimination in
// the order of Nister (2004, "An efficient solution to the five-point relative pose problem", section 3)
// leaves a polynomial of degree ten in z / w; each root is then polished on the ten equations themselves,
// because the polynomial alone loses up to six digits.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "linear/minimal.hpp"
#include "linear/null_space.hpp"
#include "linear/polynomial_roots.hpp"

namespace plumbline::detail {
namespace {

using Linear = std::array<double, 4>;      // x y z 1
using Quadratic = std::array<double, 10>;  // x2 xy xz x y2 yz y z2 z 1
using Cubic = Eigen::Matrix<double, 1, 20>;
using Equations = Eigen::Matrix<double, 10, 20, Eigen::RowMajor>;

// Monomials as exponents of x, y, z, in Nister's order: x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz
// y z3 z2 z 1.
struct Exponents {
  int x, y, z;
};
constexpr Exponents kLinear[4] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}};
constexpr Exponents kQuadratic[10] = {{2, 0, 0}, {1, 1, 0}, {1, 0, 1}, {1, 0, 0}, {0, 2, 0},
                                      {0, 1, 1}, {0, 1, 0}, {0, 0, 2}, {0, 0, 1}, {0, 0, 0}};
constexpr Exponents kCubic[20] = {{3, 0, 0}, {0, 3, 0}, {2, 1, 0}, {1, 2, 0}, {2, 0, 1}, {2, 0, 0}, {0, 2, 1},
                                  {0, 2, 0}, {1, 1, 1}, {1, 1, 0}, {1, 0, 2}, {1, 0, 1}, {1, 0, 0}, {0, 1, 2},
                                  {0, 1, 1}, {0, 1, 0}, {0, 0, 3}, {0, 0, 2}, {0, 0, 1}, {0, 0, 0}};

template <std::size_t N>
constexpr int place_of(const Exponents (&list)[N], const Exponents& a, const Exponents& b) {
  for (std::size_t i = 0; i < N; ++i) {
    if (list[i].x == a.x + b.x && list[i].y == a.y + b.y && list[i].z == a.z + b.z) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

struct Tables {
  int quadratic[4][4];  // place of the product of two linear monomials
  int cubic[10][4];     // place of the product of a quadratic and a linear one
};
constexpr Tables make_tables() {
  Tables t{};
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) t.quadratic[i][j] = place_of(kQuadratic, kLinear[i], kLinear[j]);
  }
  for (int i = 0; i < 10; ++i) {
    for (int j = 0; j < 4; ++j) t.cubic[i][j] = place_of(kCubic, kQuadratic[i], kLinear[j]);
  }
  return t;
}
constexpr Tables kTables = make_tables();

void add_product(const Linear& a, const Linear& b, double factor, Quadratic& out) {
  for (std::size_t i = 0; i < 4; ++i) {
    const double k = factor * a[i];
    for (std::size_t j = 0; j < 4; ++j) out[static_cast<std::size_t>(kTables.quadratic[i][j])] += k * b[j];
  }
}

void add_product(const Quadratic& a, const Linear& b, double* out) {
  for (std::size_t i = 0; i < 10; ++i) {
    for (std::size_t j = 0; j < 4; ++j) out[kTables.cubic[i][j]] += a[i] * b[j];
  }
}

using Basis = Eigen::Matrix<double, 9, 4>;  // column-major vec(E)

// The ten equations over the twenty monomials.
Equations equations_of(const Basis& basis) {
  Linear E[3][3];
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 4; ++k) E[r][c][static_cast<std::size_t>(k)] = basis(3 * c + r, k);
    }
  }
  Quadratic S[3][3] = {};  // E E' - trace(E E') / 2 I
  for (int r = 0; r < 3; ++r) {
    for (int c = r; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) add_product(E[r][k], E[c][k], 1, S[r][c]);
    }
  }
  for (std::size_t i = 0; i < 10; ++i) {
    const double half = 0.5 * (S[0][0][i] + S[1][1][i] + S[2][2][i]);
    for (int r = 0; r < 3; ++r) S[r][r][i] -= half;
    S[1][0][i] = S[0][1][i], S[2][0][i] = S[0][2][i], S[2][1][i] = S[1][2][i];
  }
  Equations A = Equations::Zero();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      for (int k = 0; k < 3; ++k) add_product(S[r][k], E[k][c], A.row(3 * r + c).data());
    }
  }
  for (int c = 0; c < 3; ++c) {  // det E along its first row
    const int c1 = (c + 1) % 3, c2 = (c + 2) % 3;
    Quadratic minor{};
    add_product(E[1][c1], E[2][c2], 1, minor);
    add_product(E[1][c2], E[2][c1], -1, minor);
    add_product(minor, E[0][c], A.row(9).data());
  }
  return A;
}

// Rows 4 to 9 become x2z, x2, y2z, y2, xyz, xy = -(the last ten monomials). The smallest over the largest
// pivot.
double eliminate(Equations& A) {
  double smallest = 1e300, largest = 0;
  for (int k = 0; k < 10; ++k) {
    int pivot = k;
    for (int r = k + 1; r < 10; ++r) {
      if (std::abs(A(r, k)) > std::abs(A(pivot, k))) pivot = r;
    }
    if (pivot != k) A.row(k).swap(A.row(pivot));
    const double value = A(k, k);
    smallest = std::min(smallest, std::abs(value));
    largest = std::max(largest, std::abs(value));
    if (value == 0) return 0;
    A.row(k).tail(20 - k) /= value;
    for (int r = k + 1; r < 10; ++r) A.row(r).tail(20 - k) -= A(r, k) * A.row(k).tail(20 - k);
  }
  for (int k = 9; k > 4; --k) {
    for (int r = 4; r < k; ++r) A.row(r).tail(10) -= A(r, k) * A.row(k).tail(10);
  }
  return smallest / largest;
}

// A row of the 3 x 3 matrix B(z) with B(z) [x y 1]' = 0, polynomials in ascending order.
struct HiddenRow {
  std::array<double, 4> x, y;
  std::array<double, 5> one;
};

// (row of m z) - z (row of m), whose leading monomials cancel.
HiddenRow hidden_row(const Equations& A, int row_mz, int row_m) {
  const auto u = A.row(row_mz), v = A.row(row_m);
  const auto cubic = [&](int c) {
    return std::array<double, 4>{u[c + 2], u[c + 1] - v[c + 2], u[c] - v[c + 1], -v[c]};
  };
  return {cubic(10), cubic(13), {u[19], u[18] - v[19], u[17] - v[18], u[16] - v[17], -v[16]}};
}

template <std::size_t N, std::size_t M>
void add_product(const std::array<double, N>& a, const std::array<double, M>& b, double factor,
                 std::array<double, N + M - 1>& out) {
  for (std::size_t i = 0; i < N; ++i) {
    for (std::size_t j = 0; j < M; ++j) out[i + j] += factor * a[i] * b[j];
  }
}

Polynomial<10> determinant(const HiddenRow (&B)[3]) {
  Polynomial<10> p{};
  for (int i = 0; i < 3; ++i) {  // along the last column
    const HiddenRow &a = B[(i + 1) % 3], &b = B[(i + 2) % 3];
    std::array<double, 7> minor{};
    add_product(a.x, b.y, 1, minor);
    add_product(a.y, b.x, -1, minor);
    add_product(minor, B[i].one, 1, p);
  }
  return p;
}

// sum c[k] z^k w^(n-k)
template <std::size_t N>
double homogeneous_value(const std::array<double, N>& c, double z, double w) {
  double value = c[N - 1], power = w;
  for (std::size_t k = N - 1; k-- > 0; power *= w) value = value * z + c[k] * power;
  return value;
}

// The null vector of B at z : w, as coordinates (x, y, z, w) of E.
Vec4 coordinates_at(const HiddenRow (&B)[3], double z, double w) {
  Vec3 rows[3];
  for (int i = 0; i < 3; ++i) {
    rows[i] << homogeneous_value(B[i].x, z, w), homogeneous_value(B[i].y, z, w),
        homogeneous_value(B[i].one, z, w);
  }
  Vec3 n = rows[0].cross(rows[1]);
  for (const Vec3& other : {rows[1].cross(rows[2]), rows[2].cross(rows[0])}) {
    if (other.squaredNorm() > n.squaredNorm()) n = other;
  }
  return Vec4(n[0], n[1], z * n[2], w * n[2]).normalized();
}

// Gauss-Newton on the ten equations over the unit sphere of (x, y, z, w). nullopt when it does not end on a
// root.
std::optional<Mat3> polish(const Basis& basis, Vec4 q) {
  constexpr int kMostSteps = 8;
  for (int i = 0; i < kMostSteps; ++i) {
    const Eigen::Matrix<double, 9, 1> e = basis * q;
    const Mat3 E = Eigen::Map<const Mat3>(e.data());
    const Mat3 S = E * E.transpose();
    const double trace = S.trace();
    Eigen::Matrix<double, 10, 1> r;
    Eigen::Map<Mat3> cubic(r.data());
    cubic = 2 * S * E - trace * E;
    Mat3 C;
    C << E.row(1).cross(E.row(2)), E.row(2).cross(E.row(0)), E.row(0).cross(E.row(1));
    r[9] = C.row(0).dot(E.row(0));
    Eigen::Matrix<double, 10, 4> J;
    for (int k = 0; k < 4; ++k) {
      const Mat3 D = Eigen::Map<const Mat3>(basis.col(k).data());
      const Mat3 EDt = E * D.transpose();
      Eigen::Map<Mat3>(J.col(k).data()) =
          2 * ((EDt + EDt.transpose()) * E + S * D) - trace * D - 2 * EDt.trace() * E;
      J(9, k) = C.cwiseProduct(D).sum();
    }
    const Mat4 A = J.transpose() * J + q * q.transpose();
    const Vec4 step = A.inverse() * (J.transpose() * r);
    if (!step.allFinite()) return std::nullopt;
    q = (q - step).normalized();
    const double size = step.norm();
    if (size > 0.3) return std::nullopt;  // not near any root
    if (size < 1e-8) {                    // the next step would be its square
      const Eigen::Matrix<double, 9, 1> last = std::sqrt(2.0) * (basis * q);
      return Mat3(Eigen::Map<const Mat3>(last.data()));
    }
  }
  return std::nullopt;
}

}  // namespace

Answers<10> five_point(const std::array<Vec3, 5>& a, const std::array<Vec3, 5>& b) {
  Eigen::Matrix<double, 9, 5> constraints;
  for (int i = 0; i < 5; ++i) {
    const Mat3 row =
        b[static_cast<std::size_t>(i)].normalized() * a[static_cast<std::size_t>(i)].normalized().transpose();
    constraints.col(i) = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(row.data());
  }
  const auto null = null_space<9, 5>(constraints);
  Answers<10> out;
  out.determinacy = null.determinacy;
  Equations A = equations_of(null.basis);
  if (!(eliminate(A) > 1e-14)) return out;
  const HiddenRow B[3] = {hidden_row(A, 4, 5), hidden_row(A, 6, 7), hidden_row(A, 8, 9)};
  visit_projective_roots<10>(determinant(B), [&](double z, double w) {
    if (out.n >= 10) return;
    const Vec4 q = coordinates_at(B, z, w);
    if (!q.allFinite()) return;
    if (const auto E = polish(null.basis, q)) out.matrix[static_cast<std::size_t>(out.n++)] = *E;
  });
  return out;
}

}  // namespace plumbline::detail

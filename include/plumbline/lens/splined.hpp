// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/lens/concept.hpp"

namespace plumbline {

/// mrcal's splined stereographic lens, LENSMODEL_SPLINED_STEREOGRAPHIC: a stereographic fisheye and a smooth
/// correction of it, a surface of uniform B-splines over a grid of control points. With the stereographic
/// coordinates u = 2 tan(theta / 2) (X, Y) / r = 2 (X, Y) / (|p| + Z):
///
///   px = (fx (u_x + c_x(u)) + cx, fy (u_y + c_y(u)) + cy),   c(u) = sum_ij B(i_x - i) B(i_y - j) c_ij
///
/// where i_x = u_x s + (Nx - 1) / 2 and i_y = u_y s + (Ny - 1) / 2 number the knots, and s, the knots per
/// unit of u, is such that the splines are complete over fov_x_deg: s = (Nx - order) / (4 tan(fov_x_deg /
/// 4)). Order 2 or 3: a pixel depends on 9 or 16 control points.
///
/// The number of parameters is not known at compile time: fx fy cx cy [px], then c_ij row by row (j outer), x
/// before y, no unit. fx fy cx cy could be taken up by the control points; a solver holds them.
///
/// Domain: where the splines are complete, |u_x| <= 2 tan(fov_x_deg / 4) and likewise in y, and the map keeps
/// its orientation, det d(px)/d(u) > 0. Unlike other lenses' it is a rectangle in u, not a cone, and a
/// surface that is folded somewhere loses those places only.
struct Splined {
  int order = 3, n_x = 4, n_y = 4, fov_x_deg = 90;
  std::vector<double> k;  ///< fx fy cx cy, control points: 4 + 2 n_x n_y numbers

  Splined() : Splined(3, 4, 4, 90) {}
  /// Focal lengths 1, the rest 0.
  Splined(int order, int n_x, int n_y, int fov_x_deg);

  static constexpr std::string_view kName = "splined";
  static constexpr std::string_view kSummary =
      "splined stereographic, mrcal's: splined:NXxNY:FOV_X_DEG[:ORDER], or splined for a grid that fits";
  static constexpr bool kIsCentralPerspective = false;
  static constexpr bool kHoldsCore = true;

  /// From the text after "splined:", such as "30x20:170" or "30x20:170:2"; empty: a grid for an image of this
  /// size with this focal length. kInvalidData says what is wrong with it.
  static Result<Splined> make(std::string_view options, ImageSize size, double focal_px);
  /// What make() reads.
  std::string options() const;
  /// A grid of order 3 over these rays and a little around them: about 60 px between knots, at most 30 of
  /// them across.
  static std::string options_for(ImageSize size, std::span<const Vec3> rays);

  std::span<const double> params() const { return k; }
  std::span<double> params() { return k; }
  std::vector<std::string> param_names() const;  ///< fx fy cx cy x0_0 y0_0 x1_0 y1_0 ... : column, row

  double knots_per_unit() const;
  /// Largest |u_x| and |u_y| of the domain.
  Vec2 reach() const;
  int control_point(int i, int j) const { return 4 + 2 * (j * n_x + i); }  ///< index of c_ij's x
  Vec2 knot(int i, int j) const;                                           ///< u of the knot (i, j)
  /// The first of the order + 1 knots each way whose splines are not zero at u; nullopt outside the domain.
  std::optional<std::array<int, 2>> first_knots(const Vec2& u) const;

  std::optional<Vec2> project(const Vec3& p_cam, Mat23* J_px_p = nullptr, SparseJac* J_px_k = nullptr) const;
  std::optional<Vec3> unproject(const Vec2& px) const;

  /// mrcal's regularisation: the correction at each control point along the radius, and ten times stronger
  /// across it.
  std::vector<PriorRow> priors() const;
};

/// Stereographic coordinates of a point, and the unit ray of them.
Vec2 stereographic(const Vec3& p_cam);
Vec3 ray_of_stereographic(const Vec2& u);

}  // namespace plumbline

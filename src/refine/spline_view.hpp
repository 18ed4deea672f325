// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <vector>

#include "refine/view_kernel.hpp"
#include "refine/view_kernel_sets.hpp"

/// A splined lens in the block solver. A corner depends on (order + 1)^2 control points, chosen by where it
/// lies, so a frame couples with a patch of the grid only, another one whenever its pose moves. Of control
/// points with each other there is a band: each has to do with those at most `order` knots away, the x of one
/// never with the y of another, and both alike but for the focal length.
namespace plumbline::detail {

/// The first knots (x, y) of each corner of a view; false when a corner lies outside the grid.
/// \param first_knots  two numbers for each corner, written
bool place_corners(const Splined& lens, const SE3& T_cam_board, const ViewCorners& corners, int* first_knots);

/// The control points of one lens that one frame has to do with: in each row of knots those from `from` to
/// before `to`.
struct KnotRange {
  int from = 0, to = 0;
};
struct SplinePatch {
  int cam = 0;
  int first_row = 0, n_rows = 0;  ///< among the rows of the frame's coupling: two for each control point
  std::vector<int> row_of_knots;  ///< as in SplineInput, counted from first_row
  std::vector<KnotRange> ranges;  ///< one for each row of knots

  SplinePatch(const Splined& lens, int cam_) : cam(cam_), ranges(static_cast<std::size_t>(lens.n_y)) {}
  void add(const Splined& lens, const int* first_knots, int n_corners);
  /// The parameters of its control points, row by row, appended; `lens_at`: the lens' first parameter. The
  /// patch is complete then.
  void lay_out(const Splined& lens, int lens_at, int row, std::vector<Segment>& segments);
};

/// What the control points of one lens have with each other (`band`, see SplineOutput), with its own focal
/// length and centre, its camera's pose and the poses of further boards (`strip`: two columns, six where the
/// camera has a pose, six for each further board), and with the residuals.
struct SplineSums {
  std::vector<double> band;
  MatX strip;
  VecX g;
  void clear(const Splined& lens, int n_columns);
  void add(const SplineSums& other);
};

/// As accumulate_view(), with the gram over [fx fy cx cy | dw dt | residual]. The control points' products
/// with [focal length, centre | dw dt | residual] are added to `control` (patch.n_rows x kSplineColumns),
/// those with each other to `band`.
std::optional<double> accumulate_spline(const ViewQuestion& question, const int* first_knots,
                                        const SplinePatch& patch, Gram& gram, std::vector<double>& band,
                                        MatX& control);

/// Adds the band to the lower triangle of A, where the lens' parameters start at `lens_at`.
void expand_band(const Splined& lens, const std::vector<double>& band, int lens_at, MatX& A);

/// Adds the lens' own regularisation (priors(lens), times `scale`) to the normal equations; returns its share
/// of the cost.
double add_regularisation(const Lens& lens, double scale, int lens_at, MatX& A, VecX& g);

}  // namespace plumbline::detail

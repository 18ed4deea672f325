// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/lens/brown_conrady.hpp"
#include "plumbline/lens/concept.hpp"
#include "plumbline/lens/kannala_brandt.hpp"
#include "plumbline/lens/one_parameter.hpp"
#include "plumbline/lens/pinhole.hpp"
#include "plumbline/lens/sphere.hpp"
#include "plumbline/lens/splined.hpp"

namespace plumbline {

/// THE list of lenses. A new lens is its header and its name here; nothing else in the project lists them.
using Lens = std::variant<Pinhole, OpenCV4, OpenCV5, OpenCV8, OpenCV12, KannalaBrandt4, UnifiedCamera, Mei,
                          EnhancedUnifiedCamera, DoubleSphere, FieldOfView, Division, Splined>;

namespace detail {
template <class V>
inline constexpr bool kAllLensModels = false;
template <class... L>
inline constexpr bool kAllLensModels<std::variant<L...>> = (LensModel<L> && ...);
template <class L>
constexpr int fixed_count() {
  if constexpr (FixedLens<L>)
    return L::kNumParams;
  else
    return 0;
}
template <class V>
inline constexpr int kMostParams = 0;
template <class... L>
inline constexpr int kMostParams<std::variant<L...>> = std::max({fixed_count<L>()...});
static_assert(kAllLensModels<Lens>, "an alternative of Lens does not satisfy LensModel");
static_assert(kMostParams<Lens> <= SparseJac::kMost);
}  // namespace detail

/// The largest number of parameters of those lenses for which it is fixed.
inline constexpr int kMaxLensParams = detail::kMostParams<Lens>;

/// d(px)/d(parameters) of any lens: 2 x n_params(lens), dense. Thousands of columns for a spline, of which
/// nearly all are zero: project_sparse() gives the others.
using JacLens = Eigen::Matrix<double, 2, Eigen::Dynamic>;

/// All names in the order of the list ("pinhole", "opencv4", ...).
std::vector<std::string_view> lens_names();

std::string_view lens_name(const Lens& lens);
std::string_view lens_summary(const Lens& lens);
/// What make_lens() takes: the name, and for a lens with options those too ("splined:30x20:170").
std::string lens_spec(const Lens& lens);
int n_params(const Lens& lens);
std::vector<std::string> param_names(const Lens& lens);  ///< fx fy cx cy first
std::span<const double> params(const Lens& lens);
std::span<double> params(Lens& lens);

/// Whether the parameters are counted at run time and a pixel depends on few of them (CountedLens).
bool is_sparse(const Lens& lens);

/// The lens' own regularisation, which a solve of it needs; none for a lens with few parameters.
std::vector<PriorRow> priors(const Lens& lens);

/// Whether a solver must hold fx fy cx cy, because the other parameters can express them.
bool holds_core(const Lens& lens);

/// Whether only points with z > 0 project (false: a fisheye that can see behind itself).
bool is_central_perspective(const Lens& lens);

/// A lens without distortion, centre in the middle. `spec` is a name, or a name and options behind a colon
/// (lens_spec()). kUnsupported (with all names) for a name not in the list, kInvalidData for options that the
/// lens does not have and for a focal length that is not a positive number.
Result<Lens> make_lens(std::string_view spec, ImageSize size, double focal_px);

/// A lens from its spec and its parameters; kInvalidData when their number is wrong, one is not finite, or a
/// focal length is not positive.
Result<Lens> make_lens(std::string_view spec, std::span<const double> parameters);

/// The spec with options that suit these rays of an image of this size, for a lens that has options when
/// `spec` says none; else `spec` itself.
std::string complete_spec(std::string_view spec, ImageSize size, std::span<const Vec3> rays);

/// The 3x3 matrix [fx 0 cx; 0 fy cy; 0 0 1] of any lens [px].
Mat3 camera_matrix_k(const Lens& lens);

/// Pixel of p_cam, with its Jacobians on request (J_px_k is resized to 2 x n_params). nullopt outside the
/// domain.
std::optional<Vec2> project(const Lens& lens, const Vec3& p_cam, Mat23* J_px_p = nullptr,
                            JacLens* J_px_k = nullptr);

/// The same with the derivatives by those parameters only that the pixel depends on; for any lens.
std::optional<Vec2> project_sparse(const Lens& lens, const Vec3& p_cam, Mat23* J_px_p, SparseJac* J_px_k);

/// The unit ray in the camera frame that projects to px, to 1e-10 px (+ 1e-13 of px); nullopt when no ray of
/// the domain does.
std::optional<Vec3> unproject(const Lens& lens, const Vec2& px);

}  // namespace plumbline

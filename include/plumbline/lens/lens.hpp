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

namespace plumbline {

/// THE list of lenses. A new lens is its header and its name here; nothing else in the project lists them.
using Lens = std::variant<Pinhole, OpenCV4, OpenCV5, OpenCV8, OpenCV12, KannalaBrandt4, UnifiedCamera, Mei,
                          EnhancedUnifiedCamera, DoubleSphere, FieldOfView, Division>;

namespace detail {
template <class V>
inline constexpr bool kAllLensModels = false;
template <class... L>
inline constexpr bool kAllLensModels<std::variant<L...>> = (LensModel<L> && ...);
template <class V>
inline constexpr int kMostParams = 0;
template <class... L>
inline constexpr int kMostParams<std::variant<L...>> = std::max({L::kNumParams...});
static_assert(kAllLensModels<Lens>, "an alternative of Lens does not satisfy LensModel");
}  // namespace detail

/// d(px)/d(parameters) of any lens: 2 x n_params(lens); never allocates.
inline constexpr int kMaxLensParams = detail::kMostParams<Lens>;
using JacLens = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::ColMajor, 2, kMaxLensParams>;

/// All names in the order of the list ("pinhole", "opencv4", ...).
std::vector<std::string_view> lens_names();

std::string_view lens_name(const Lens& lens);
std::string_view lens_summary(const Lens& lens);
int n_params(const Lens& lens);
std::span<const std::string_view> param_names(const Lens& lens);  ///< fx fy cx cy first
std::span<const double> params(const Lens& lens);
std::span<double> params(Lens& lens);

/// Whether only points with z > 0 project (false: a fisheye that can see behind itself).
bool is_central_perspective(const Lens& lens);

/// A lens without distortion, centre in the middle; kUnsupported (with all names) for a name not in the list,
/// kInvalidData for a focal length that is not a positive number.
Result<Lens> make_lens(std::string_view name, ImageSize size, double focal_px);

/// A lens from its name and its parameters; kInvalidData when their number is wrong, one is not finite, or a
/// focal length is not positive.
Result<Lens> make_lens(std::string_view name, std::span<const double> parameters);

/// The 3x3 matrix [fx 0 cx; 0 fy cy; 0 0 1] of any lens [px].
Mat3 camera_matrix_k(const Lens& lens);

/// Pixel of p_cam, with its Jacobians on request (J_px_k is resized to 2 x n_params). nullopt outside the
/// domain.
std::optional<Vec2> project(const Lens& lens, const Vec3& p_cam, Mat23* J_px_p = nullptr,
                            JacLens* J_px_k = nullptr);

/// The unit ray in the camera frame that projects to px, to 1e-10 px (+ 1e-13 of px); nullopt when no ray of
/// the domain does.
std::optional<Vec3> unproject(const Lens& lens, const Vec2& px);

}  // namespace plumbline

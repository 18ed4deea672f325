// SPDX-License-Identifier: Apache-2.0
#include "plumbline/linear/fundamental.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "linear/degeneracy.hpp"
#include "linear/dlt.hpp"
#include "linear/minimal.hpp"
#include "linear/pixel_pairs.hpp"

namespace plumbline {

Result<Mat3> fundamental_8point(std::span<const Vec2> px1, std::span<const Vec2> px2) {
  constexpr const char* kWhere = "fundamental_8point";
  PLUMBLINE_CHECK(px1.size() == px2.size() && px1.size() >= 8,
                  "fundamental_8point needs as many pixels in px1 as in px2, 8 or more");
  if (const auto e = detail::refuse_pixels(px1, px2, kWhere)) return *e;
  const detail::PixelPairs pairs(px1, px2);
  const detail::EightPoint solution = detail::eight_point(pairs.a, pairs.b);
  const Mat3 F = detail::with_rank_2(solution.F);
  if (!solution.is_clear(px1.size())) {
    const TwoViewComparison c = detail::compare(
        F, pairs.a, pairs.b, pairs.rounding_px(), [&](const Mat3& H, std::span<const int> on) {
          return detail::is_turn(H, pairs.a, pairs.b, on, pairs.T_common_1(), pairs.T_common_2());
        });
    if (c.kind != TwoViewDegeneracy::kNone) return Error{ErrorCode::kDegenerate, c.text(), kWhere};
  }
  if (!(solution.determinacy > detail::kRankTolerance)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("more than one fundamental matrix fits the {} pairs (singular value ratio {:.2g}, "
                    "at least {:.0e} is needed); add points at different depths",
                    px1.size(), solution.determinacy, detail::kRankTolerance),
        kWhere};
  }
  return pairs.denormalised(F);
}

Result<std::vector<Mat3>> fundamental_7point(std::span<const Vec2> px1, std::span<const Vec2> px2) {
  constexpr const char* kWhere = "fundamental_7point";
  PLUMBLINE_CHECK(px1.size() == 7 && px2.size() == 7, "fundamental_7point needs seven pairs");
  if (const auto e = detail::refuse_pixels(px1, px2, kWhere)) return *e;
  const detail::PixelPairs pairs(px1, px2);
  std::array<Vec3, 7> a, b;
  for (std::size_t i = 0; i < 7; ++i) a[i] = pairs.a[i].v, b[i] = pairs.b[i].v;
  const detail::Answers<3> answers = detail::seven_point(a, b);
  if (!(answers.determinacy > detail::kRankTolerance)) {
    return Error{
        ErrorCode::kDegenerate,
        fmt::format("the seven pairs give dependent equations (pivot ratio {:.2g}, at least {:.0e} is "
                    "needed): the points lie in a plane, the camera only turned, or two pairs are the "
                    "same; use a homography, or other points",
                    answers.determinacy, detail::kRankTolerance),
        kWhere};
  }
  std::vector<Mat3> out;
  for (int i = 0; i < answers.n; ++i) {
    out.push_back(pairs.denormalised(detail::with_rank_2(answers.matrix[static_cast<std::size_t>(i)])));
  }
  return out;
}

}  // namespace plumbline

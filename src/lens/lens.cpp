// SPDX-License-Identifier: Apache-2.0
#include "plumbline/lens/lens.hpp"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "plumbline/core/text.hpp"

namespace plumbline {
namespace {

// Calls body with a default value of each lens type, in the order of the list.
template <class Body>
void for_each_lens_type(Body&& body) {
  [&]<std::size_t... I>(std::index_sequence<I...>) { (body(std::variant_alternative_t<I, Lens>{}), ...); }
  (std::make_index_sequence<std::variant_size_v<Lens>>{});
}

Error unknown_lens(std::string_view name) {
  std::vector<std::string> names;
  for (std::string_view n : lens_names()) names.emplace_back(n);
  return {ErrorCode::kUnsupported,
          fmt::format("no lens is called '{}'; there are: {}", name, join(names, ", ")), "lens"};
}

}  // namespace

std::vector<std::string_view> lens_names() {
  std::vector<std::string_view> names;
  for_each_lens_type([&](auto lens) { names.push_back(lens.kName); });
  return names;
}

std::string_view lens_name(const Lens& lens) {
  return std::visit([](const auto& l) { return std::string_view(l.kName); }, lens);
}

std::string_view lens_summary(const Lens& lens) {
  return std::visit([](const auto& l) { return std::string_view(l.kSummary); }, lens);
}

int n_params(const Lens& lens) {
  return std::visit([](const auto& l) { return l.kNumParams; }, lens);
}

std::span<const std::string_view> param_names(const Lens& lens) {
  return std::visit([](const auto& l) { return std::span<const std::string_view>(l.kParamNames); }, lens);
}

std::span<const double> params(const Lens& lens) {
  return std::visit([](const auto& l) { return std::span(&l.fx, static_cast<std::size_t>(l.kNumParams)); },
                    lens);
}

std::span<double> params(Lens& lens) {
  return std::visit([](auto& l) { return std::span(&l.fx, static_cast<std::size_t>(l.kNumParams)); }, lens);
}

bool is_central_perspective(const Lens& lens) {
  return std::visit([](const auto& l) { return l.kIsCentralPerspective; }, lens);
}

Result<Lens> make_lens(std::string_view name, ImageSize size, double focal_px) {
  if (!(focal_px > 0) || !std::isfinite(focal_px)) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("focal length {}: a focal length is a positive number of pixels", focal_px),
                 "lens"};
  }
  std::optional<Lens> found;
  for_each_lens_type([&]<class L>(L) {
    if (L::kName == name) found = L::seed(size, focal_px);
  });
  if (!found) return unknown_lens(name);
  return *found;
}

Result<Lens> make_lens(std::string_view name, std::span<const double> parameters) {
  auto lens = make_lens(name, ImageSize{}, 1.0);
  if (!lens) return lens;
  const std::span<double> target = params(*lens);
  if (target.size() != parameters.size()) {
    return Error{
        ErrorCode::kInvalidData,
        fmt::format("lens {} has {} parameters, {} are given", name, target.size(), parameters.size()),
        "lens"};
  }
  for (std::size_t i = 0; i < target.size(); ++i) {
    target[i] = parameters[i];
    if (!std::isfinite(parameters[i]) || (i < 2 && !(parameters[i] > 0))) {
      return Error{
          ErrorCode::kInvalidData,
          fmt::format("{} of lens {} is {}: {}", param_names(*lens)[i], name, parameters[i],
                      i < 2 ? "a focal length is a positive number of pixels" : "not a finite number"),
          "lens"};
    }
  }
  return lens;
}

Mat3 camera_matrix_k(const Lens& lens) {
  const std::span<const double> k = params(lens);
  Mat3 K = Mat3::Identity();
  K(0, 0) = k[0];
  K(1, 1) = k[1];
  K(0, 2) = k[2];
  K(1, 2) = k[3];
  return K;
}

std::optional<Vec2> project(const Lens& lens, const Vec3& p_cam, Mat23* J_px_p, JacLens* J_px_k) {
  return std::visit(
      [&]<class L>(const L& l) -> std::optional<Vec2> {
        if (!J_px_k) return l.project(p_cam, J_px_p, nullptr);
        JacParams<L> J;
        const auto px = l.project(p_cam, J_px_p, &J);
        if (px) *J_px_k = J;
        return px;
      },
      lens);
}

}  // namespace plumbline

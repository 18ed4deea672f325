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

std::string lens_spec(const Lens& lens) {
  return std::visit(
      []<class L>(const L& l) {
        if constexpr (FixedLens<L>)
          return std::string(L::kName);
        else
          return fmt::format("{}:{}", L::kName, l.options());
      },
      lens);
}

int n_params(const Lens& lens) { return static_cast<int>(params(lens).size()); }

std::vector<std::string> param_names(const Lens& lens) {
  return std::visit(
      []<class L>(const L& l) {
        if constexpr (FixedLens<L>)
          return std::vector<std::string>(L::kParamNames.begin(), L::kParamNames.end());
        else
          return l.param_names();
      },
      lens);
}

namespace {
template <class L>
auto params_of(L& lens) {
  if constexpr (FixedLens<std::remove_const_t<L>>)
    return std::span(&lens.fx, static_cast<std::size_t>(L::kNumParams));
  else
    return lens.params();
}
}  // namespace

std::span<const double> params(const Lens& lens) {
  return std::visit([](const auto& l) { return params_of(l); }, lens);
}

std::span<double> params(Lens& lens) {
  return std::visit([](auto& l) { return params_of(l); }, lens);
}

bool is_sparse(const Lens& lens) {
  return std::visit([]<class L>(const L&) { return CountedLens<L>; }, lens);
}

std::vector<PriorRow> priors(const Lens& lens) {
  return std::visit(
      []<class L>(const L& l) {
        if constexpr (CountedLens<L>)
          return l.priors();
        else
          return std::vector<PriorRow>{};
      },
      lens);
}

bool holds_core(const Lens& lens) {
  return std::visit(
      []<class L>(const L&) {
        if constexpr (CountedLens<L>)
          return bool(L::kHoldsCore);
        else
          return false;
      },
      lens);
}

bool is_central_perspective(const Lens& lens) {
  return std::visit([](const auto& l) { return l.kIsCentralPerspective; }, lens);
}

namespace {
template <class L>
Result<Lens> made(const std::optional<std::string_view>& options, ImageSize size, double focal_px) {
  if constexpr (FixedLens<L>) {
    if (options) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("lens {} has no options, and '{}' is given", L::kName, options->substr(0, 60)),
                   "lens"};
    }
    return Lens(L::seed(size, focal_px));
  } else {
    auto lens = L::make(options.value_or(""), size, focal_px);
    if (!lens) return lens.error();
    return Lens(*std::move(lens));
  }
}
}  // namespace

Result<Lens> make_lens(std::string_view spec, ImageSize size, double focal_px) {
  if (!(focal_px > 0) || !std::isfinite(focal_px)) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("focal length {}: a focal length is a positive number of pixels", focal_px),
                 "lens"};
  }
  const std::size_t colon = spec.find(':');
  const std::string_view name = spec.substr(0, colon);
  std::optional<std::string_view> options;
  if (colon != std::string_view::npos) options = spec.substr(colon + 1);
  std::optional<Result<Lens>> found;
  for_each_lens_type([&]<class L>(const L&) {
    if (L::kName == name) found = made<L>(options, size, focal_px);
  });
  if (!found) return unknown_lens(name);
  return *std::move(found);
}

Result<Lens> make_lens(std::string_view spec, std::span<const double> parameters) {
  auto lens = make_lens(spec, ImageSize{}, 1.0);
  if (!lens) return lens;
  const std::span<double> target = params(*lens);
  if (target.size() != parameters.size()) {
    return Error{
        ErrorCode::kInvalidData,
        fmt::format("lens {} has {} parameters, {} are given", spec, target.size(), parameters.size()),
        "lens"};
  }
  for (std::size_t i = 0; i < target.size(); ++i) {
    target[i] = parameters[i];
    if (!std::isfinite(parameters[i]) || (i < 2 && !(parameters[i] > 0))) {
      return Error{
          ErrorCode::kInvalidData,
          fmt::format("{} of lens {} is {}: {}", param_names(*lens)[i], spec, parameters[i],
                      i < 2 ? "a focal length is a positive number of pixels" : "not a finite number"),
          "lens"};
    }
  }
  return lens;
}

std::string complete_spec(std::string_view spec, ImageSize size, std::span<const Vec3> rays) {
  std::string complete(spec);
  for_each_lens_type([&]<class L>(const L&) {
    if constexpr (CountedLens<L>) {
      if (L::kName == spec) complete = fmt::format("{}:{}", L::kName, L::options_for(size, rays));
    }
  });
  return complete;
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
        if constexpr (FixedLens<L>) {
          JacParams<L> J;
          const auto px = l.project(p_cam, J_px_p, &J);
          if (px) *J_px_k = J;
          return px;
        } else {
          SparseJac J;
          const auto px = l.project(p_cam, J_px_p, &J);
          if (!px) return px;
          J_px_k->setZero(2, static_cast<Eigen::Index>(l.params().size()));
          for (int i = 0; i < J.n; ++i) J_px_k->col(J.index[i]) = J.J[i];
          return px;
        }
      },
      lens);
}

std::optional<Vec2> project_sparse(const Lens& lens, const Vec3& p_cam, Mat23* J_px_p, SparseJac* J_px_k) {
  return std::visit(
      [&]<class L>(const L& l) -> std::optional<Vec2> {
        if constexpr (FixedLens<L>) {
          JacParams<L> J;
          const auto px = l.project(p_cam, J_px_p, J_px_k ? &J : nullptr);
          if (!px || !J_px_k) return px;
          J_px_k->clear();
          for (int i = 0; i < L::kNumParams; ++i) J_px_k->add(i, J(0, i), J(1, i));
          return px;
        } else {
          return l.project(p_cam, J_px_p, J_px_k);
        }
      },
      lens);
}

}  // namespace plumbline

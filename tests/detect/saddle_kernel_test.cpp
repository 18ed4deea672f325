// SPDX-License-Identifier: Apache-2.0
#include "detect/saddle_kernel.hpp"

#include <cmath>
#include <vector>

#include "support/support.hpp"

namespace plumbline::test {
namespace {

using detail::kSaddleColumns;
using detail::kSaddleParams;
using detail::SaddleKernels;
using detail::SaddleModel;

/// The sets that this processor has.
std::vector<const SaddleKernels*> sets() {
  std::vector<const SaddleKernels*> out{&detail::kBaselineSaddleKernels};
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
    out.push_back(&detail::kAvx2SaddleKernels);
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq"))
    out.push_back(&detail::kAvx512SaddleKernels);
#endif
  return out;
}

/// Corner x, y; directions; blur; mean, half step, slopes; then the curvatures, which are no parameters.
using State = std::array<double, kSaddleParams + 2>;
constexpr State kBent{0.3, -0.4, 0.2, 1.6, 1.1, 120, 70, 0.4, -0.3, 0.004, -0.006};
/// The derivatives leave out that the foot on a bent edge moves, and are tested without a bend.
constexpr State kStraight{0.3, -0.4, 0.2, 1.6, 1.1, 120, 70, 0.4, -0.3, 0, 0};

/// The model written down once more, in double precision with the library's erf.
double model_at(const State& s, double x, double y) {
  const double dx = x - s[0], dy = y - s[1];
  const auto edge = [&](double angle, double curvature) {
    const double along = std::cos(angle) * dx + std::sin(angle) * dy;
    const double beside = std::cos(angle) * dy - std::sin(angle) * dx - curvature / 2 * along * along;
    return std::erf(beside / (s[4] * std::sqrt(2.0)));
  };
  return s[5] - s[6] * edge(s[2], s[9]) * edge(s[3], s[10]) + s[7] * dx + s[8] * dy;
}

SaddleModel as_model(const State& s) {
  const auto f = [](double v) { return static_cast<float>(v); };
  return {f(s[0]),           f(s[1]),     f(std::cos(s[2])), f(std::sin(s[2])), f(std::cos(s[3])),
          f(std::sin(s[3])), f(1 / s[4]), f(s[5]),           f(s[6]),           f(s[7]),
          f(s[8]),           f(s[9] / 2), f(s[10] / 2)};
}

struct Window {
  std::vector<float> x, y, grey, weight;
  int n = 0;
  detail::SaddlePixels view() const {
    return {x.data(), y.data(), grey.data(), weight.data(), static_cast<int>(x.size())};
  }
};

/// 13 x 11 pixels, the rest of the last pack of weight 0.
Window window() {
  Window out;
  for (int y = -5; y <= 5; ++y) {
    for (int x = -6; x <= 6; ++x) {
      out.x.push_back(static_cast<float>(x));
      out.y.push_back(static_cast<float>(y));
      out.grey.push_back(static_cast<float>(100 + (x * 7 + y * 13) % 31));
    }
  }
  out.n = static_cast<int>(out.x.size());
  out.weight.assign(out.x.size(), 1.0F);
  for (auto* column : {&out.x, &out.y, &out.grey, &out.weight})
    column->resize((out.x.size() + detail::kSaddlePad - 1) / detail::kSaddlePad * detail::kSaddlePad);
  for (auto* column : {&out.y, &out.grey, &out.weight}) column->resize(out.x.size());
  return out;
}

std::vector<float> columns_of(const SaddleKernels& set, const Window& w, const State& state) {
  std::vector<float> columns(static_cast<std::size_t>(kSaddleColumns) * w.x.size());
  std::array<float, 55> lower{};
  set.sum(w.view(), as_model(state), columns.data(), lower.data());
  return columns;
}

// By the model in double precision; single precision keeps seven digits of grey levels up to 200.
TEST(SaddleKernel, ResidualsAreTheModels) {
  const Window w = window();
  for (const SaddleKernels* set : sets()) {
    for (const State& state : {kStraight, kBent}) {
      const auto columns = columns_of(*set, w, state);
      for (std::size_t i = 0; i < static_cast<std::size_t>(w.n); ++i) {
        const double x = static_cast<double>(w.x[i]), y = static_cast<double>(w.y[i]);
        EXPECT_NEAR(static_cast<double>(columns[kSaddleParams * w.x.size() + i]),
                    static_cast<double>(w.grey[i]) - model_at(state, x, y), 2e-4)
            << set->name;
      }
    }
  }
}

// By differences of the model in double precision. The corner's place takes no part of the slope of the
// light.
TEST(SaddleKernel, DerivativesAreTheModels) {
  const Window w = window();
  for (const SaddleKernels* set : sets()) {
    const auto columns = columns_of(*set, w, kStraight);
    for (std::size_t i = 0; i < static_cast<std::size_t>(w.n); ++i) {
      const double x = static_cast<double>(w.x[i]), y = static_cast<double>(w.y[i]);
      for (std::size_t p = 0; p < kSaddleParams; ++p) {
        constexpr double kStep = 1e-5;
        State more = kStraight, less = kStraight;
        more[p] += kStep, less[p] -= kStep;
        double expected = (model_at(more, x, y) - model_at(less, x, y)) / (2 * kStep);
        if (p < 2) expected += kStraight[7 + p];
        EXPECT_NEAR(static_cast<double>(columns[p * w.x.size() + i]), expected,
                    3e-4 + 1e-5 * std::abs(expected))
            << set->name << " parameter " << p;
      }
    }
  }
}

TEST(SaddleKernel, GramIsTheProductOfTheColumns) {
  const Window w = window();
  for (const SaddleKernels* set : sets()) {
    std::vector<float> columns(static_cast<std::size_t>(kSaddleColumns) * w.x.size());
    std::array<float, 55> lower{};
    set->sum(w.view(), as_model(kBent), columns.data(), lower.data());
    std::size_t at = 0;
    for (std::size_t r = 0; r < kSaddleColumns; ++r) {
      for (std::size_t c = 0; c <= r; ++c, ++at) {
        double sum = 0, size = 0;
        for (std::size_t i = 0; i < static_cast<std::size_t>(w.n); ++i) {
          const double product = static_cast<double>(columns[r * w.x.size() + i]) *
                                 static_cast<double>(columns[c * w.x.size() + i]);
          sum += product, size += std::abs(product);
        }
        EXPECT_NEAR(static_cast<double>(lower[at]), sum, 1e-5 * size + 1e-6) << set->name << r << "," << c;
      }
    }
  }
}

TEST(SaddleKernel, PeaksAreThoseOfEachRow) {
  std::vector<float> row(300);
  for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<float>((i * 7919) % 101);
  row[20] = row[21] = 200;
  std::vector<int> expected;
  for (int x = 5; x < 290; ++x) {
    const auto i = static_cast<std::size_t>(x);
    if (row[i] >= 60 && row[i] >= row[i - 1] && row[i] > row[i + 1]) expected.push_back(x);
  }
  for (const SaddleKernels* set : sets()) {
    std::vector<int> found(300);
    found.resize(static_cast<std::size_t>(set->peaks(row.data(), 5, 290, 60, found.data())));
    EXPECT_EQ(found, expected) << set->name;
  }
}

// Minus the determinant of second differences, in integers.
TEST(SaddleKernel, ResponseIsTheDeterminant) {
  std::vector<unsigned char> rows(3 * 77);
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i] = static_cast<unsigned char>((i * i * 31 + i * 7) % 256);
  const unsigned char *a = rows.data(), *b = a + 77, *c = b + 77;
  for (const SaddleKernels* set : sets()) {
    std::vector<float> out(77);
    set->respond(a, b, c, 77, out.data());
    for (int x = 2; x < 75; ++x) {
      const int xx = b[x - 2] + b[x + 2] - 2 * b[x], yy = a[x] + c[x] - 2 * b[x];
      const int xy = a[x - 2] + c[x + 2] - a[x + 2] - c[x - 2];
      EXPECT_FLOAT_EQ(out[static_cast<std::size_t>(x)],
                      static_cast<float>(xy * xy) / 16 - static_cast<float>(xx * yy));
    }
  }
}

}  // namespace
}  // namespace plumbline::test

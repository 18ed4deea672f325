// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plumbline/core/linalg.hpp"
#include "refine/seed.hpp"

namespace plumbline::detail {
namespace {

// Pixels over the image and `margin` of it around, with their rays.
struct Sample {
  Vec2 px;
  Vec3 ray;
};

std::vector<Sample> samples_of(const Lens& lens, ImageSize size, int across, double margin) {
  const int down = std::max(2, across * size.height / std::max(1, size.width));
  std::vector<Sample> samples;
  for (int row = 0; row < down; ++row) {
    for (int column = 0; column < across; ++column) {
      const double x = (1 + 2 * margin) * column / (across - 1) - margin,
                   y = (1 + 2 * margin) * row / (down - 1) - margin;
      const Vec2 px(x * size.width - 0.5, y * size.height - 0.5);
      if (const auto ray = unproject(lens, px)) samples.push_back({px, *ray});
    }
  }
  return samples;
}

// The projection is linear in all but the core parameters.
bool fit_linear(Lens& lens, const std::vector<Sample>& samples) {
  const int n = n_params(lens) - 4;
  MatX A = MatX::Zero(n, n);
  VecX b = VecX::Zero(n);
  int n_inside = 0;
  for (const Sample& sample : samples) {
    SparseJac J;
    const auto px = project_sparse(lens, sample.ray, nullptr, &J);
    if (!px) continue;
    ++n_inside;
    for (int i = 4; i < J.n; ++i) {
      for (int j = 4; j < J.n; ++j) A(J.index[i] - 4, J.index[j] - 4) += J.J[i].dot(J.J[j]);
      b[J.index[i] - 4] += J.J[i].dot(sample.px - *px);
    }
  }
  if (n_inside < n / 4) return false;
  // Parameters that no sample touches stay where the regularisation has them; 1e-8 of the data moves the
  // others by less than any corner finder sees.
  const double whiff = 1e-8 * A.trace() / n;
  for (const PriorRow& row : priors(lens)) {
    for (std::size_t i = 0; i < 2; ++i) {
      for (std::size_t j = 0; j < 2; ++j)
        A(row.index[i] - 4, row.index[j] - 4) += whiff * row.weight[i] * row.weight[j];
    }
  }
  const auto x = solve_spd(A, b);
  if (!x) return false;
  for (int i = 0; i < n; ++i) params(lens)[static_cast<std::size_t>(4 + i)] = (*x)(i, 0);
  return true;
}

double widest_angle(const Calibration& cal) {
  double widest = 0;
  for (std::size_t v = 0; v < cal.fits.size(); ++v) {
    if (!takes_part(cal, v)) continue;
    const View& view = cal.data.views[v];
    for (const Corner& c : view.corners) {
      const Vec3 p = *cal.T_rig_board[view.frame] * cal.data.targets[view.target].points[c.point];
      widest = std::max(widest, std::atan2(p.head<2>().norm(), p.z()));
    }
  }
  return widest;
}

}  // namespace

Result<Lens> sparse_like(const Lens& like, const std::string& spec, ImageSize size) {
  std::vector<Vec3> rays;
  for (const Sample& sample : samples_of(like, size, 41, 0)) rays.push_back(sample.ray);
  const auto core = params(like);
  auto made = make_lens(complete_spec(spec, size, rays), size, core[0]);
  if (!made) return made;
  Lens lens = *std::move(made);
  std::copy_n(core.begin(), 4, params(lens).begin());
  const int across = std::clamp(static_cast<int>(std::sqrt(16.0 * n_params(lens))), 60, 200);
  if (!fit_linear(lens, samples_of(like, size, across, 0.25))) {
    return Error{ErrorCode::kNotConverged,
                 fmt::format("lens {} cannot be fitted to the {} that describes this camera; is its field of "
                             "view too narrow?",
                             lens_spec(lens), lens_name(like)),
                 "lens"};
  }
  return lens;
}

Result<Calibration> seed_sparse(const Dataset& mono, const std::string& spec, const RefineOptions& options,
                                const Constraints& constraints) {
  constexpr double kWide = 1.05;  // rad; beyond it a perspective lens only loses time
  const auto seed_with = [&](const std::string& name) {
    return seed_camera(mono, name, options,
                       of_matrix_alone(constraints, n_params(*make_lens(name, ImageSize{}, 1.0))));
  };
  // The spline takes over whatever is left; this far from the corners it starts well enough, and another lens
  // would only be tried for nothing.
  const double near_px = 1e-3 * std::hypot(mono.cameras[0].size.width, mono.cameras[0].size.height);
  auto best = seed_with("kb4");
  if (!best || (widest_angle(*best) < kWide && score_px(*best) > near_px)) {
    auto other = seed_with("opencv8");
    if (other && (!best || score_px(*other) < score_px(*best))) best = std::move(other);
  }
  if (!best) return best;
  const Camera& camera = best->rig.cameras[0];
  const auto lens = sparse_like(camera.lens, spec, camera.size);
  if (!lens) {
    Error error = lens.error();
    error.where = "camera " + camera.name;
    return error;
  }
  best->rig.cameras[0].lens = *lens;
  best->stats.weak.clear();  // what it says of the other lens
  bring_back(*best);
  pose_views(*best, Repose::kPoor);
  return best;
}

}  // namespace plumbline::detail

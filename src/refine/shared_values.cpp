// SPDX-License-Identifier: Apache-2.0
// The shared parameters as one vector of numbers, and what is said of single ones: ties, holds, priors.
#include <algorithm>

#include "plumbline/core/check.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {
namespace {

// The poses among the shared parameters, in their order, and where each starts.
template <class Visit>
void for_each_pose(const Offsets& offsets, Visit&& visit) {
  for (std::size_t cam = 0; cam < offsets.pose.size(); ++cam) {
    if (offsets.pose[cam] >= 0) visit(offsets.pose[cam], cam);
  }
}

}  // namespace

Reduction reduction_of(const SolveSpec& spec, int n_shared) {
  Reduction reduction{std::vector<int>(static_cast<std::size_t>(n_shared), -1), 0};
  for (int i = 0; i < n_shared; ++i) {
    if (!spec.held.empty() && spec.held[i]) continue;
    const int leader = spec.tied_to.empty() ? i : spec.tied_to[i];
    PLUMBLINE_CHECK(leader <= i, "a tie leads to the first of its parameters");
    reduction.column[i] = leader < i ? reduction.column[leader] : reduction.n_free++;
  }
  return reduction;
}

VecX shared_values(const Calibration& cal) {
  const Offsets offsets = offsets_of(cal.rig);
  VecX x(offsets.total);
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const auto k = params(cal.rig.cameras[cam].lens);
    std::copy(k.begin(), k.end(), x.data() + offsets.lens[cam]);
  }
  for_each_pose(offsets, [&](int at, std::size_t cam) {
    const SE3& T = cal.rig.T_cam_rig[cam];
    x.segment<3>(at) = so3_log(T.R());
    x.segment<3>(at + 3) = T.t();
  });
  return x;
}

void set_shared_value(Calibration& cal, int index, double value) {
  const Offsets offsets = offsets_of(cal.rig);
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const auto k = params(cal.rig.cameras[cam].lens);
    const int i = index - offsets.lens[cam];
    if (i >= 0 && i < static_cast<int>(k.size())) k[static_cast<std::size_t>(i)] = value;
  }
  for_each_pose(offsets, [&](int at, std::size_t cam) {
    const int i = index - at;
    if (i < 0 || i >= 6) return;
    SE3& T = cal.rig.T_cam_rig[cam];
    Vec3 w = so3_log(T.R()), t = T.t();
    (i < 3 ? w[i] : t[i - 3]) = value;
    T = SE3(i < 3 ? so3_exp(w) : T.R(), t);
  });
}

PriorRows prior_rows(const Calibration& cal, const SolveSpec& spec) {
  const Offsets offsets = offsets_of(cal.rig);
  const VecX x = shared_values(cal);
  const int n = static_cast<int>(spec.priors.size());
  PriorRows rows{VecX(n), MatX::Zero(n, offsets.total)};
  for (int k = 0; k < n; ++k) {
    const PriorTerm& prior = spec.priors[k];
    const double weight = spec.prior_weight / prior.sigma;
    rows.r[k] = weight * (x[prior.index] - prior.value);
    rows.J(k, prior.index) = weight;
    // exp(dw) R has the rotation vector log(R) + J_l^-1 dw.
    for_each_pose(offsets, [&](int at, std::size_t) {
      const int i = prior.index - at;
      if (i < 0 || i >= 3) return;
      const Vec3 w = x.segment<3>(at);
      rows.J.block<1, 3>(k, at) = weight * so3_left_jacobian_inverse(w).row(i);
    });
  }
  return rows;
}

}  // namespace plumbline::detail

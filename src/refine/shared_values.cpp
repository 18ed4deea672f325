// SPDX-License-Identifier: Apache-2.0
// The shared parameters as one vector of numbers, and what is said of single ones: ties, holds, priors.
#include <algorithm>

#include "plumbline/core/check.hpp"
#include "plumbline/geometry/so3.hpp"
#include "refine/solve.hpp"

namespace plumbline::detail {
namespace {

// The poses among the shared parameters, in their order, and where each starts.
template <class Cal, class Visit>
void for_each_pose(Cal& cal, Visit&& visit) {
  const Offsets offsets = offsets_of(cal);
  for (std::size_t cam = 1; cam < cal.rig.cameras.size(); ++cam)
    visit(offsets.pose[cam], cal.rig.T_cam_rig[cam]);
  for (std::size_t board = 1; board < cal.data.targets.size(); ++board)
    visit(offsets.board[board], cal.T_board0_board[board]);
}

// The bows, line delays and time offsets, likewise.
template <class Cal, class Visit>
void for_each_effect(Cal& cal, Visit&& visit) {
  const Offsets offsets = offsets_of(cal);
  for (std::size_t i = 0; i < cal.bow_m.size(); ++i) {
    if (offsets.bow[i] < 0) continue;
    visit(offsets.bow[i], cal.bow_m[i]->x());
    visit(offsets.bow[i] + 1, cal.bow_m[i]->y());
  }
  for (std::size_t i = 0; i < cal.clocks.size(); ++i) {
    if (offsets.line_delay[i] >= 0) visit(offsets.line_delay[i], *cal.clocks[i].line_delay_s);
    if (offsets.time_offset[i] >= 0) visit(offsets.time_offset[i], *cal.clocks[i].time_offset_s);
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
  const Offsets offsets = offsets_of(cal);
  VecX x(offsets.total);
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const auto k = params(cal.rig.cameras[cam].lens);
    std::copy(k.begin(), k.end(), x.data() + offsets.lens[cam]);
  }
  for_each_pose(cal, [&](int at, const SE3& T) {
    x.segment<3>(at) = so3_log(T.R());
    x.segment<3>(at + 3) = T.t();
  });
  for_each_effect(cal, [&](int at, double value) { x[at] = value; });
  return x;
}

void set_shared_value(Calibration& cal, int index, double value) {
  const Offsets offsets = offsets_of(cal);
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const auto k = params(cal.rig.cameras[cam].lens);
    const int i = index - offsets.lens[cam];
    if (i >= 0 && i < static_cast<int>(k.size())) k[static_cast<std::size_t>(i)] = value;
  }
  for_each_pose(cal, [&](int at, SE3& T) {
    const int i = index - at;
    if (i < 0 || i >= 6) return;
    Vec3 w = so3_log(T.R()), t = T.t();
    (i < 3 ? w[i] : t[i - 3]) = value;
    T = SE3(i < 3 ? so3_exp(w) : T.R(), t);
  });
  for_each_effect(cal, [&](int at, double& number) {
    if (at == index) number = value;
  });
}

PriorRows prior_rows(const Calibration& cal, const SolveSpec& spec) {
  const VecX x = shared_values(cal);
  const int n = static_cast<int>(spec.priors.size());
  PriorRows rows{VecX(n), MatX::Zero(n, x.size())};
  for (int k = 0; k < n; ++k) {
    const PriorTerm& prior = spec.priors[k];
    const double weight = spec.prior_weight / prior.sigma;
    rows.r[k] = weight * (x[prior.index] - prior.value);
    rows.J(k, prior.index) = weight;
    // exp(dw) R has the rotation vector log(R) + J_l^-1 dw.
    for_each_pose(cal, [&](int at, const SE3&) {
      const int i = prior.index - at;
      if (i < 0 || i >= 3) return;
      const Vec3 w = x.segment<3>(at);
      rows.J.block<1, 3>(k, at) = weight * so3_left_jacobian_inverse(w).row(i);
    });
  }
  return rows;
}

PriorScatter scatter_of(const PriorRows& priors, const Reduction& reduction) {
  PriorScatter scatter;
  for (Eigen::Index k = 0; k < priors.r.size(); ++k) {
    bool moves = false;
    for (Eigen::Index i = 0; i < priors.J.cols(); ++i)
      moves = moves || (priors.J(k, i) != 0 && reduction.column[static_cast<std::size_t>(i)] >= 0);
    if (!moves) continue;
    ++scatter.n;
    scatter.sum += priors.r[k] * priors.r[k];
  }
  return scatter;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#include "refine/weak.hpp"

namespace plumbline::detail {

Status judge_determination(Calibration& cal, const SolveSpec& spec) {
  const SharedCovariance c = shared_covariance(cal, spec);
  if (c.unit_covariance) cal.covariance = c.variance * *c.unit_covariance;
  return {};
}

}  // namespace plumbline::detail

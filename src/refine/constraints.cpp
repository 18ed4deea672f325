// SPDX-License-Identifier: Apache-2.0
#include "refine/constraints.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "plumbline/core/text.hpp"
#include "refine/parameter_names.hpp"

namespace plumbline::detail {
namespace {

using Found = ParameterNames::Found;

Error bad(std::string message, std::string where) {
  return {ErrorCode::kInvalidData, std::move(message), std::move(where)};
}

std::optional<Error> check_value(const ParameterNames& names, int i, double value, const std::string& where) {
  if (!names.is_focal(i) || value > 0) return std::nullopt;
  return bad(fmt::format("{} is not a focal length; it must be positive", value), where);
}

// One number says what one parameter is. For several only zero does: what a term is that is not there.
std::optional<Error> check_holder(const ParameterNames& names, const Found& found,
                                  const std::string& value_text, const std::string& name,
                                  const std::string& where) {
  if (found.is_group)
    return bad(fmt::format("{} is a group of {} parameters, which have no common value; hold it without a "
                           "value, or give each its own: {}",
                           name, found.at.size(), names.list(found.at, "=...")),
               where);
  if (found.at.size() == 1 || parse_double(value_text) == 0.0) return std::nullopt;
  return bad(
      fmt::format("{} cameras or boards have a parameter {}, and only 0 can be meant for all; say which "
                  "has this value: {}",
                  found.at.size(), name, names.list(found.at, "=" + value_text)),
      where);
}

Status add_fixed(Constraints& c, const ParameterNames& names, const std::string& text) {
  const std::string where = "fixed parameter '" + text + "'";
  const std::size_t equals = text.find('=');
  const std::string name(trim(text.substr(0, equals)));
  const auto found = names.find(name, where);
  if (!found) return found.error();
  std::optional<double> value;
  if (equals != std::string::npos) {
    const std::string value_text(trim(text.substr(equals + 1)));
    value = parse_double(value_text);
    if (!value) return bad("what follows '=' is not a number", where);
    if (auto error = check_holder(names, *found, value_text, name, where)) return *error;
  }
  for (int i : found->at) {
    c.held[static_cast<std::size_t>(i)] = true;
    if (!value) continue;
    if (auto error = check_value(names, i, *value, where)) return *error;
    for (const auto& [other, given] : c.values) {
      if (other == i && given != *value)
        return bad(fmt::format("{} is to be {} and {}", names[i], given, *value), where);
    }
    c.values.emplace_back(i, *value);
  }
  return {};
}

Status add_tie(Constraints& c, const ParameterNames& names, const std::string& text) {
  const std::string where = "tie '" + text + "'";
  const auto sides = split(text, '=');
  if (sides.size() != 2) return bad("a tie is NAME=NAME, such as fx=fy", where);
  const auto a = names.find(std::string(trim(sides[0])), where);
  if (!a) return a.error();
  const auto b = names.find(std::string(trim(sides[1])), where);
  if (!b) return b.error();
  if (a->at.size() != b->at.size())
    return bad(fmt::format("{} parameters on the left, {} on the right; they are tied one by one",
                           a->at.size(), b->at.size()),
               where);
  for (std::size_t k = 0; k < a->at.size(); ++k) {
    const int i = a->at[k], j = b->at[k];
    if (i == j) return bad("it ties " + names[i] + " to itself", where);
    if (a->is_group && names.parameter(i) != names.parameter(j))
      return bad(
          fmt::format("it ties {} to {}; only lenses of one kind are tied as a whole", names[i], names[j]),
          where);
    if (names.is_step(i) != names.is_step(j))
      return bad("a lens' parameter cannot be tied to a pose's", where);
    if (names.is_turn(i) || names.is_turn(j))
      return bad("rotations cannot be tied, they do not add; hold them with fixed", where);
    const int keep = std::min(c.tied_to[i], c.tied_to[j]), go = std::max(c.tied_to[i], c.tied_to[j]);
    std::replace(c.tied_to.begin(), c.tied_to.end(), go, keep);
  }
  return {};
}

Status add_prior(Constraints& c, const ParameterNames& names, const Prior& prior) {
  const std::string where = "prior of '" + prior.parameter + "'";
  const auto found = names.find(prior.parameter, where);
  if (!found) return found.error();
  if (found->is_group)
    return bad(fmt::format("{} is a group of {} parameters, which have no common value; give each its own "
                           "prior: {}",
                           prior.parameter, found->at.size(), names.list(found->at)),
               where);
  if (!std::isfinite(prior.value) || !std::isfinite(prior.sigma) || !(prior.sigma > 0))
    return bad(fmt::format("{} +- {}: a prior needs a value and a sigma above 0", prior.value, prior.sigma),
               where);
  for (int i : found->at) {
    if (auto error = check_value(names, i, prior.value, where)) return *error;
    c.priors.push_back({i, prior.value, prior.sigma});
  }
  return {};
}

// All that is tied to something held is held as well; held values of one group must agree.
Status spread_holds(Constraints& c, const ParameterNames& names) {
  const int n = names.size();
  for (int i = 0; i < n; ++i) {
    if (!c.held[i]) continue;
    for (int j = 0; j < n; ++j) {
      if (c.tied_to[j] == c.tied_to[i]) c.held[j] = true;
    }
  }
  for (const auto& [i, value] : c.values) {
    for (const auto& [j, other] : c.values) {
      if (c.tied_to[i] == c.tied_to[j] && value != other)
        return bad(
            fmt::format("{} is tied to {}, but they are to be {} and {}", names[i], names[j], value, other),
            "options");
    }
  }
  return {};
}

// Everything that does not belong to these cameras. The rig's frame is that of the first camera, whose pose
// is none of the parameters: what can move is where the others stand.
Status hold_others(Constraints& c, const Calibration& cal, const std::vector<std::string>& only) {
  if (only.empty()) return {};
  std::vector<bool> wanted(cal.rig.cameras.size(), false);
  for (const std::string& name : only) {
    const auto cam = cal.rig.find(name);
    if (!cam) {
      std::vector<std::string> there;
      for (const Camera& camera : cal.rig.cameras) there.push_back(camera.name);
      return bad("there is no such camera; there are: " + join(there, ", "), "only '" + name + "'");
    }
    wanted[*cam] = true;
  }
  const auto n_held = std::count(wanted.begin(), wanted.end(), false);
  if (wanted[0] && n_held > 1)
    return bad(
        fmt::format("camera {0} carries the rig's frame, so that with it all other cameras would move; "
                    "solve for all cameras but one, or make another camera the first",
                    cal.rig.cameras[0].name),
        "only '" + cal.rig.cameras[0].name + "'");
  const Offsets offsets = offsets_of(cal);
  for (std::size_t cam = 0; cam < wanted.size(); ++cam) {
    if (wanted[cam]) continue;
    const int n = n_params(cal.rig.cameras[cam].lens);
    for (int i = 0; i < n; ++i) c.held[offsets.lens[cam] + i] = true;
    // Of two cameras only the pose of one relative to the other exists.
    for (int i = 0; i < 6 && offsets.pose[cam] >= 0 && !wanted[0]; ++i) c.held[offsets.pose[cam] + i] = true;
    if (offsets.line_delay[cam] >= 0) c.held[offsets.line_delay[cam]] = true;
    if (offsets.time_offset[cam] >= 0) c.held[offsets.time_offset[cam]] = true;
  }
  for (std::size_t board = 1; board < cal.data.targets.size(); ++board) {
    for (int i = 0; i < 6; ++i) c.held[offsets.board[board] + i] = true;
  }
  return {};
}

// Control points mean nothing one by one, and the four other parameters of a splined lens are held.
Status check_splined(const Constraints& c, const Calibration& cal) {
  const Offsets offsets = offsets_of(cal);
  for (std::size_t cam = 0; cam < cal.rig.cameras.size(); ++cam) {
    const Camera& camera = cal.rig.cameras[cam];
    if (!is_sparse(camera.lens)) continue;
    const auto of_lens = [&](int i) {
      return i >= offsets.lens[cam] && i < offsets.lens[cam] + n_params(camera.lens);
    };
    bool asked =
        std::any_of(c.priors.begin(), c.priors.end(), [&](const PriorTerm& p) { return of_lens(p.index); });
    for (int i = 0; i < static_cast<int>(c.tied_to.size()); ++i)
      asked |= c.tied_to[i] != i && (of_lens(i) || of_lens(c.tied_to[i]));
    if (!asked) continue;
    return Error{
        ErrorCode::kUnsupported,
        "a splined lens takes neither ties nor priors; choose another lens, or hold parameters instead",
        "camera " + camera.name};
  }
  return {};
}

}  // namespace

bool Constraints::any() const {
  for (std::size_t i = 0; i < tied_to.size(); ++i) {
    if (held[i] || tied_to[i] != static_cast<int>(i)) return true;
  }
  return !priors.empty();
}

Result<Constraints> constraints_of(const Calibration& cal, const RefineOptions& options) {
  const ParameterNames names(cal);
  Constraints c;
  c.held.assign(static_cast<std::size_t>(names.size()), false);
  for (int i = 0; i < names.size(); ++i) c.tied_to.push_back(i);
  for (const std::string& text : options.fixed) {
    if (auto status = add_fixed(c, names, text); !status) return status.error();
  }
  for (const std::string& text : options.ties) {
    if (auto status = add_tie(c, names, text); !status) return status.error();
  }
  for (const Prior& prior : options.priors) {
    if (auto status = add_prior(c, names, prior); !status) return status.error();
  }
  if (auto status = check_splined(c, cal); !status) return status.error();
  if (auto status = hold_others(c, cal, options.only); !status) return status.error();
  if (auto status = spread_holds(c, names); !status) return status.error();
  return c;
}

Constraints slice(const Constraints& c, int first, int n) {
  Constraints part;
  const auto inside = [&](int i) { return i >= first && i < first + n; };
  for (int i = first; i < first + n; ++i) {
    part.held.push_back(c.held[i]);
    const auto leader = std::find(c.tied_to.begin() + first, c.tied_to.begin() + i, c.tied_to[i]);
    part.tied_to.push_back(static_cast<int>(leader - c.tied_to.begin()) - first);
  }
  for (const auto& [i, value] : c.values) {
    for (int j = first; j < first + n; ++j) {
      if (c.tied_to[j] == c.tied_to[i]) part.values.emplace_back(j - first, value);
    }
  }
  for (PriorTerm prior : c.priors) {
    if (!inside(prior.index)) continue;
    prior.index -= first;
    part.priors.push_back(prior);
  }
  return part;
}

namespace {

// What each parameter has to become, from what it is.
VecX wanted_values(const VecX& x, const Constraints& c) {
  VecX wanted = x;
  for (int i = 0; i < static_cast<int>(c.tied_to.size()); ++i) {
    double sum = 0, held_at = 0;
    int n = 0, n_held = 0;
    for (int j = 0; j < static_cast<int>(c.tied_to.size()); ++j) {
      if (c.tied_to[j] != c.tied_to[i]) continue;
      sum += x[j];
      ++n;
      if (c.held[j] && n_held++ == 0) held_at = x[j];
    }
    if (n > 1) wanted[i] = n_held > 0 ? held_at : sum / n;
  }
  for (const auto& [i, value] : c.values) {
    for (int j = 0; j < static_cast<int>(c.tied_to.size()); ++j) {
      if (c.tied_to[j] == c.tied_to[i]) wanted[j] = value;
    }
  }
  return wanted;
}

}  // namespace

void apply(Calibration& cal, const Constraints& c) {
  const VecX x = shared_values(cal), wanted = wanted_values(x, c);
  for (int i = 0; i < x.size(); ++i) {
    if (wanted[i] != x[i]) set_shared_value(cal, i, wanted[i]);
  }
}

void apply(Lens& lens, const Constraints& c) {
  const auto k = params(lens);
  const int n = std::min(static_cast<int>(k.size()), static_cast<int>(c.tied_to.size()));
  VecX x(static_cast<int>(c.tied_to.size()));
  x.setZero();
  for (int i = 0; i < n; ++i) x[i] = k[i];
  const VecX wanted = wanted_values(x, c);
  for (int i = 0; i < n; ++i) k[i] = wanted[i];
}

SolveSpec with_constraints(SolveSpec spec, const Constraints& c) {
  spec.held = c.held;
  spec.tied_to = c.tied_to;
  spec.priors = c.priors;
  return spec;
}

std::vector<PriorPull> prior_pulls(const Calibration& cal, const std::vector<PriorTerm>& priors) {
  const std::vector<std::string> names = shared_parameter_names(cal);
  const VecX x = shared_values(cal);
  std::vector<PriorPull> pulls;
  for (const PriorTerm& prior : priors)
    pulls.push_back(
        {names[prior.index], prior.value, prior.sigma, (x[prior.index] - prior.value) / prior.sigma});
  return pulls;
}

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/refine/refine.hpp"

namespace plumbline::detail {

/// Why a lens cannot be that of a camera: what the options hold, tie or know cannot be said of it.
struct Ineligible {
  Error error;
  bool lacks_name = false;  ///< it has no parameter of that name; else the option is wrong in another way
};

/// Looks at those names of the options that concern this camera, with `lens` for each camera whose lens is to
/// be chosen. nullopt when all of them can be met.
std::optional<Ineligible> ineligible(const Dataset& data, const RefineOptions& options, int cam,
                                     const std::string& lens);

/// That no lens of these can be chosen for the camera, when that is so, by the name of the option.
std::optional<Error> none_eligible(const Dataset& data, const RefineOptions& options, int cam,
                                   const std::vector<std::string>& lenses);

/// Whether the options can be met by the lenses chosen, together. kInvalidData says what was chosen.
Status check_choice(const Dataset& data, const RefineOptions& options,
                    const std::vector<std::string>& chosen);

}  // namespace plumbline::detail

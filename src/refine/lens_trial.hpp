// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "plumbline/refine/choose_lens.hpp"
#include "refine/constraints.hpp"
#include "refine/held_out.hpp"

/// What choose_lenses() tries, one camera and one lens at a time.
namespace plumbline::detail {

struct LensTrial {
  LensTry row;
  std::optional<Calibration> fit;  ///< of the camera alone
  Constraints constraints;
  std::vector<HeldOut> errors;
};

/// How lenses of the family are fitted to one camera: opencv5 is calibrated, kb4 too where the camera sees
/// far; the marks of the better of the two count, and every lens starts from its boards.
class LensFitter {
 public:
  /// \pre `mono` has one camera; both outlive this
  LensFitter(const Dataset& mono, const RefineOptions& options);
  bool has_base() const { return !bases_.empty(); }
  const Error& error() const { return error_; }  ///< why there is no base
  LensTrial fit(const std::string& name) const;
  /// Four robust standard deviations of a residual of the fit whose marks count.
  double cap() const;

 private:
  RefineOptions options_of(const std::string& name) const;
  Calibration near_fit(const std::string& name, const Constraints& constraints) const;

  const Dataset& mono_;
  const RefineOptions& options_;
  std::vector<Calibration> bases_;  // the first is the one whose marks count
  Error error_;
};

/// A choice and what it was made from.
struct ChosenLenses {
  LensChoice choice;
  std::vector<std::optional<Calibration>> fits;  ///< per camera alone; nullopt where its lens was given
};
Result<ChosenLenses> choose_with_fits(const Dataset& data, const RefineOptions& options,
                                      const std::vector<std::string>& candidates);

}  // namespace plumbline::detail

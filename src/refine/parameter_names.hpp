// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/calibration.hpp"

namespace plumbline::detail {

/// The shared parameters by every name that an option may use for them (RefineOptions::fixed).
class ParameterNames {
 public:
  /// What a name stands for: one parameter (of several cameras), or a group of different ones.
  struct Found {
    std::vector<int> at;  ///< indices into shared_parameter_names(), ascending
    bool is_group = false;
  };

  explicit ParameterNames(const Calibration& calibration);

  int size() const { return static_cast<int>(all_.size()); }
  /// "left fx".
  const std::string& operator[](int i) const { return all_[static_cast<std::size_t>(i)]; }
  /// "fx".
  const std::string& parameter(int i) const { return halves_[static_cast<std::size_t>(i)].parameter; }
  bool is_focal(int i) const;
  bool is_step(int i) const;  ///< a component of a pose
  bool is_turn(int i) const;  ///< one of its rotation

  /// kInvalidData when nothing has the name: lists what there is. \param where  of the error
  Result<Found> find(const std::string& name, const std::string& where) const;

  /// The first few as a list, each with `value` behind it: "left fx=500, right fx=500".
  std::string list(const std::vector<int>& at, const std::string& value = "") const;

 private:
  struct Name {
    std::string owner, parameter;
  };
  template <class Wanted>
  std::vector<int> where_is(Wanted&& wanted) const;
  bool in_group(const Name& name, const std::string& group) const;
  bool is_owner(const std::string& name) const;
  Error unknown(const std::string& wanted, const std::string& where) const;

  std::vector<std::string> all_, cameras_;
  std::vector<Name> halves_;
};

}  // namespace plumbline::detail

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "plumbline/core/check.hpp"

namespace plumbline {

/// Why an operation failed, for callers that branch on it. The text is in Error::message.
enum class ErrorCode {
  kIo,            ///< a file or folder could not be read or written
  kParse,         ///< text is not what its format says
  kUnsupported,   ///< a valid request that this format, lens or target cannot express
  kDegenerate,    ///< the input does not determine the answer
  kNotConverged,  ///< an iteration ended without an answer
  kInvalidData,   ///< the input contradicts itself (two sizes in one camera, NaN, ...)
};

/// "kDegenerate" and so on; the spelling appears in every message that a user reads.
const char* to_string(ErrorCode code);

/// A failure that a user must read: what, where, the number, and the next step.
struct Error {
  ErrorCode code = ErrorCode::kInvalidData;
  std::string message;  ///< what happened, with the numbers, and what to do next; one line
  std::string where;    ///< file, view, camera or parameter it is about; may be empty

  /// "where: message [kCode]", one line.
  std::string text() const;
};

/// A value or an Error. Member names are those of std::expected, so that it can become an alias later.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::in_place_index<0>, std::move(value)) {}
  Result(Error error) : state_(std::in_place_index<1>, std::move(error)) {}

  bool has_value() const { return state_.index() == 0; }
  explicit operator bool() const { return has_value(); }

  /// \pre has_value(); throws std::invalid_argument with the error's text otherwise.
  T& value() & {
    require();
    return std::get<0>(state_);
  }
  const T& value() const& {
    require();
    return std::get<0>(state_);
  }
  T value() && {  // by value: a reference into a temporary would dangle in `for (auto& x : f().value())`
    require();
    return std::get<0>(std::move(state_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  /// \pre !has_value(); throws std::invalid_argument otherwise.
  const Error& error() const {
    PLUMBLINE_CHECK(!has_value(), "error() of a Result that holds a value");
    return std::get<1>(state_);
  }

 private:
  void require() const {
    if (!has_value()) throw_invalid_argument(std::get<1>(state_).text());
  }
  std::variant<T, Error> state_;
};

/// Success without a value, or an Error.
template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  Result(Error error) : error_(std::move(error)) {}
  bool has_value() const { return !error_.has_value(); }
  explicit operator bool() const { return has_value(); }
  const Error& error() const {
    PLUMBLINE_CHECK(!has_value(), "error() of a Result without one");
    return *error_;
  }

 private:
  std::optional<Error> error_;
};

using Status = Result<void>;

}  // namespace plumbline

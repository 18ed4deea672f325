// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/result.hpp"

#include <stdexcept>

namespace plumbline {

const char* to_string(ErrorCode code) {
  switch (code) {
    case ErrorCode::kIo:
      return "kIo";
    case ErrorCode::kParse:
      return "kParse";
    case ErrorCode::kUnsupported:
      return "kUnsupported";
    case ErrorCode::kDegenerate:
      return "kDegenerate";
    case ErrorCode::kNotConverged:
      return "kNotConverged";
    case ErrorCode::kInvalidData:
      return "kInvalidData";
  }
  return "kUnknown";
}

std::string Error::text() const {
  return (where.empty() ? "" : where + ": ") + message + " [" + to_string(code) + "]";
}

void throw_invalid_argument(const std::string& text) { throw std::invalid_argument(text); }

void throw_failed_check(std::string_view text, std::string_view condition) {
  std::string what(text);
  what.append(" (").append(condition).append(")");
  throw std::invalid_argument(what);
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <exception>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/core/types.hpp"

/// YAML as this module reads and writes it; yaml.cpp is the only file of the project that includes yaml-cpp.
///
/// A file is hostile until read: text over 64 MiB, nesting over 32 levels, more than two million nodes,
/// aliases, keys that occur twice and second documents are refused with kParse. OpenCV's dialect
/// ("%YAML:1.0", "!!opencv-matrix") is understood.
///
/// Fields are read with plain accessors that throw FieldError; read_yaml() catches it and makes it an Error.
/// So a reader is written without a branch per field, and no exception leaves this module.
namespace plumbline::io {

struct YamlNode {
  enum class Kind { kNull, kScalar, kSequence, kMap };
  Kind kind = Kind::kNull;
  int line = 0;  ///< from 1
  const YamlNode* parent = nullptr;
  std::string scalar;
  std::vector<std::string> keys;  ///< of a map, in the order of the file
  std::vector<YamlNode> items;    ///< of a sequence, or the values of a map
};

/// What is wrong with a field. Thrown only below read_yaml().
class FieldError : public std::exception {
 public:
  explicit FieldError(Error error) : error_(std::move(error)) {}
  const Error& error() const { return error_; }
  const char* what() const noexcept override { return error_.message.c_str(); }

 private:
  Error error_;
};

/// A place in a file. Every accessor throws FieldError that says "parts[0].pose.translation_m, line 12".
class Field {
 public:
  explicit Field(const YamlNode& node) : node_(&node) {}

  bool is_map() const { return node_->kind == YamlNode::Kind::kMap; }
  bool is_sequence() const { return node_->kind == YamlNode::Kind::kSequence; }
  bool is_null() const { return node_->kind == YamlNode::Kind::kNull; }
  bool has(std::string_view key) const { return find(key).has_value(); }

  /// The value of a key; null values count as absent for find().
  Field at(std::string_view key) const;
  std::optional<Field> find(std::string_view key) const;
  /// All of a map or a sequence.
  std::vector<std::pair<std::string, Field>> entries() const;
  std::vector<Field> items() const;

  std::string text() const;
  std::string_view scalar() const;  ///< the same without a copy; lives as long as the tree
  double number() const;            ///< finite
  int integer() const;
  int integer(int low, int high) const;
  bool boolean() const;  ///< true, false, 1, 0
  /// A sequence of finite numbers, also nested ([[1, 2], [3, 4]]), row by row; n >= 0: exactly so many.
  std::vector<double> numbers(int n = -1) const;

  /// Fails with the name of the first key that is not in the list, and the nearest one that is.
  void only(std::initializer_list<std::string_view> known) const;
  [[noreturn]] void fail(const std::string& message, ErrorCode code = ErrorCode::kParse) const;
  std::string path() const;  ///< "cameras[0].lens"
  int line() const { return node_->line; }

 private:
  void collect(std::vector<double>& out) const;
  const YamlNode* node_;
};

/// The tree of a text; kParse with the line.
Result<std::unique_ptr<YamlNode>> parse_yaml(std::string_view text);

/// Value of an inner Result, or its error as a FieldError that names this field.
template <class T>
T value_or_throw(Result<T> result, const Field& field) {
  if (!result) field.fail(result.error().message, result.error().code);
  return *std::move(result);
}

/// read(root) of a tree with every FieldError made an Error; `file` (may be empty) stands first in
/// Error::where.
template <class T, class Read>
Result<T> read_tree(Result<std::unique_ptr<YamlNode>> tree, const std::string& file, Read&& read) {
  const auto named = [&](Error error) {
    if (!file.empty()) error.where = error.where.empty() ? file : file + ": " + error.where;
    return error;
  };
  if (!tree) return named(tree.error());
  try {
    Result<T> result = read(Field(**tree));
    if (!result) return named(result.error());
    return result;
  } catch (const FieldError& failed) {
    return named(failed.error());
  }
}

/// The same for a text.
template <class T, class Read>
Result<T> read_yaml(std::string_view text, const std::string& file, Read&& read) {
  return read_tree<T>(parse_yaml(text), file, std::forward<Read>(read));
}

/// Sets YamlNode::parent throughout a finished tree.
void set_parents(YamlNode& node);

/// The word of `known` nearest to `word` by edit distance; empty when none is near.
std::string nearest_word(std::string_view word, const std::vector<std::string_view>& known);

/// A string as a YAML scalar: plain where that is safe, else in double quotes.
std::string yaml_text(std::string_view text);
/// A number as all files of this module have it: 17 digits, and no negative zero, which says nothing to a
/// reader and makes files differ that mean the same.
std::string number_text(double value);
/// The shortest text that reads back as the same double, at the end of `out`: for the thousands of numbers of
/// a block, where it takes a third of the time and of the room. No negative zero.
void append_number(std::string& out, double value);
/// "[1, 2, 3]" with 17 digits.
std::string yaml_numbers(const double* values, std::size_t n);
template <class Vector>
std::string yaml_numbers(const Vector& values) {
  return yaml_numbers(values.data(), static_cast<std::size_t>(values.size()));
}
/// A fixed-size matrix row by row (Eigen stores columns).
std::vector<double> row_major(const MatX& M);

}  // namespace plumbline::io

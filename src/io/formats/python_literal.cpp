// SPDX-License-Identifier: Apache-2.0
#include "io/formats/python_literal.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace plumbline::io {
namespace {

constexpr int kMaxDepth = 32, kMaxValues = 2'000'000;

/// Recursive descent; it throws FieldError, and parse_python_literal catches.
class Parser {
 public:
  explicit Parser(std::string_view text) : text_(text) {}

  void document(YamlNode& root) {
    value(root, 0);
    skip_blank();
    if (at_ < text_.size()) fail("something follows the closing bracket");
  }

 private:
  using Kind = YamlNode::Kind;

  [[noreturn]] void fail(const std::string& message) const {
    throw FieldError({ErrorCode::kParse, "not a cameramodel: " + message, fmt::format("line {}", line_)});
  }

  char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }

  void skip_blank() {
    for (; at_ < text_.size(); ++at_) {
      const char c = text_[at_];
      if (c == '#') at_ = std::min(text_.find('\n', at_), text_.size());
      if (peek() == '\n')
        ++line_;
      else if (c != '#' && c != ' ' && c != '\t' && c != '\r')
        return;
    }
  }

  void value(YamlNode& node, int depth) {
    skip_blank();
    if (depth > kMaxDepth) fail(fmt::format("nested deeper than {} levels", kMaxDepth));
    if (++n_values_ > kMaxValues) fail("more than two million values");
    node.line = line_;
    const char c = peek();
    const bool is_bytes = (c == 'b' || c == 'r' || c == 'u') && at_ + 1 < text_.size() &&
                          (text_[at_ + 1] == '\'' || text_[at_ + 1] == '"');
    if (c == '{') return map(node, depth);
    if (c == '[' || c == '(') return sequence(node, c == '[' ? ']' : ')', depth);
    if (is_bytes) ++at_;
    node.kind = Kind::kScalar;
    if (is_bytes || c == '\'' || c == '"')
      node.scalar = string();
    else
      node.scalar = word();
    if (node.scalar == "None") node.kind = Kind::kNull;
  }

  std::string word() {
    const std::size_t begin = at_;
    while (at_ < text_.size() &&
           std::string_view(" \t\r\n,:]})#'\"{[(").find(text_[at_]) == std::string_view::npos)
      ++at_;
    if (at_ == begin)
      fail(at_ < text_.size() ? fmt::format("a value is needed, not '{}'", text_[at_])
                              : "it ends in the middle");
    return std::string(text_.substr(begin, at_ - begin));
  }

  /// One or more strings side by side, joined as Python does. Escapes are kept as they are: no field that we
  /// read has one.
  std::string string() {
    std::string joined;
    while (peek() == '\'' || peek() == '"') {
      const char quote = text_[at_++];
      const std::size_t begin = at_;
      while (peek() != quote) {
        if (peek() == '\\') ++at_;
        if (at_ >= text_.size() || text_[at_] == '\n') fail("a string does not end");
        ++at_;
      }
      joined += text_.substr(begin, at_ - begin);
      ++at_;
      skip_blank();
    }
    return joined;
  }

  /// After a value: a comma or the closing bracket. True when the collection ends.
  bool ends(char closing) {
    skip_blank();
    if (peek() == ',') {
      ++at_;
      skip_blank();
    } else if (peek() != closing) {
      fail(at_ < text_.size() ? fmt::format("',' or '{}' is needed, not '{}'", closing, peek())
                              : "it ends in the middle");
    }
    if (peek() != closing) return false;
    ++at_;
    return true;
  }

  void sequence(YamlNode& node, char closing, int depth) {
    node.kind = Kind::kSequence;
    ++at_;
    skip_blank();
    if (peek() == closing) {
      ++at_;
      return;
    }
    do value(node.items.emplace_back(), depth + 1);
    while (!ends(closing));
  }

  void map(YamlNode& node, int depth) {
    node.kind = Kind::kMap;
    ++at_;
    skip_blank();
    if (peek() == '}') {
      ++at_;
      return;
    }
    do {
      skip_blank();
      if (peek() != '\'' && peek() != '"') fail("a key in quotes is needed");
      std::string key = string();
      if (std::find(node.keys.begin(), node.keys.end(), key) != node.keys.end())
        fail("the key '" + key.substr(0, 40) + "' is there twice");
      if (node.keys.size() > 1000) fail("more than 1000 keys");
      node.keys.push_back(std::move(key));
      skip_blank();
      if (peek() != ':') fail("':' is needed after a key");
      ++at_;
      value(node.items.emplace_back(), depth + 1);
    } while (!ends('}'));
  }

  std::string_view text_;
  std::size_t at_ = 0;
  int line_ = 1, n_values_ = 0;
};

}  // namespace

Result<std::unique_ptr<YamlNode>> parse_python_literal(std::string_view text) {
  auto root = std::make_unique<YamlNode>();
  try {
    Parser(text).document(*root);
  } catch (const FieldError& failed) {
    return failed.error();
  }
  set_parents(*root);
  return root;
}

}  // namespace plumbline::io

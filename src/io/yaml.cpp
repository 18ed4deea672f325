// SPDX-License-Identifier: Apache-2.0
#include "io/yaml.hpp"

#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/mark.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <charconv>
#include <istream>
#include <numeric>
#include <streambuf>
#include <unordered_set>

#include "io/yaml_blocks.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline::io {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{64} << 20, kMaxNodes = 2'000'000;
constexpr int kMaxDepth = 32;

struct Refused {
  std::string message;
  int line;
};

/// Builds our tree from the parser's events. The parser announces a collection before it descends into it, so
/// refusing here also bounds its recursion; its own node type would cost more time and has no such limits.
class Builder : public YAML::EventHandler {
 public:
  /// \param blocks  what stands for scalars with the tag of a lifted block; may be null
  explicit Builder(YamlNode& root, std::vector<std::string>* blocks = nullptr)
      : root_(root), blocks_(blocks) {}

  bool used_all_blocks() const { return !blocks_ || n_blocks_ == blocks_->size(); }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t) override { value(mark, YamlNode::Kind::kNull, {}); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override {
    throw Refused{"aliases (*name) are not read; write the value itself", mark.line + 1};
  }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t,
                const std::string& text) override {
    if (blocks_ && tag == kBlockTag) {
      const auto index = parse_int(text);
      if (!index || static_cast<std::size_t>(*index) != n_blocks_ || n_blocks_ >= blocks_->size())
        throw Refused{"a block that is none", mark.line + 1};  // the text is then read as it is
      value(mark, YamlNode::Kind::kScalar, {}).scalar = std::move((*blocks_)[n_blocks_++]);
    } else if (expects_key()) {
      stack_.back().key_seen = true;
      if (!stack_.back().known.insert(text).second)
        throw Refused{"the key '" + text + "' is there twice", mark.line + 1};
      stack_.back().node->keys.push_back(text);
    } else {
      value(mark, YamlNode::Kind::kScalar, text);
    }
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {
    open(mark, YamlNode::Kind::kSequence);
  }
  void OnSequenceEnd() override { stack_.pop_back(); }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t,
                  YAML::EmitterStyle::value) override {
    open(mark, YamlNode::Kind::kMap);
  }
  void OnMapEnd() override { stack_.pop_back(); }

 private:
  // Pointers into `items` stay good: an ancestor's vector does not grow while a child is open.
  struct Open {
    YamlNode* node;
    bool key_seen = false;
    std::unordered_set<std::string> known;
  };

  bool expects_key() const {
    return !stack_.empty() && stack_.back().node->kind == YamlNode::Kind::kMap && !stack_.back().key_seen;
  }

  YamlNode& value(const YAML::Mark& mark, YamlNode::Kind kind, const std::string& text) {
    if (expects_key()) throw Refused{"a key must be a word", mark.line + 1};
    if (++n_nodes_ > kMaxNodes) throw Refused{"more than two million values", mark.line + 1};
    YamlNode* node = &root_;
    if (!stack_.empty()) {
      stack_.back().key_seen = false;
      node = &stack_.back().node->items.emplace_back();
    }
    node->kind = kind;
    node->line = mark.line + 1;
    node->scalar = text;
    return *node;
  }

  void open(const YAML::Mark& mark, YamlNode::Kind kind) {
    if (static_cast<int>(stack_.size()) >= kMaxDepth) {
      throw Refused{fmt::format("nested deeper than {} levels", kMaxDepth), mark.line + 1};
    }
    stack_.push_back({&value(mark, kind, {}), false, {}});
  }

  YamlNode& root_;
  std::vector<std::string>* blocks_;
  std::size_t n_blocks_ = 0;
  std::vector<Open> stack_;
  std::size_t n_nodes_ = 0;
};

/// Reads from the caller's text without copying it.
class ViewBuffer : public std::streambuf {
 public:
  explicit ViewBuffer(std::string_view text) {
    char* begin = const_cast<char*>(text.data());  // only ever read
    setg(begin, begin, begin + text.size());
  }
};

/// Without OpenCV's directive, which YAML writes with a blank; the line itself stays, so that line numbers
/// are true.
std::string_view without_directive(std::string_view text) {
  if (text.substr(0, 3) == "\xEF\xBB\xBF") text.remove_prefix(3);
  if (text.substr(0, 6) != "%YAML:") return text;
  const auto end = text.find('\n');
  return end == std::string_view::npos ? std::string_view{} : text.substr(end);
}

Error parse_error(const std::string& message, int line) {
  return {ErrorCode::kParse, message, line > 0 ? fmt::format("line {}", line) : ""};
}

Result<std::unique_ptr<YamlNode>> parse_document(std::string_view text, std::vector<std::string>* blocks,
                                                 bool& used_all) {
  auto root = std::make_unique<YamlNode>();
  try {
    ViewBuffer buffer(text);
    std::istream stream(&buffer);
    YAML::Parser parser(stream);
    Builder builder(*root, blocks);
    if (!parser.HandleNextDocument(builder)) return parse_error("there is nothing in the file", 0);
    used_all = builder.used_all_blocks();
    YamlNode second;
    Builder rest(second);
    if (parser.HandleNextDocument(rest))
      return parse_error("a second document ('---') follows the first", second.line);
  } catch (const Refused& refused) {
    return parse_error(refused.message, refused.line);
  } catch (const YAML::Exception& failed) {
    return parse_error("not YAML: " + failed.msg, failed.mark.line + 1);
  }
  set_parents(*root);
  return root;
}

}  // namespace

void set_parents(YamlNode& node) {
  for (YamlNode& item : node.items) {
    item.parent = &node;
    set_parents(item);
  }
}

Result<std::unique_ptr<YamlNode>> parse_yaml(std::string_view text) {
  if (text.size() > kMaxBytes) return parse_error("more than 64 MiB of YAML", 0);
  if (trim(text).empty()) return parse_error("the file is empty", 0);
  if (const auto zero = text.find('\0'); zero != std::string_view::npos) {
    const auto line = std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(zero), '\n');
    return parse_error("this is not text (a zero byte)", static_cast<int>(line) + 1);
  }
  const std::string_view body = without_directive(text);
  // Numbers in blocks go around the parser where it agrees that they are blocks; all errors are those of the
  // text itself.
  if (auto lifted = lift_blocks(body)) {
    bool used_all = false;
    auto root = parse_document(lifted->text, &lifted->blocks, used_all);
    if (root && used_all) return root;
  }
  bool ignored = false;
  return parse_document(body, nullptr, ignored);
}

std::string Field::path() const {
  std::vector<std::string> steps;
  for (const YamlNode* n = node_; n->parent; n = n->parent) {
    const auto index = static_cast<std::size_t>(n - n->parent->items.data());
    const bool in_map = n->parent->kind == YamlNode::Kind::kMap;
    steps.push_back(in_map ? n->parent->keys[index] : fmt::format("[{}]", index));
  }
  std::string path;
  for (auto step = steps.rbegin(); step != steps.rend(); ++step) {
    if (!path.empty() && step->front() != '[') path += '.';
    path += *step;
  }
  return path;
}

void Field::fail(const std::string& message, ErrorCode code) const {
  const std::string at = path();
  throw FieldError({code, message, fmt::format("{}{}line {}", at, at.empty() ? "" : ", ", node_->line)});
}

std::optional<Field> Field::find(std::string_view key) const {
  if (!is_map()) fail(fmt::format("a map with '{}' is needed", key));
  for (std::size_t i = 0; i < node_->keys.size() && i < node_->items.size(); ++i) {
    if (node_->keys[i] == key && node_->items[i].kind != YamlNode::Kind::kNull) return Field(node_->items[i]);
  }
  return std::nullopt;
}

Field Field::at(std::string_view key) const {
  if (auto field = find(key)) return *field;
  fail(fmt::format("'{}' is missing", key));
}

std::vector<std::pair<std::string, Field>> Field::entries() const {
  if (!is_map()) fail("a map is needed");
  std::vector<std::pair<std::string, Field>> all;
  for (std::size_t i = 0; i < node_->items.size(); ++i)
    all.emplace_back(node_->keys[i], Field(node_->items[i]));
  return all;
}

std::vector<Field> Field::items() const {
  if (!is_sequence()) fail("a list is needed");
  return {node_->items.begin(), node_->items.end()};
}

std::string_view Field::scalar() const {
  if (node_->kind != YamlNode::Kind::kScalar) fail("one value is needed");
  return node_->scalar;
}

std::string Field::text() const { return std::string(scalar()); }

double Field::number() const {
  const std::string word = text();
  const auto value = parse_double(word);
  if (!value) fail(fmt::format("a finite number is needed, not '{}'", word.substr(0, 40)));
  return *value;
}

int Field::integer() const {
  const std::string word = text();
  const auto value = parse_int(word);
  if (!value) fail(fmt::format("a whole number is needed, not '{}'", word.substr(0, 40)));
  return *value;
}

int Field::integer(int low, int high) const {
  const int value = integer();
  if (value < low || value > high) fail(fmt::format("{} is not within {} to {}", value, low, high));
  return value;
}

bool Field::boolean() const {
  const std::string word = text();
  if (word == "true" || word == "True" || word == "TRUE" || word == "1") return true;
  if (word == "false" || word == "False" || word == "FALSE" || word == "0") return false;
  fail(fmt::format("true or false is needed, not '{}'", word.substr(0, 40)));
}

void Field::collect(std::vector<double>& out) const {
  if (!is_sequence()) {
    out.push_back(number());
    return;
  }
  for (const YamlNode& item : node_->items) Field(item).collect(out);
}

std::vector<double> Field::numbers(int n) const {
  if (!is_sequence()) fail("a list of numbers is needed");
  std::vector<double> out;
  collect(out);
  if (n >= 0 && static_cast<int>(out.size()) != n) {
    fail(fmt::format("{} numbers are needed, there are {}", n, out.size()));
  }
  return out;
}

void Field::only(std::initializer_list<std::string_view> known) const {
  for (const auto& [key, field] : entries()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string near = nearest_word(key, known);
    std::string all;
    for (std::string_view word : known) all += (all.empty() ? "" : ", ") + std::string(word);
    field.fail(near.empty() ? fmt::format("unknown key '{}'; known are: {}", key.substr(0, 40), all)
                            : fmt::format("unknown key '{}'; did you mean '{}'?", key.substr(0, 40), near));
  }
}

std::string nearest_word(std::string_view word, const std::vector<std::string_view>& known) {
  std::string best;
  std::size_t best_distance = word.size() / 2 + 1;  // more than half of it wrong: no likeness
  if (word.size() > 64) return best;
  for (std::string_view candidate : known) {
    std::vector<std::size_t> row(candidate.size() + 1);  // Levenshtein's distance, one row at a time
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 1; i <= word.size(); ++i) {
      std::size_t diagonal = std::exchange(row[0], i);
      for (std::size_t j = 1; j <= candidate.size(); ++j) {
        const std::size_t replaced = diagonal + (word[i - 1] != candidate[j - 1]);
        diagonal = std::exchange(row[j], std::min({row[j] + 1, row[j - 1] + 1, replaced}));
      }
    }
    if (row.back() < best_distance) {
      best_distance = row.back();
      best = candidate;
    }
  }
  return best;
}

std::string yaml_text(std::string_view text) {
  const auto plain = [](unsigned char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '/' || c == '.' || c == '-';
  };
  static constexpr std::string_view kReserved[] = {"true", "false", "null", "yes", "no",
                                                   "on",   "off",   "y",    "n"};
  std::string lower(text);
  for (char& c : lower) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  const bool starts_well = !text.empty() && text.front() != '-' && text.front() != '.' && text.front() != '/';
  const bool is_word = starts_well && std::all_of(text.begin(), text.end(), plain) &&
                       std::find(std::begin(kReserved), std::end(kReserved), lower) == std::end(kReserved);
  // A digit in front would make other readers see a number ("01", "0x1f", "1e5", "2024-01-02").
  if (is_word && !(text.front() >= '0' && text.front() <= '9')) return std::string(text);
  std::string quoted = "\"";
  for (const unsigned char c : text) {
    if (c == '"' || c == '\\') {
      quoted += '\\';
      quoted += static_cast<char>(c);
    } else if (c < 0x20 || c == 0x7f) {
      quoted += fmt::format("\\x{:02x}", c);
    } else {
      quoted += static_cast<char>(c);
    }
  }
  return quoted + '"';
}

std::string number_text(double value) { return format_double(value == 0 ? 0.0 : value); }

void append_number(std::string& out, double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value == 0 ? 0.0 : value).ptr;
  out.append(buffer, end);
}

std::string yaml_numbers(const double* values, std::size_t n) {
  std::string text = "[";
  for (std::size_t i = 0; i < n; ++i) {
    if (i > 0) text += ", ";
    text += number_text(values[i]);
  }
  return text + "]";
}

std::vector<double> row_major(const MatX& M) {
  std::vector<double> values;
  for (Eigen::Index r = 0; r < M.rows(); ++r)
    for (Eigen::Index c = 0; c < M.cols(); ++c) values.push_back(M(r, c));
  return values;
}

}  // namespace plumbline::io

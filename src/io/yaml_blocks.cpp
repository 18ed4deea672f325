// SPDX-License-Identifier: Apache-2.0
#include "io/yaml_blocks.hpp"

#include <algorithm>

namespace plumbline::io {
namespace {

// The line at the front of a text, with its line break; takes it off.
std::string_view take_line(std::string_view& text) {
  const auto end = text.find('\n');
  const std::string_view line = text.substr(0, end == std::string_view::npos ? end : end + 1);
  text.remove_prefix(line.size());
  return line;
}

std::string_view without_break(std::string_view line) {
  while (line.ends_with('\n') || line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::size_t indent_of(std::string_view line) { return std::min(line.find_first_not_of(' '), line.size()); }

// "  key: |", and nothing else.
bool opens_block(std::string_view line) {
  line = without_break(line);
  line.remove_prefix(indent_of(line));
  if (!line.ends_with(": |")) return false;
  line.remove_suffix(3);
  return !line.empty() &&
         std::all_of(line.begin(), line.end(), [](char c) { return (c >= 'a' && c <= 'z') || c == '_'; });
}

bool holds_numbers(std::string_view line) {
  return std::all_of(line.begin(), line.end(), [](char c) {
    return (c >= '0' && c <= '9') || c == ' ' || c == '.' || c == '-' || c == '+' || c == 'e' || c == '\t';
  });
}

// The block below a key at `indent`, taken off the text; nullopt when it is not one of numbers only, or one
// that a parser would refuse.
struct Block {
  std::string content;
  int n_lines = 0;
};
std::optional<Block> take_block(std::string_view& text, std::size_t indent) {
  Block block;
  std::size_t own_indent = 0, end_of_content = 0;
  int n_blank = 0;
  while (!text.empty()) {
    std::string_view rest = text;
    const std::string_view raw = take_line(rest), line = without_break(raw);
    if (raw.size() > line.size() + 1) return std::nullopt;  // carriage returns: the parser's affair
    const std::size_t at = indent_of(line);
    if (at == line.size()) {
      // Blanks that are content, or that would have to agree with the first row.
      if (own_indent > 0 ? at > own_indent : at > 0) return std::nullopt;
      block.content += '\n';
      ++n_blank;
    } else {
      if (at <= indent) break;
      if (own_indent == 0) own_indent = at;
      if (at < own_indent || !holds_numbers(line)) return std::nullopt;
      block.content += line.substr(own_indent);
      if (raw.size() > line.size()) block.content += '\n';
      end_of_content = block.content.size();
      n_blank = 0;
    }
    ++block.n_lines;
    text = rest;
  }
  block.content.resize(end_of_content);  // of blank lines at the end nothing stays
  if (own_indent == 0) return std::nullopt;
  return block;
}

}  // namespace

std::optional<LiftedBlocks> lift_blocks(std::string_view text) {
  if (text.find(kBlockTag) != std::string_view::npos || text.find(": |\n") == std::string_view::npos)
    return std::nullopt;
  LiftedBlocks out;
  while (!text.empty()) {
    const std::string_view line = take_line(text);
    std::string_view below = text;
    const auto block = opens_block(line) ? take_block(below, indent_of(line)) : std::nullopt;
    if (!block) {
      out.text += line;
      continue;
    }
    out.text += without_break(line).substr(0, without_break(line).size() - 1);
    out.text += kBlockTag;
    out.text += ' ' + std::to_string(out.blocks.size());
    out.text.append(static_cast<std::size_t>(block->n_lines) + 1, '\n');
    out.blocks.push_back(block->content);
    text = below;
  }
  if (out.blocks.empty()) return std::nullopt;
  return out;
}

}  // namespace plumbline::io

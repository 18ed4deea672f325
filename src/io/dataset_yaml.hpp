// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "io/yaml.hpp"
#include "plumbline/rig/dataset.hpp"

/// Pieces that corners.yaml and calibration.yaml share.
namespace plumbline::io {

/// Calls row(line number in the block, words of the line) for every line that is not blank. `words` is used
/// again for the next line, so that a block of many corners costs no allocation.
template <class Row>
void for_each_row(std::string_view block, Row&& row) {
  std::vector<std::string_view> words;
  for (int line = 1; !block.empty(); ++line) {
    const auto end = block.find('\n');
    std::string_view rest = block.substr(0, end);
    block = end == std::string_view::npos ? std::string_view{} : block.substr(end + 1);
    words.clear();
    for (;;) {
      const auto first = rest.find_first_not_of(" \t\r");
      if (first == std::string_view::npos) break;
      rest.remove_prefix(first);
      const auto last = rest.find_first_of(" \t\r");
      words.push_back(rest.substr(0, last));
      rest = last == std::string_view::npos ? std::string_view{} : rest.substr(last);
    }
    if (!words.empty()) row(line, words);
  }
}

/// The same for a field: a block of text, or a list of lists ([[0, 12.5, 7.25, 1], ...]), as people and
/// scripts write it.
template <class Row>
void for_each_row(const Field& field, Row&& row) {
  if (!field.is_sequence()) {
    for_each_row(field.scalar(), row);
    return;
  }
  int line = 0;
  for (const Field& item : field.items()) {
    std::vector<std::string_view> words;
    for (const Field& word : item.items()) words.push_back(word.scalar());
    row(++line, words);
  }
}

/// "point x y sigma" of a line; fails with the number of the line within the block.
Corner read_corner(const Field& block, int line, const std::vector<std::string_view>& words);
double read_word(const Field& block, int line, std::string_view word);
void write_corner(std::string& out, const Corner& corner);

/// "version: 1" under `key`; kUnsupported for a newer one.
void check_version(const Field& root, std::string_view key, int newest);

/// What a file says it holds. A file that was cut off at the end of a line would else pass for a smaller one,
/// and one cut within its last number for another. The key may be absent (files by hand); where it is there
/// it must be true, and the text must end with its last line.
struct Contents {
  int cameras = 0, frames = 0, views = 0, corners = 0;
};
Contents contents_of(const Dataset& data);
std::string contents_text(const Contents& contents);
void check_contents(const Field& root, const Contents& found, std::string_view whole_text);

/// One target under `target`, several as a list under `targets`; in views of several, `target` is a name.
std::vector<Target> read_targets(const Field& root);
void write_targets(std::string& out, const std::vector<Target>& targets);
int read_target_of_view(const Field& view, const std::vector<Target>& targets);

CameraInfo read_camera_info(const Field& field);
std::string camera_info_text(const CameraInfo& camera);

/// Position of a name in a list of names; fails when it is not there.
int index_of(const Field& name, const std::vector<std::string>& names, std::string_view what);

/// The names; fails where one is there twice.
std::vector<std::string> unique_names(const Field& list, const std::vector<std::string>& names);

}  // namespace plumbline::io

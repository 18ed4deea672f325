// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/glob.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "plumbline/core/text.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;

bool is_wildcard(char c) { return c == '*' || c == '?'; }
bool has_wildcard(std::string_view text) { return text.find_first_of("*?") != std::string_view::npos; }

// Matches one path component; on success `captures` has grown by one piece per run of wildcards. A run of
// wildcards takes at least as many characters as it has '?', and more only if it has a '*'; the shortest that
// fits is taken.
bool match_component(std::string_view pattern, std::string_view text, std::vector<std::string>& captures) {
  std::size_t literal = 0;
  while (literal < pattern.size() && !is_wildcard(pattern[literal])) ++literal;
  if (text.substr(0, literal) != pattern.substr(0, literal)) return false;
  pattern.remove_prefix(literal);
  text.remove_prefix(literal);
  if (pattern.empty()) return text.empty();
  std::size_t run = 0, at_least = 0;
  while (run < pattern.size() && is_wildcard(pattern[run])) at_least += pattern[run++] == '?';
  const bool any_more = pattern.substr(0, run).find('*') != std::string_view::npos;
  const std::size_t depth = captures.size();
  for (std::size_t n = at_least; n <= text.size() && (any_more || n == at_least); ++n) {
    captures.emplace_back(text.substr(0, n));
    if (match_component(pattern.substr(run), text.substr(n), captures)) return true;
    captures.resize(depth);
  }
  return false;
}

struct Found {
  fs::path file;
  std::vector<std::string> captures;
};

// All files below `folder` that match components[i...].
void walk(const fs::path& folder, const std::vector<std::string>& components, std::size_t i,
          const Found& so_far, std::vector<Found>& found) {
  const std::string& pattern = components[i];
  const bool last = i + 1 == components.size();
  const auto step = [&](const fs::path& entry, const std::vector<std::string>& captures) {
    std::error_code ignored;
    if (last && fs::is_regular_file(entry, ignored)) found.push_back({entry, captures});
    if (!last && fs::is_directory(entry, ignored)) walk(entry, components, i + 1, {entry, captures}, found);
  };
  if (!has_wildcard(pattern)) return step(folder / pattern, so_far.captures);
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? fs::path(".") : folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.front() == '.' && pattern.front() != '.') continue;
    std::vector<std::string> captures = so_far.captures;
    if (match_component(pattern, name, captures)) step(folder / name, captures);
  }
}

Error nothing_matched(std::string_view pattern, const fs::path& folder) {
  std::error_code error;
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? fs::path(".") : folder, error)) {
    names.push_back(entry.path().filename().string());
  }
  std::sort(names.begin(), names.end(), natural_less);
  std::string holds = fmt::format("the folder holds {} entries", names.size());
  if (error)
    holds = "there is no such folder";
  else if (!names.empty())
    holds += ", for example " + names.front();
  return {ErrorCode::kIo,
          fmt::format("no file matches '{}': {}; quote the pattern so that the shell leaves it alone",
                      pattern, holds),
          folder.empty() ? std::string(".") : folder.string()};
}

}  // namespace

Result<std::vector<GlobMatch>> glob_files(std::string_view pattern) {
  if (pattern.empty())
    return Error{ErrorCode::kIo, "an empty file pattern matches nothing; give a file or a pattern", ""};
  const bool absolute = pattern.front() == '/';
  std::vector<std::string> components;
  for (std::string& piece : split(pattern, '/')) {
    if (!piece.empty() && piece != ".") components.push_back(std::move(piece));
  }
  if (components.empty() && absolute)
    return Error{ErrorCode::kIo, "give a file, a folder or a pattern", std::string(pattern)};
  if (std::error_code ignored; !has_wildcard(pattern) && fs::is_directory(fs::path(pattern), ignored)) {
    auto matches = glob_files((fs::path(pattern) / "*").string());
    if (!matches) return matches;
    for (GlobMatch& match : *matches) match.key = match.file.stem().string();
    return matches;
  }
  std::size_t first_wild = 0;
  while (first_wild + 1 < components.size() && !has_wildcard(components[first_wild])) ++first_wild;
  const fs::path root = absolute ? "/" : "";
  fs::path fixed = root;
  for (std::size_t i = 0; i < first_wild; ++i) fixed /= components[i];

  std::vector<Found> found;
  walk(root, components, 0, {}, found);
  if (found.empty()) {
    if (has_wildcard(pattern)) return nothing_matched(pattern, fixed);
    return Error{ErrorCode::kIo, "no such file", std::string(pattern)};
  }
  std::vector<GlobMatch> matches;
  for (const Found& f : found) {
    const std::string name =
        fixed.empty() ? f.file.generic_string() : f.file.lexically_relative(fixed).generic_string();
    matches.push_back({f.file, name, f.captures.empty() ? f.file.stem().string() : join(f.captures, "/")});
  }
  std::sort(matches.begin(), matches.end(),
            [](const GlobMatch& a, const GlobMatch& b) { return natural_less(a.name, b.name); });
  return matches;
}

std::optional<std::string> glob_key(std::string_view pattern, std::string_view name) {
  const auto components_of = [](std::string_view path) {
    std::vector<std::string> components;
    for (std::string& piece : split(path, '/')) {
      if (!piece.empty() && piece != ".") components.push_back(std::move(piece));
    }
    return components;
  };
  const std::vector<std::string> wanted = components_of(pattern), given = components_of(name);
  if (wanted.empty() || given.size() < wanted.size()) return std::nullopt;
  std::vector<std::string> captures;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (!match_component(wanted[i], given[given.size() - wanted.size() + i], captures)) return std::nullopt;
  }
  return captures.empty() ? fs::path(given.back()).stem().string() : join(captures, "/");
}

}  // namespace plumbline

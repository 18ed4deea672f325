// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"
#include "geometry.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/lens/lens.hpp"

namespace plumbline::apps {
namespace {

// A table: its column heads and its rows, for people, for README and for scripts.
struct Table {
  std::vector<std::string> heads;
  std::vector<std::vector<std::string>> rows;
};

std::string lens_parameters(std::string_view name) {
  std::vector<std::string> names;
  const Lens lens = *make_lens(name, {}, 1.0);
  for (const std::string& p : param_names(lens)) {
    names.push_back(p);
    if (!is_sparse(lens) || names.size() < 8) continue;
    names.emplace_back("...");
    break;
  }
  return join(names, " ");
}

Table table_of(const std::string& what) {
  Table table;
  if (what == "lenses") {
    table.heads = {"lens", "parameters", "what it is"};
    for (std::string_view name : lens_names()) {
      table.rows.push_back(
          {std::string(name), lens_parameters(name), std::string(lens_summary(*make_lens(name, {}, 1.0)))});
    }
  } else if (what == "formats") {
    table.heads = {"format", "files", "lenses", "extrinsics", "what it is"};
    for (const Format* f : formats()) {
      table.rows.push_back({std::string(f->name), std::string(f->files), std::string(f->lenses),
                            f->carries_extrinsics ? "yes" : "no", std::string(f->summary)});
    }
  } else if (what == "targets") {
    table.heads = {"type", "what it is"};
    for (const TargetType& t : target_types())
      table.rows.push_back({std::string(t.type), std::string(t.summary)});
  } else if (what == "geometry") {
    table.heads = {"verb", "what it does"};
    for (const GeometryVerb& v : geometry_verbs())
      table.rows.push_back({std::string(v.name), std::string(v.summary)});
  } else {
    table.heads = {"command", "what it does"};
    for (const Command& c : commands()) table.rows.push_back({std::string(c.name), std::string(c.summary)});
  }
  return table;
}

std::string markdown(const Table& table) {
  std::string text = "| " + join(table.heads, " | ") + " |\n|";
  for (std::size_t i = 0; i < table.heads.size(); ++i) text += "---|";
  text += "\n";
  for (const auto& row : table.rows) text += "| " + join(row, " | ") + " |\n";
  return text;
}

std::string columns(const Table& table) {
  std::vector<std::size_t> widths(table.heads.size());
  for (const auto& row : table.rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  std::string text;
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      text += fmt::format("{:<{}}", row[i], i + 1 < row.size() ? widths[i] + 2 : 0);
    text += "\n";
  }
  return text;
}

Json json_of_table(const Table& table) {
  Json list = Json::array();
  for (const auto& row : table.rows) {
    Json item;
    for (std::size_t i = 0; i < row.size(); ++i) item[table.heads[i]] = row[i];
    list.push_back(item);
  }
  return list;
}

}  // namespace

void add_list(CLI::App& app, const Common& common, int& exit_code) {
  struct Options {
    std::string what;
    bool markdown = false;
  };
  auto o = std::make_shared<Options>();
  app.add_option("what", o->what, "lenses, formats, targets, commands or geometry (its verbs)")
      ->required()
      ->check(CLI::IsMember({"lenses", "formats", "targets", "commands", "geometry"}));
  app.add_flag("--markdown", o->markdown, "as a Markdown table");
  on_run(app, exit_code, [o, &common]() -> Result<int> {
    const Table table = table_of(o->what);
    Json json;
    json[o->what] = json_of_table(table);
    if (Status s = print_result(common, json, o->markdown ? markdown(table) : columns(table)); !s)
      return s.error();
    return kDone;
  });
}

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include "geometry_args.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>

#include "plumbline/core/text.hpp"
#include "plumbline/io/files.hpp"

namespace plumbline::apps {

void add_answer_option(CLI::App& app, std::string& output) {
  app.add_option("-o,--output", output, "a YAML file for the answer, which is printed in any case");
}

Status give_answer(const Json& answer, std::string text, const std::string& output, const Common& common) {
  if (!output.empty()) {
    if (Status s = write_file(output, yaml_of(answer), common.force); !s) return s;
    text += "written: " + output + "\n";
  }
  return print_result(common, answer, text);
}

namespace {

// A value on the line of its key.
std::string inline_yaml(const Json& json) {
  if (json.is_number_float()) return format_double(json.get<double>());
  if (!json.is_structured()) return json.dump();
  std::vector<std::string> pieces;
  for (const auto& [key, value] : json.items())
    pieces.push_back((json.is_object() ? key + ": " : std::string()) + inline_yaml(value));
  return (json.is_object() ? "{" : "[") + join(pieces, ", ") + (json.is_object() ? "}" : "]");
}

bool is_list_of_structures(const Json& json) {
  return json.is_array() && !json.empty() &&
         std::any_of(json.begin(), json.end(), [](const Json& item) { return item.is_structured(); });
}

}  // namespace

std::string yaml_of(const Json& json) {
  std::string text;
  for (const auto& [key, value] : json.items()) {
    if (is_list_of_structures(value)) {
      text += key + ":\n";
      for (const Json& item : value) text += "  - " + inline_yaml(item) + "\n";
    } else {
      text += key + ": " + inline_yaml(value) + "\n";
    }
  }
  return text;
}

std::vector<double> parse_numbers(const std::string& text, const std::vector<std::size_t>& counts,
                                  const std::string& option) {
  std::string plain = text;
  for (char& c : plain)
    if (c == ',' || c == ';' || c == '\t' || c == '\n') c = ' ';
  std::vector<double> numbers;
  for (const std::string& piece : split(plain, ' ')) {
    if (piece.empty()) continue;
    const auto number = parse_double(piece);
    if (!number) usage_error(fmt::format("{} {}: '{}' is not a finite number", option, text, piece));
    numbers.push_back(*number);
  }
  if (std::find(counts.begin(), counts.end(), numbers.size()) == counts.end()) {
    std::vector<std::string> wanted;
    for (std::size_t n : counts) wanted.push_back(std::to_string(n));
    usage_error(fmt::format("{} {}: {} numbers are needed, separated by commas; there are {}", option, text,
                            join(wanted, " or "), numbers.size()));
  }
  return numbers;
}

Json json_of_matrix(const MatX& M) {
  Json rows = Json::array();
  for (Eigen::Index r = 0; r < M.rows(); ++r) rows.push_back(json_of_vector(M.row(r)));
  return rows;
}

Json json_of_vector(const VecX& v) {
  Json numbers = Json::array();
  // Plus zero: a negative zero says nothing and makes answers differ that mean the same.
  for (Eigen::Index i = 0; i < v.size(); ++i) numbers.push_back(v[i] + 0.0);
  return numbers;
}

std::string text_of_matrix(const std::string& name, const MatX& M) {
  std::string text;
  for (Eigen::Index r = 0; r < M.rows(); ++r) {
    text += r == 0 ? name + " =" : std::string(name.size() + 2, ' ');
    for (Eigen::Index c = 0; c < M.cols(); ++c) text += fmt::format(" {:16.9g}", M(r, c) + 0.0);
    text += "\n";
  }
  return text;
}

std::string text_of_vector(const VecX& v) {
  std::vector<std::string> numbers;
  for (Eigen::Index i = 0; i < v.size(); ++i) numbers.push_back(fmt::format("{:.9g}", v[i] + 0.0));
  return "(" + join(numbers, ", ") + ")";
}

}  // namespace plumbline::apps

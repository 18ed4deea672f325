// SPDX-License-Identifier: Apache-2.0
#include "geometry_args.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "plumbline/core/text.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"

namespace plumbline::apps {
namespace fs = std::filesystem;

void add_points_option(CLI::App& app, std::string& points, const std::string& columns) {
  app.add_option("--points", points, "CSV or YAML with a header; columns " + columns)->required();
}

Error in_file(Error error, const std::string& file) {
  error.where = file + (error.where.empty() ? "" : ": " + error.where);
  return error;
}

Result<PointTable> load_points(const std::string& file) {
  auto text = read_file(file);
  if (!text) return text.error();
  auto table = parse_points(*text);
  if (!table) return in_file(table.error(), file);
  return table;
}

Result<Matches> matches_of(const PointTable& table) {
  auto px1 = points_2d(table, "u1", "v1");
  if (!px1) return px1.error();
  auto px2 = points_2d(table, "u2", "v2");
  if (!px2) return px2.error();
  return Matches{*std::move(px1), *std::move(px2)};
}

Result<Matches> load_matches(const std::string& file) {
  auto table = load_points(file);
  if (!table) return table.error();
  auto matches = matches_of(*table);
  if (!matches) return in_file(matches.error(), file);
  return matches;
}

void add_robust_options(CLI::App& app, RobustOptions& options, const std::string& error) {
  app.add_flag("--ransac", options.ransac, "leave out the rows that contradict most others");
  app.add_option("--inlier-px", options.inlier_px,
                 "with --ransac: an inlier's " + error + " is at most this (default: 2)")
      ->check(positive());
  app.add_option("--confidence", options.confidence,
                 "with --ransac: probability that a sample without outliers was drawn (default: 0.9999)")
      ->check(between(1e-6, 1 - 1e-12));
}

RansacOptions ransac_options(const RobustOptions& options, const Common& common) {
  RansacOptions out;
  out.inlier_px = options.inlier_px;
  out.confidence = options.confidence;
  out.seed = static_cast<std::uint64_t>(common.seed);
  out.n_threads = common.n_threads;
  return out;
}

void add_refinement_options(CLI::App& app, RefinementOptions& options) {
  app.add_option("--sigma", options.sigma_px,
                 "standard deviation of a pixel coordinate, for the covariance (default: from the residuals)")
      ->check(positive());
  app.add_flag("--linear", options.linear, "the closed form alone, without refinement");
}

double sigma_of_residuals(double sum_of_squares_px2, int n_equations, int n_parameters) {
  const int freedom = n_equations - n_parameters;
  return freedom > 0 ? std::sqrt(sum_of_squares_px2 / freedom) : 0.0;
}

CLI::Option* add_camera_option(CLI::App& app, std::vector<std::string>& cameras, const std::string& which) {
  return app
      .add_option("--camera", cameras,
                  which + "; a camera file of any known format, FILE:NAME for one camera of several")
      ->allow_extra_args(false);
}

namespace {

std::string names_of(const Rig& rig) {
  std::vector<std::string> names;
  for (const Camera& camera : rig.cameras) names.push_back(camera.name);
  return join(names, ", ");
}

// The cameras of one argument.
Result<Rig> load_argument(const std::string& argument) {
  const auto colon = argument.rfind(':');
  if (colon == std::string::npos || fs::exists(argument)) return load_rig({argument});
  const std::string file = argument.substr(0, colon), name = argument.substr(colon + 1);
  auto rig = load_rig({file});
  if (!rig) return rig;
  const auto at = rig->find(name);
  if (!at) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("there is no camera '{}'; there are {}", name, names_of(*rig)), file};
  }
  return Rig{{rig->cameras[*at]}, {rig->T_cam_rig[*at]}};
}

// The file of an argument FILE or FILE:NAME.
std::string file_of(const std::string& argument) {
  return fs::exists(argument) ? argument : argument.substr(0, argument.rfind(':'));
}

}  // namespace

Result<Rig> load_cameras(const std::vector<std::string>& arguments) {
  if (arguments.size() == 1) return load_argument(arguments.front());
  const bool whole =
      std::all_of(arguments.begin(), arguments.end(), [](const auto& a) { return fs::exists(a); });
  if (whole) {
    // Files that are one rig together, such as intrinsics.yml and extrinsics.yml.
    auto together = load_rig(arguments);
    if (together) return together;
  }
  Rig rig;
  const bool one_file = std::all_of(arguments.begin(), arguments.end(),
                                    [&](const auto& a) { return file_of(a) == file_of(arguments.front()); });
  for (const std::string& argument : arguments) {
    auto part = load_argument(argument);
    if (!part) return part;
    for (std::size_t i = 0; i < part->cameras.size(); ++i) {
      rig.cameras.push_back(part->cameras[i]);
      rig.T_cam_rig.push_back(one_file ? part->T_cam_rig[i] : SE3());
    }
  }
  return rig;
}

Result<Camera> load_camera(const std::vector<std::string>& arguments) {
  auto rig = load_cameras(arguments);
  if (!rig) return rig.error();
  if (rig->cameras.size() == 1) return rig->cameras.front();
  return Error{
      ErrorCode::kInvalidData,
      fmt::format("one camera is needed, and there are {}; choose with --camera FILE:NAME", names_of(*rig)),
      arguments.front()};
}

Result<std::array<Camera, 2>> load_camera_pair(const std::vector<std::string>& arguments) {
  auto rig = load_cameras(arguments);
  if (!rig) return rig.error();
  const auto& cameras = rig->cameras;
  if (cameras.size() == 1) return std::array{cameras[0], cameras[0]};
  if (cameras.size() == 2) return std::array{cameras[0], cameras[1]};
  return Error{ErrorCode::kInvalidData,
               fmt::format("one or two cameras are needed, and there are {}; choose with --camera FILE:NAME",
                           names_of(*rig)),
               arguments.front()};
}

Json json_of_unset(const std::vector<bool>& flags) {
  Json rows = Json::array();
  for (std::size_t i = 0; i < flags.size(); ++i)
    if (!flags[i]) rows.push_back(i);
  return rows;
}

void add_answer_option(CLI::App& app, std::string& output) {
  app.add_option("-o,--output", output, "a YAML file for the answer, which is printed in any case");
}

Status check_answer(const std::string& output, const Common& common) {
  return output.empty() ? Status() : check_output(output, common);
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

std::string text_of_vector(const VecX& v, int digits) {
  std::vector<std::string> numbers;
  for (Eigen::Index i = 0; i < v.size(); ++i) numbers.push_back(fmt::format("{:.{}g}", v[i] + 0.0, digits));
  return "(" + join(numbers, ", ") + ")";
}

}  // namespace plumbline::apps

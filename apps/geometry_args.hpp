// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <string>
#include <vector>

#include "args.hpp"
#include "plumbline/core/types.hpp"
#include "plumbline/io/points_io.hpp"
#include "plumbline/linear/ransac.hpp"

/// What the verbs of `plumbline geometry` share: their options, and the form of their answers.
namespace plumbline::apps {

/// --points: a CSV or YAML table (io/points_io.hpp); `columns` names those that the verb needs.
void add_points_option(CLI::App& app, std::string& points, const std::string& columns);
Result<PointTable> load_points(const std::string& file);

/// The columns u1 v1 u2 v2 as points of two views; failures of load_matches name the file.
struct Matches {
  std::vector<Vec2> px1, px2;
};
Result<Matches> matches_of(const PointTable& table);
Result<Matches> load_matches(const std::string& file);

/// The error with the file in front of where it happened.
Error in_file(Error error, const std::string& file);

/// --ransac --inlier-px --confidence, beside --seed and --threads that all commands have.
struct RobustOptions {
  bool ransac = false;
  double inlier_px = 2, confidence = 0.9999;
};
void add_robust_options(CLI::App& app, RobustOptions& options, const std::string& error);
RansacOptions ransac_options(const RobustOptions& options, const Common& common);

/// --sigma and --linear of the verbs that refine.
struct RefinementOptions {
  double sigma_px = 0;  ///< 0: from the residuals
  bool linear = false;
};
void add_refinement_options(CLI::App& app, RefinementOptions& options);

/// The sigma that the residuals speak of: sqrt(sum / degrees of freedom) of a refinement with sigma 1 [px];
/// 0 without a degree of freedom.
double sigma_of_residuals(double sum_of_squares_px2, int n_equations, int n_parameters);

/// --camera, once per camera or once for a file with all of them.
CLI::Option* add_camera_option(CLI::App& app, std::vector<std::string>& cameras, const std::string& which);

/// The cameras of --camera arguments: files in any readable format, together one rig where they are one, or
/// FILE:NAME for one camera of a file. Poses are kept where one rig gives them (poses_known of
/// io/formats.hpp), else every T_cam_rig is the identity.
Result<Rig> load_cameras(const std::vector<std::string>& arguments);

/// Exactly one camera; kInvalidData names those that there are.
Result<Camera> load_camera(const std::vector<std::string>& arguments);

/// Two cameras, or one that took both views.
Result<std::array<Camera, 2>> load_camera_pair(const std::vector<std::string>& arguments);

/// The items whose flag is set.
template <class T>
std::vector<T> chosen(const std::vector<T>& items, const std::vector<bool>& flags) {
  std::vector<T> out;
  for (std::size_t i = 0; i < items.size(); ++i)
    if (flags.at(i)) out.push_back(items[i]);
  return out;
}

/// The rows whose flag is not set, from 0, for the answer.
Json json_of_unset(const std::vector<bool>& flags);

/// Declares -o/--output: the YAML file of the answer, which is printed in any case.
void add_answer_option(CLI::App& app, std::string& output);

/// Fails before the work where -o is given and exists, as check_output.
Status check_answer(const std::string& output, const Common& common);

/// Writes the answer into `output` (unless that is empty) as YAML with the keys of the JSON, and prints it.
/// The work must be done: nothing is written before.
Status give_answer(const Json& answer, std::string text, const std::string& output, const Common& common);

/// Maps as `key: value` lines, numbers with 17 digits, lists of numbers as [a, b], matrices a row a line.
std::string yaml_of(const Json& json);

/// "1,2,3" or "1 2 3": finite numbers, whose count must be one of `counts`; else wrong usage that names
/// `option`.
std::vector<double> parse_numbers(const std::string& text, const std::vector<std::size_t>& counts,
                                  const std::string& option);

/// A matrix as a list of rows, a vector as a list.
Json json_of_matrix(const MatX& M);
Json json_of_vector(const VecX& v);

/// "  R = [ 1 0 0 ]" and its other rows below, for people.
std::string text_of_matrix(const std::string& name, const MatX& M);
/// "(1, 2, 3)" with so many digits.
std::string text_of_vector(const VecX& v, int digits = 9);

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "args.hpp"
#include "plumbline/core/types.hpp"

/// What the verbs of `plumbline geometry` share: their options, and the form of their answers.
namespace plumbline::apps {

/// Declares -o/--output: the YAML file of the answer, which is printed in any case.
void add_answer_option(CLI::App& app, std::string& output);

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
/// "(1, 2, 3)".
std::string text_of_vector(const VecX& v);

}  // namespace plumbline::apps

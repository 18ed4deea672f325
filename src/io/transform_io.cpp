// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/transform_io.hpp"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "io/yaml.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {

// 9, 12 or 16 numbers, row by row.
Result<SE3> from_numbers(const std::vector<double>& m) {
  if (m.size() != 9 && m.size() != 12 && m.size() != 16) {
    return Error{ErrorCode::kParse,
                 fmt::format("a transform has 9 (R), 12 (3x4) or 16 (4x4) numbers; there are {}", m.size()),
                 ""};
  }
  const std::size_t columns = m.size() == 9 ? 3 : 4;
  Mat3 R;
  Vec3 t = Vec3::Zero();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) R(r, c) = m[r * columns + c];
    if (columns == 4) t[r] = m[r * columns + 3];
  }
  if (m.size() == 16 && (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("the last row of a rigid 4x4 transform is 0 0 0 1, not {} {} {} {}", m[12],
                             m[13], m[14], m[15]),
                 ""};
  }
  return rigid_transform(R, t);
}

Vec3 vec3(const io::Field& field) {
  const auto v = field.numbers(3);
  return {v[0], v[1], v[2]};
}

Result<SE3> from_yaml(const io::Field& root) {
  if (root.is_sequence()) return io::value_or_throw(from_numbers(root.numbers()), root);
  std::optional<SE3> whole;
  std::optional<Mat3> R;
  const auto once = [&](const io::Field& field, const Mat3& value) {
    // An answer of ours has several of them that mean the same; two that differ are a contradiction.
    if (R && (*R - value).norm() > 1e-4) field.fail("this rotation contradicts another one of the file");
    if (!R) R = value;
  };
  if (const auto f = root.find("T")) {
    whole = io::value_or_throw(from_numbers(f->numbers()), *f);
    once(*f, whole->R());
  }
  if (const auto f = root.find("R")) {
    const auto m = f->numbers(9);
    Mat3 M;
    for (int i = 0; i < 9; ++i) M(i / 3, i % 3) = m[i];
    once(*f, io::value_or_throw(rigid_transform(M, Vec3::Zero()), *f).R());
  }
  if (const auto f = root.find("quaternion_wxyz")) {
    const auto q = f->numbers(4);
    once(*f, io::value_or_throw(rotation_of_quaternion({q[0], q[1], q[2], q[3]}), *f));
  }
  for (const char* key : {"rotation_rad", "rvec_rad"}) {
    if (const auto f = root.find(key)) once(*f, so3_exp(vec3(*f)));
  }
  auto t = root.find("t");
  if (!t) t = root.find("translation_m");
  if (whole && t && (vec3(*t) - whole->t()).norm() > 1e-4 * (1 + whole->t().norm()))
    t->fail("this translation contradicts T of the file");
  if (whole) return *whole;
  if (!R && !t) {
    root.fail(
        "no transform: neither T nor a rotation (R, quaternion_wxyz, rotation_rad, rvec_rad) nor a "
        "translation (t, translation_m)");
  }
  return SE3(R.value_or(Mat3::Identity()), t ? vec3(*t) : Vec3::Zero());
}

}  // namespace

Result<SE3> rigid_transform(const Mat3& R, const Vec3& t_m) {
  const double off = (R.transpose() * R - Mat3::Identity()).norm();
  if (!(off < 1e-5) || R.determinant() < 0) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("not a rotation: |R'R - I| = {:.3g} (below 1e-5 is needed: give more digits), "
                             "det R = {:.6g} (+1 is needed)",
                             off, R.determinant()),
                 ""};
  }
  return SE3(R, t_m);
}

Result<Mat3> rotation_of_quaternion(const Vec4& wxyz) {
  if (!(std::abs(wxyz.norm() - 1) < 1e-4)) {
    return Error{ErrorCode::kInvalidData,
                 fmt::format("a quaternion of a rotation has length 1, not {:.6g}", wxyz.norm()), ""};
  }
  const Vec4 q = wxyz.normalized();
  return Mat3(Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix());
}

Result<SE3> parse_transform(std::string_view text) {
  // Bare numbers first: a file that numpy or a spreadsheet wrote.
  std::string plain(text.substr(0, 10000));
  for (char& c : plain)
    if (c == ',' || c == ';' || c == '\t' || c == '\n' || c == '\r') c = ' ';
  std::vector<double> numbers;
  bool bare = text.size() < 10000;
  for (const std::string& word : split(plain, ' ')) {
    if (word.empty() || !bare) continue;
    const auto number = parse_double(word);
    if (number)
      numbers.push_back(*number);
    else
      bare = false;
  }
  if (bare && !numbers.empty()) return from_numbers(numbers);
  return io::read_yaml<SE3>(text, "", from_yaml);
}

}  // namespace plumbline

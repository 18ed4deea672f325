// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <map>
#include <numbers>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "plumbline/geometry/rotation.hpp"
#include "plumbline/geometry/se3.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/transform_io.hpp"

namespace plumbline::apps {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;

struct Options {
  // By option, in the order of the command line; the chain is put together in run().
  std::vector<std::string> files, matrix, quaternion, rvec_rad, rvec_deg, axis_rad, axis_deg, euler_rad,
      euler_deg, t_m;
  int inverse = 0;
  std::string points, output, order = "ZYX";
};

// A link of the chain while it is put together.
struct Link {
  SE3 T;
  bool may_take_t = false;  // a rotation was given, and no translation yet
};

// What is wrong with the numbers of an option names the option.
template <class T>
Result<T> of_option(Result<T> result, const std::string& option) {
  if (!result) return in_file(result.error(), option);
  return result;
}

Result<SE3> from_file(const std::string& file) {
  auto text = read_file(file);
  if (!text) return text.error();
  return of_option(parse_transform(*text), file);
}

Result<SE3> from_matrix(const std::string& text) {
  parse_numbers(text, {9, 12, 16}, "--matrix");
  return of_option(parse_transform(text), "--matrix");
}

Result<SE3> from_quaternion(const std::string& text) {
  const auto q = parse_numbers(text, {4}, "--quaternion-wxyz");
  auto R = of_option(rotation_of_quaternion({q[0], q[1], q[2], q[3]}), "--quaternion-wxyz");
  if (!R) return R.error();
  return SE3(*R, Vec3::Zero());
}

EulerOrder order_of(const std::string& text, const std::string& option) {
  const auto order = parse_euler_order(text);
  if (!order) usage_error(option + " " + order.error().text());
  return *order;
}

Result<SE3> from_rvec(const std::string& text, double unit_rad, const std::string& option) {
  const auto w = parse_numbers(text, {3}, option);
  return SE3(so3_exp(unit_rad * Vec3(w[0], w[1], w[2])), Vec3::Zero());
}

Result<SE3> from_axis(const std::string& text, double unit_rad, const std::string& option) {
  const auto a = parse_numbers(text, {4}, option);
  const Vec3 axis(a[0], a[1], a[2]);
  if (!(axis.norm() > 0)) usage_error(fmt::format("{} {}: the axis has no length", option, text));
  return SE3(so3_exp(unit_rad * a[3] * axis.normalized()), Vec3::Zero());
}

// "YXZ:10,20,30".
Result<SE3> from_euler(const std::string& text, double unit_rad, const std::string& option) {
  const auto colon = text.find(':');
  if (colon == std::string::npos)
    usage_error(fmt::format("{} {}: ORDER:a,b,c is needed, for example YXZ:10,20,30", option, text));
  const auto a = parse_numbers(text.substr(colon + 1), {3}, option);
  return SE3(rotation_from_euler(order_of(text.substr(0, colon), option), unit_rad * Vec3(a[0], a[1], a[2])),
             Vec3::Zero());
}

// The chain in the order of the command line: T = T_1 T_2 ..., as in T_a_c = T_a_b T_b_c.
Result<SE3> chain(const CLI::App& app, const Options& o) {
  std::vector<Link> links;
  std::map<std::string, std::size_t> taken;
  for (const CLI::Option* option : app.parse_order()) {
    const std::string name = option->get_name();
    const auto next = [&](const std::vector<std::string>& values) { return values.at(taken[name]++); };
    Result<SE3> T = SE3();
    if (name == "file") {
      T = from_file(next(o.files));
    } else if (name == "--matrix") {
      T = from_matrix(next(o.matrix));
    } else if (name == "--quaternion-wxyz") {
      T = from_quaternion(next(o.quaternion));
    } else if (name == "--rvec-rad") {
      T = from_rvec(next(o.rvec_rad), 1, name);
    } else if (name == "--rvec-deg") {
      T = from_rvec(next(o.rvec_deg), kRadPerDeg, name);
    } else if (name == "--axis-angle-rad") {
      T = from_axis(next(o.axis_rad), 1, name);
    } else if (name == "--axis-angle-deg") {
      T = from_axis(next(o.axis_deg), kRadPerDeg, name);
    } else if (name == "--euler-rad") {
      T = from_euler(next(o.euler_rad), 1, name);
    } else if (name == "--euler-deg") {
      T = from_euler(next(o.euler_deg), kRadPerDeg, name);
    } else if (name == "--t") {
      const auto t = parse_numbers(next(o.t_m), {3}, name);
      const bool completes = !links.empty() && links.back().may_take_t;
      const SE3 moved(completes ? links.back().T.R() : Mat3::Identity(), Vec3(t[0], t[1], t[2]));
      if (completes) links.pop_back();
      links.push_back({moved, false});
      continue;
    } else if (name == "--inverse") {
      if (links.empty()) usage_error("--inverse: it inverts the transform before it, and there is none");
      links.back() = {links.back().T.inverse(), false};
      continue;
    } else {
      continue;
    }
    if (!T) return T.error();
    links.push_back({*T, name != "file" && name != "--matrix"});
  }
  if (links.empty()) usage_error("give at least one transform, for example --rvec-deg 0,0,90 --t 0,0,1");
  SE3 product;
  for (const Link& link : links) product = product * link.T;
  return product;
}

Result<int> run(const CLI::App& app, const Options& o, const Common& common) {
  const EulerOrder order = order_of(o.order, "--euler-order");
  auto T = chain(app, o);
  if (!T) return T.error();
  if (Status s = check_answer(o.output, common); !s) return s.error();
  std::vector<Vec3> moved;
  if (!o.points.empty()) {
    auto table = load_points(o.points);
    if (!table) return table.error();
    auto points = points_3d(*table, "X", "Y", "Z");
    if (!points) return in_file(points.error(), o.points);
    for (const Vec3& p : *points) moved.push_back(*T * p);
  }
  const Mat3 R = T->R();
  const Vec3 w = so3_log(R);
  const Vec4 q = quaternion_from_rotation(R);
  const EulerAngles euler = euler_from_rotation(order, R);
  Json json{{"T", json_of_matrix(T->matrix())},
            {"R", json_of_matrix(R)},
            {"t", json_of_vector(T->t())},
            {"C", json_of_vector(T->centre())},
            {"quaternion_wxyz", json_of_vector(q)},
            {"rvec_rad", json_of_vector(w)},
            {"angle_deg", w.norm() / kRadPerDeg},
            {"euler_order", to_string(order)},
            {"euler_deg", json_of_vector(euler.angles_rad / kRadPerDeg)},
            {"gimbal_lock", euler.gimbal_lock}};
  std::string text = text_of_matrix("T", T->matrix34());
  text += fmt::format("C = {}\nquaternion wxyz {}\nrotation vector {} deg, {:.9g} deg in all\n",
                      text_of_vector(T->centre()), text_of_vector(q), text_of_vector(w / kRadPerDeg),
                      w.norm() / kRadPerDeg);
  text += fmt::format(
      "Euler angles {} {} deg{}\n", to_string(order), text_of_vector(euler.angles_rad / kRadPerDeg),
      euler.gimbal_lock ? ", at gimbal lock: only two of them are determined, the third is set to 0" : "");
  for (const Vec3& p : moved) {
    json["points"].push_back(json_of_vector(p));
    text += text_of_vector(p) + "\n";
  }
  if (Status s = give_answer(json, text, o.output, common); !s) return s.error();
  return kDone;
}

void add_list_option(CLI::App& app, const std::string& name, std::vector<std::string>& values,
                     const std::string& help) {
  app.add_option(name, values, help)->allow_extra_args(false);
}

}  // namespace

void add_geometry_transform(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("file", o->files, "files with a transform, of any verb's answer or of 9, 12 or 16 numbers");
  add_list_option(app, "--matrix", o->matrix, "a transform as 9 (R), 12 (3x4) or 16 numbers, row by row");
  add_list_option(app, "--quaternion-wxyz", o->quaternion, "a rotation as a unit quaternion w,x,y,z");
  add_list_option(app, "--rvec-rad", o->rvec_rad, "a rotation vector x,y,z in radians");
  add_list_option(app, "--rvec-deg", o->rvec_deg, "a rotation vector x,y,z in degrees");
  add_list_option(app, "--axis-angle-rad", o->axis_rad, "a rotation as axis and angle x,y,z,a in radians");
  add_list_option(app, "--axis-angle-deg", o->axis_deg, "a rotation as axis and angle x,y,z,a in degrees");
  add_list_option(
      app, "--euler-rad", o->euler_rad,
      "a rotation R = R_a R_b R_c by Euler angles as ORDER:a,b,c in radians, for example YXZ:0.1,0,0.2");
  add_list_option(app, "--euler-deg", o->euler_deg, "the same in degrees");
  app.add_option("--euler-order", o->order, "order of the Euler angles that are printed (default: ZYX)");
  add_list_option(app, "--t", o->t_m,
                  "translation x,y,z of the rotation before it; without one, a transform of its own");
  app.add_flag("--inverse", o->inverse, "inverts the transform before it");
  app.add_option("--points", o->points, "points to move; CSV or YAML with a header; columns X,Y,Z");
  add_answer_option(app, o->output);
  app.footer(
      "Transforms multiply in the order in which they are given: T = T_1 T_2 ..., as in T_a_c = T_a_b "
      "T_b_c.");
  on_run(app, exit_code, [o, &app, &common] { return run(app, *o, common); });
}

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include "io/rig_yaml.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numbers>

#include "io/dataset_yaml.hpp"
#include "io/target_yaml.hpp"
#include "plumbline/core/check.hpp"

namespace plumbline::io {

namespace {
Validity read_validity(const Field& field) {
  field.only({"angle_rad", "radius_px"});
  const Field angle = field.at("angle_rad"), radius = field.at("radius_px");
  const Validity validity{angle.number(), radius.number()};
  if (!(validity.angle_rad > 0 && validity.angle_rad <= std::numbers::pi))
    angle.fail(fmt::format("{} is not an angle from the axis within 0 to pi", validity.angle_rad));
  if (!(validity.radius_px >= 0)) radius.fail(fmt::format("a radius of {} px", validity.radius_px));
  return validity;
}
}  // namespace

Camera read_camera(const Field& field) {
  field.only({"name", "width", "height", "lens", "parameters", "validity"});
  const Field parameters = field.at("parameters");
  const std::string lens = field.at("lens").text();
  const ImageSize size{field.at("width").integer(1, 1'000'000), field.at("height").integer(1, 1'000'000)};
  const Lens names = value_or_throw(make_lens(lens, size, 1.0), field.at("lens"));
  std::vector<double> values;
  const auto known = param_names(names);
  for (const std::string& name : known) values.push_back(parameters.at(name).number());
  for (const auto& [key, value] : parameters.entries()) {
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      value.fail(fmt::format("lens {} has no parameter '{}'", lens, key.substr(0, 40)));
    }
  }
  Camera camera{field.at("name").text(), size, value_or_throw(make_lens(lens, values), parameters)};
  if (const auto validity = field.find("validity")) camera.validity = read_validity(*validity);
  return camera;
}

Rig read_rig_fields(const Field& root) {
  Rig rig;
  std::vector<std::string> names;
  for (const Field& camera : root.at("cameras").items()) {
    rig.cameras.push_back(read_camera(camera));
    names.push_back(rig.cameras.back().name);
  }
  if (names.empty()) root.at("cameras").fail("there is no camera");
  unique_names(root.at("cameras"), names);
  const Field poses = root.at("T_cam_rig");
  for (const auto& [name, pose] : poses.entries()) {
    const std::size_t i = rig.T_cam_rig.size();
    if (i >= names.size() || name != names[i])
      poses.fail("one pose for each camera is needed, in the order of the cameras");
    rig.T_cam_rig.push_back(read_pose(pose));
  }
  if (rig.T_cam_rig.size() != names.size())
    poses.fail("one pose for each camera is needed, in the order of the cameras");
  return rig;
}

void write_rig_fields(std::string& out, const Rig& rig) {
  PLUMBLINE_CHECK(rig.T_cam_rig.size() == rig.cameras.size(), "a rig needs one pose per camera");
  out += "cameras:\n";
  for (const Camera& camera : rig.cameras) {
    out += fmt::format("  - name: {}\n    width: {}\n    height: {}\n    lens: {}\n    parameters:\n",
                       yaml_text(camera.name), camera.size.width, camera.size.height,
                       yaml_text(lens_spec(camera.lens)));
    const auto names = param_names(camera.lens);
    const auto values = params(camera.lens);
    for (std::size_t i = 0; i < names.size(); ++i)
      out += fmt::format("      {}: {}\n", names[i], number_text(values[i]));
    if (camera.validity) {
      out += fmt::format("    validity:\n      angle_rad: {}\n      radius_px: {}\n",
                         number_text(camera.validity->angle_rad), number_text(camera.validity->radius_px));
    }
  }
  out += "T_cam_rig:\n";
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    out += fmt::format("  {}: {}\n", yaml_text(rig.cameras[i].name), pose_text(rig.T_cam_rig[i]));
  }
}

}  // namespace plumbline::io

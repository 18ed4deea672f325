// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <map>
#include <utility>

#include "io/formats/common.hpp"
#include "io/formats/mrcal_region.hpp"
#include "io/formats/python_literal.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"

/// mrcal's .cameramodel: a Python dict literal, one file per camera. Releases up to 2.4 need the key
/// `extrinsics`, later ones call it `rt_cam_ref`; the value is the same (rotation vector and translation,
/// reference to camera), so both are written. mrcal has no Kannala-Brandt lens.
namespace plumbline::io {
namespace {

constexpr std::string_view kSplined = "LENSMODEL_SPLINED_STEREOGRAPHIC_";

std::optional<std::string> lensmodel_of(const Lens& lens) {
  const std::string_view name = lens_name(lens);
  if (const auto* splined = std::get_if<Splined>(&lens)) {
    return fmt::format("{}order={}_Nx={}_Ny={}_fov_x_deg={}", kSplined, splined->order, splined->n_x,
                       splined->n_y, splined->fov_x_deg);
  }
  if (name == "pinhole") return "LENSMODEL_PINHOLE";
  if (name == "opencv4") return "LENSMODEL_OPENCV4";
  if (name == "opencv5") return "LENSMODEL_OPENCV5";
  if (name == "opencv8") return "LENSMODEL_OPENCV8";
  if (name == "opencv12") return "LENSMODEL_OPENCV12";
  return std::nullopt;
}

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions&) {
  std::vector<NamedBytes> files;
  const auto stems = file_stems(rig);
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const Camera& camera = rig.cameras[i];
    const auto lensmodel = lensmodel_of(camera.lens);
    if (!lensmodel) return unsupported_lens(kMrcalFormat, camera);
    const Vec3 r = so3_log(rig.T_cam_rig[i].R()), t = rig.T_cam_rig[i].t();
    const std::string rt = yaml_numbers(std::vector<double>{r.x(), r.y(), r.z(), t.x(), t.y(), t.z()});
    std::string out = "# Written by Plumbline. rt_cam_ref is extrinsics by its newer name.\n{\n";
    out += fmt::format("    'lensmodel':  '{}',\n", *lensmodel);
    out += fmt::format("    # fx, fy, cx, cy, distortion\n    'intrinsics': {},\n",
                       yaml_numbers(params(camera.lens)));
    out += fmt::format(
        "    # rotation vector [rad] and translation [m], rig to camera\n    'extrinsics': {},\n    "
        "'rt_cam_ref': {},\n",
        rt, rt);
    out += fmt::format("    'imagersize': [{}, {}],\n", camera.size.width, camera.size.height);
    if (const auto region = region_text(camera)) {
      out +=
          "    # contour in the image inside which the calibration holds [px]\n    "
          "'valid_intrinsics_region': " +
          *region + ",\n";
    }
    out += "}\n";
    files.push_back({stems[i] + ".cameramodel", out});
  }
  if (Status known = check_poses(kMrcalFormat, rig); !known) return known.error();
  return files;
}

/// "splined:30x20:170" of "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170", in any order.
std::string splined_spec(const Field& field, const std::string& model) {
  std::map<std::string, std::string> options;
  std::string key;
  for (const std::string& piece : split(std::string_view(model).substr(kSplined.size()), '_')) {
    key += key.empty() ? "" : "_";  // fov_x_deg has the separator in its name
    const std::size_t equals = piece.find('=');
    key += piece.substr(0, equals);
    if (equals == std::string::npos) continue;
    options[std::exchange(key, "")] = piece.substr(equals + 1);
  }
  const auto at = [&](const char* name) {
    const auto it = options.find(name);
    if (it == options.end()) field.fail(fmt::format("'{}' has no {}=", model.substr(0, 100), name));
    return it->second;
  };
  return fmt::format("splined:{}x{}:{}:{}", at("Nx"), at("Ny"), at("fov_x_deg"), at("order"));
}

/// A camera and its pose against mrcal's reference.
struct Model {
  Camera camera;
  SE3 T_cam_ref;
};

Lens read_lens(const Field& root) {
  const auto old = root.find("distortion_model"),
             older = root.find("lens_model");  // names of earlier releases
  const Field field = old ? *old : older ? *older : root.at("lensmodel");
  std::string model = field.text();
  if (model.substr(0, 10) == "DISTORTION")
    model = model == "DISTORTION_NONE" ? "LENSMODEL_PINHOLE" : "LENSMODEL" + model.substr(10);
  const Field intrinsics = root.at("intrinsics");
  const std::vector<double> values = intrinsics.numbers();
  if (model.starts_with(kSplined)) {
    const std::string spec = splined_spec(field, model);
    value_or_throw(make_lens(spec, ImageSize{1, 1}, 1.0), field);
    return value_or_throw(make_lens(spec, values), intrinsics);
  }
  for (std::string_view name : lens_names()) {
    const Lens lens = value_or_throw(make_lens(name, ImageSize{1, 1}, 1.0), field);
    if (lensmodel_of(lens) == model) return value_or_throw(make_lens(name, values), intrinsics);
  }
  field.fail(
      fmt::format(
          "lens model '{}' is not among our lenses (LENSMODEL_PINHOLE, LENSMODEL_OPENCV4, 5, "
          "8, 12, LENSMODEL_SPLINED_STEREOGRAPHIC_...); mrcal-convert-lensmodel can fit one of those to it",
          model.substr(0, 60)),
      ErrorCode::kUnsupported);
}

Result<Model> read_model(const Field& root, const std::string& file) {
  if (!root.is_map()) root.fail("not a cameramodel: a dict is needed");
  const Lens lens = read_lens(root);
  const auto newer = root.find("rt_cam_ref");
  const Field pose = newer ? *newer : root.at("extrinsics");
  const std::vector<double> rt = pose.numbers(6);
  const Vec3 r(rt[0], rt[1], rt[2]);
  if (!(r.norm() < 1000)) pose.fail(fmt::format("a rotation by {} rad", r.norm()));
  const std::vector<Field> size = root.at("imagersize").items();
  if (size.size() != 2) root.at("imagersize").fail("[width, height] is needed");
  Camera camera{stem_of(file), size_of(size[0], size[1]), lens};
  if (const auto region = root.find("valid_intrinsics_region"))
    camera.validity = read_region(*region, camera);
  return Model{std::move(camera), r.isZero(0) ? SE3(Mat3::Identity(), {rt[3], rt[4], rt[5]})
                                              : SE3(so3_exp(r), {rt[3], rt[4], rt[5]})};
}

Result<Rig> read(std::span<const NamedBytes> files) {
  Rig rig;
  for (const NamedBytes& file : files) {
    auto model = read_tree<Model>(parse_python_literal(file.bytes), file.name,
                                  [&](const Field& root) { return read_model(root, file.name); });
    if (!model) return model.error();
    rig.cameras.push_back(std::move(model->camera));
    rig.T_cam_rig.push_back(model->T_cam_ref);
  }
  make_first_the_rig(rig);
  return rig;
}

bool recognises(std::string_view bytes) {
  return bytes.find("LENSMODEL_") != std::string_view::npos ||
         bytes.find("'DISTORTION_") != std::string_view::npos;
}

}  // namespace

const Format kMrcalFormat{"mrcal",
                          "mrcal camera models",
                          "CAMERA.cameramodel for each camera",
                          "pinhole opencv4 opencv5 opencv8 opencv12 splined",
                          true,
                          write,
                          read,
                          recognises,
                          true};

}  // namespace plumbline::io

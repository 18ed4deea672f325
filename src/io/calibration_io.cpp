// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/calibration_io.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "io/dataset_yaml.hpp"
#include "io/effects_yaml.hpp"
#include "io/rig_yaml.hpp"
#include "io/target_yaml.hpp"
#include "plumbline/core/check.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/rig/effects.hpp"

namespace plumbline {
namespace io {
namespace {

constexpr int kCalibrationVersion = 1;
using Names = std::vector<std::string>;

template <class... Args>
void append(std::string& out, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(out), format, std::forward<Args>(args)...);
}

std::string yes_no(bool value) { return value ? "true" : "false"; }

// --- summary and provenance ---

void write_summary(std::string& out, const SolveStats& stats) {
  append(out,
         "summary:\n  rms_px: {}\n  rms_xy_px: {}\n  corners: {}\n  outliers: {}\n  iterations: {}\n  "
         "converged: {}\n",
         number_text(stats.rms_px), number_text(stats.rms_xy_px), stats.n_corners, stats.n_outliers,
         stats.iterations, yes_no(stats.converged));
  append(out, "  termination: {}\n", yaml_text(stats.termination));
  if (!stats.weak.empty()) out += "  weak:\n";
  for (const WeakDirection& weak : stats.weak) {
    append(out, "    - parameters: {}\n      sigma: {}\n      consequence: {}\n", yaml_text(weak.parameters),
           number_text(weak.sigma), yaml_text(weak.consequence));
  }
  if (!stats.priors.empty()) out += "  priors:\n";
  for (const PriorPull& prior : stats.priors) {
    append(out, "    - parameter: {}\n      value: {}\n      sigma: {}\n      pull_sigmas: {}\n",
           yaml_text(prior.parameter), number_text(prior.value), number_text(prior.sigma),
           number_text(prior.pull_sigmas));
  }
  write_effect_tries(out, stats.effects);
}

SolveStats read_summary(const Field& field) {
  field.only({"rms_px", "rms_xy_px", "corners", "outliers", "iterations", "converged", "termination", "weak",
              "priors", "effects"});
  SolveStats stats;
  stats.rms_px = field.at("rms_px").number();
  stats.rms_xy_px = field.at("rms_xy_px").number();
  stats.n_corners = field.at("corners").integer();
  stats.n_outliers = field.at("outliers").integer();
  stats.iterations = field.at("iterations").integer();
  stats.converged = field.at("converged").boolean();
  if (const auto termination = field.find("termination")) stats.termination = termination->text();
  if (const auto weak = field.find("weak")) {
    for (const Field& item : weak->items()) {
      item.only({"parameters", "sigma", "consequence"});
      stats.weak.push_back(
          {item.at("parameters").text(), item.at("sigma").number(), item.at("consequence").text()});
    }
  }
  stats.effects = read_effect_tries(field);
  if (const auto priors = field.find("priors")) {
    for (const Field& item : priors->items()) {
      item.only({"parameter", "value", "sigma", "pull_sigmas"});
      stats.priors.push_back({item.at("parameter").text(), item.at("value").number(),
                              item.at("sigma").number(), item.at("pull_sigmas").number()});
    }
  }
  return stats;
}

void write_provenance(std::string& out, const Provenance& provenance) {
  append(out, "provenance:\n  version: {}\n  corners_hash: {}\n", yaml_text(provenance.version),
         yaml_text(provenance.corners_hash));
  if (!provenance.options.empty()) out += "  options:\n";
  for (const auto& [key, value] : provenance.options)
    append(out, "    {}: {}\n", yaml_text(key), yaml_text(value));
  if (!provenance.lens_tries.empty()) out += "  lens_tries:\n";
  for (const LensTry& t : provenance.lens_tries) {
    append(out, "    - {{camera: {}, lens: {}, parameters: {}, rms_px: {}, held_out_px: {}, excess: {}, ",
           yaml_text(t.camera), yaml_text(t.lens), t.n_params, number_text(t.rms_px),
           number_text(t.held_out_px), number_text(t.excess));
    append(out, "excess_sigma: {}, chosen: {}, reason: {}}}\n", number_text(t.excess_sigma), yes_no(t.chosen),
           yaml_text(t.reason));
  }
}

LensTry read_try(const Field& field) {
  field.only({"camera", "lens", "parameters", "rms_px", "held_out_px", "excess", "excess_sigma", "chosen",
              "reason"});
  return {
      field.at("camera").text(),         field.at("lens").text(),          field.at("parameters").integer(),
      field.at("rms_px").number(),       field.at("held_out_px").number(), field.at("excess").number(),
      field.at("excess_sigma").number(), field.at("chosen").boolean(),     field.at("reason").text()};
}

Provenance read_provenance(const Field& field) {
  field.only({"version", "corners_hash", "options", "lens_tries"});
  Provenance provenance;
  if (const auto version = field.find("version")) provenance.version = version->text();
  if (const auto hash = field.find("corners_hash")) provenance.corners_hash = hash->text();
  if (const auto options = field.find("options")) {
    for (const auto& [key, value] : options->entries()) provenance.options[key] = value.text();
  }
  if (const auto tries = field.find("lens_tries")) {
    for (const Field& t : tries->items()) provenance.lens_tries.push_back(read_try(t));
  }
  return provenance;
}

// --- data: target, frames with poses, views with residuals ---

void write_view(std::string& out, const Calibration& calibration, std::size_t v) {
  const View& view = calibration.data.views[v];
  append(out, "  - camera: {}\n    frame: {}\n    image: {}\n",
         yaml_text(calibration.data.cameras.at(view.cam).name),
         yaml_text(calibration.data.frames.at(view.frame)), yaml_text(view.image));
  if (calibration.data.targets.size() > 1)
    append(out, "    target: {}\n", yaml_text(calibration.data.targets.at(view.target).name));
  if (!view.reason.empty()) append(out, "    reason: {}\n", yaml_text(view.reason));
  if (view.time_s) append(out, "    time_s: {}\n", number_text(*view.time_s));
  if (v < calibration.view_reason.size() && !calibration.view_reason[v].empty()) {
    append(out, "    unused: {}\n", yaml_text(calibration.view_reason[v]));
  }
  if (view.corners.empty()) return;
  const bool fitted = v < calibration.fits.size() && !calibration.fits[v].empty();
  PLUMBLINE_CHECK(!fitted || calibration.fits[v].size() == view.corners.size(),
                  "a view needs one fit per corner");
  out += "    corners: |\n";
  for (std::size_t i = 0; i < view.corners.size(); ++i) {
    out += "      ";
    write_corner(out, view.corners[i]);
    if (fitted) {
      const CornerFit& fit = calibration.fits[v][i];
      for (double value : fit.residual_px) {
        out += ' ';
        append_number(out, value);
      }
      out += fit.outlier ? " 1" : " 0";
    }
    out += '\n';
  }
}

void read_view(const Field& field, const Names& cameras, Calibration& calibration) {
  field.only({"camera", "frame", "image", "target", "reason", "time_s", "unused", "corners"});
  View view;
  std::vector<CornerFit> fits;
  view.cam = index_of(field.at("camera"), cameras, "camera");
  view.frame = index_of(field.at("frame"), calibration.data.frames, "frame");
  view.image = field.at("image").text();
  view.target = read_target_of_view(field, calibration.data.targets);
  if (const auto reason = field.find("reason")) view.reason = reason->text();
  if (const auto time = field.find("time_s")) view.time_s = time->number();
  const auto unused = field.find("unused");
  if (const auto block = field.find("corners")) {
    for_each_row(*block, [&](int line, const auto& words) {
      const bool fitted = words.size() == 7;
      if ((!fitted && words.size() != 4) || (!view.corners.empty() && fitted == fits.empty())) {
        block->fail(fmt::format(
            "row {}: 'point x y sigma' or 'point x y sigma dx dy outlier' is needed, in all rows", line));
      }
      view.corners.push_back(read_corner(*block, line, words));
      if (!fitted) return;
      if (words[6] != "0" && words[6] != "1")
        block->fail(fmt::format("row {}: outlier must be 0 or 1", line));
      fits.push_back(
          {{read_word(*block, line, words[4]), read_word(*block, line, words[5])}, words[6] == "1"});
    });
  }
  calibration.data.views.push_back(std::move(view));
  calibration.fits.push_back(std::move(fits));
  calibration.view_reason.push_back(unused ? unused->text() : "");
}

bool same_cameras(const Calibration& calibration) {
  const auto& of_data = calibration.data.cameras;
  const auto& of_rig = calibration.rig.cameras;
  if (of_data.size() != of_rig.size()) return false;
  for (std::size_t i = 0; i < of_data.size(); ++i) {
    if (of_data[i].name != of_rig[i].name || !(of_data[i].size == of_rig[i].size)) return false;
  }
  return true;
}

void write_data(std::string& out, const Calibration& calibration) {
  const Dataset& data = calibration.data;
  write_targets(out, data.targets);
  if (data.targets.size() > 1) {
    PLUMBLINE_CHECK(calibration.T_board0_board.size() == data.targets.size(), "one pose for each target");
    out += "T_board0_board:\n";
    for (std::size_t i = 0; i < data.targets.size(); ++i)
      append(out, "  {}: {}\n", yaml_text(data.targets[i].name), pose_text(calibration.T_board0_board[i]));
  }
  write_effect_values(out, calibration);
  if (!data.detector.empty()) append(out, "detector: {}\n", yaml_text(data.detector));
  if (!same_cameras(calibration)) {
    out += data.cameras.empty() ? "data_cameras: []\n" : "data_cameras:\n";
    for (const CameraInfo& camera : data.cameras) append(out, "  - {}\n", camera_info_text(camera));
  }
  out += data.frames.empty() ? "frames: []\n" : "frames:\n";
  for (std::size_t f = 0; f < data.frames.size(); ++f) {
    append(out, "  - name: {}\n", yaml_text(data.frames[f]));
    const bool has_pose = f < calibration.T_rig_board.size() && calibration.T_rig_board[f];
    if (has_pose) append(out, "    T_rig_board: {}\n", pose_text(*calibration.T_rig_board[f]));
  }
  if (!data.views.empty())
    out +=
        "# rows of corners: point x y sigma, then where used: residual dx dy (projected - measured), "
        "outlier\n";
  out += data.views.empty() ? "views: []\n" : "views:\n";
  for (std::size_t v = 0; v < data.views.size(); ++v) write_view(out, calibration, v);
}

void read_board_poses(const Field& root, Calibration& calibration) {
  const std::vector<Target>& targets = calibration.data.targets;
  calibration.T_board0_board.assign(1, SE3());
  if (targets.size() == 1) return;
  const Field poses = root.at("T_board0_board");
  calibration.T_board0_board.clear();
  for (const auto& [name, pose] : poses.entries()) {
    const std::size_t i = calibration.T_board0_board.size();
    if (i >= targets.size() || name != targets[i].name) break;
    calibration.T_board0_board.push_back(read_pose(pose));
  }
  if (calibration.T_board0_board.size() != targets.size() || poses.entries().size() != targets.size())
    poses.fail("one pose for each target is needed, in the order of the targets");
}

void read_data(const Field& root, Calibration& calibration) {
  Dataset& data = calibration.data;
  data.targets = read_targets(root);
  read_board_poses(root, calibration);
  read_effect_values(root, calibration);
  if (const auto detector = root.find("detector")) data.detector = detector->text();
  if (const auto cameras = root.find("data_cameras")) {
    for (const Field& camera : cameras->items()) data.cameras.push_back(read_camera_info(camera));
  } else {
    for (const Camera& camera : calibration.rig.cameras) data.cameras.push_back({camera.name, camera.size});
  }
  Names names;
  for (const CameraInfo& camera : data.cameras) names.push_back(camera.name);
  for (const Field& frame : root.at("frames").items()) {
    frame.only({"name", "T_rig_board"});
    data.frames.push_back(frame.at("name").text());
    const auto pose = frame.find("T_rig_board");
    calibration.T_rig_board.push_back(pose ? std::optional(read_pose(*pose)) : std::nullopt);
  }
  unique_names(root.at("frames"), data.frames);
  for (const Field& view : root.at("views").items()) read_view(view, names, calibration);
}

// --- covariance ---

void write_covariance(std::string& out, const MatX& covariance, bool several_boards, bool has_effects) {
  out +=
      "# of the shared parameters: lens parameters camera by camera, then rotation [rad] and translation [m] "
      "of each T_cam_rig but the first";
  if (several_boards) out += ", then of each T_board0_board but the first";
  if (has_effects) out += ", then bows [m], line delays and time offsets [s]";
  out += "\ncovariance: |\n";
  for (Eigen::Index r = 0; r < covariance.rows(); ++r) {
    out += "  ";
    for (Eigen::Index c = 0; c < covariance.cols(); ++c) {
      if (c > 0) out += ' ';
      append_number(out, covariance(r, c));
    }
    out += '\n';
  }
}

MatX read_covariance(const Field& block, const Calibration& calibration) {
  const auto n = static_cast<Eigen::Index>(shared_parameter_names(calibration).size());
  std::vector<double> values;
  for_each_row(block, [&](int line, const auto& words) {
    if (static_cast<Eigen::Index>(words.size()) != n) {
      block.fail(fmt::format("row {}: {} numbers are needed, there are {}", line, n, words.size()));
    }
    for (std::string_view word : words) values.push_back(read_word(block, line, word));
  });
  if (static_cast<Eigen::Index>(values.size()) != n * n) {
    block.fail(fmt::format("{} rows are needed, there are {}", n, values.size() / n));
  }
  return Eigen::Map<const MatX>(values.data(), n, n).transpose();
}

/// Its cameras are those of the rig, which are there without data too.
Contents whole_contents(const Calibration& calibration) {
  Contents contents;
  if (!calibration.data.targets.empty()) contents = contents_of(calibration.data);
  contents.cameras = static_cast<int>(calibration.rig.cameras.size());
  return contents;
}

/// A rig that was read from elsewhere: a summary of zeros would be a false one.
bool is_rig_only(const Calibration& calibration) {
  const SolveStats& stats = calibration.stats;
  const Provenance& provenance = calibration.provenance;
  return calibration.data.targets.empty() && stats.rms_px == 0 && stats.n_corners == 0 &&
         stats.termination.empty() && provenance.version.empty() && provenance.options.empty();
}

Result<Calibration> read_calibration(const Field& root, std::string_view whole_text) {
  if (!root.is_map() || !root.has("plumbline_calibration")) {
    root.fail("not a calibration: it has no 'plumbline_calibration'");
  }
  check_version(root, "plumbline_calibration", kCalibrationVersion);
  root.only({"plumbline_calibration", "contents", "cameras", "T_cam_rig", "summary", "provenance", "target",
             "targets", "T_board0_board", "board_bow", "clocks", "detector", "data_cameras", "frames",
             "views", "covariance"});
  Calibration calibration;
  calibration.rig = read_rig_fields(root);
  if (const auto summary = root.find("summary")) calibration.stats = read_summary(*summary);
  if (const auto provenance = root.find("provenance")) calibration.provenance = read_provenance(*provenance);
  const bool has_data = root.has("target") || root.has("targets");
  if (has_data) read_data(root, calibration);
  if (const auto covariance = root.find("covariance"))
    calibration.covariance = read_covariance(*covariance, calibration);
  check_contents(root, whole_contents(calibration), whole_text);
  if (!has_data) return calibration;  // a rig and nothing else
  if (Status valid = validate(calibration.data); !valid) return valid.error();
  return calibration;
}

}  // namespace

}  // namespace io

std::string format_calibration(const Calibration& calibration) {
  const bool several_boards = calibration.data.targets.size() > 1;
  std::string out =
      several_boards ? "# Plumbline calibration. p_cam = T_cam_rig * T_rig_board * T_board0_board * p_board; "
                     : "# Plumbline calibration. p_cam = T_cam_rig * T_rig_board * p_board; ";
  out +=
      "metres, radians, pixels; the centre of the\n"
      "# top-left pixel is (0, 0); x right, y down, z forward; quaternions are w, x, y, z.\n";
  io::append(out, "plumbline_calibration: {}\ncontents: {}\n", io::kCalibrationVersion,
             io::contents_text(io::whole_contents(calibration)));
  io::write_rig_fields(out, calibration.rig);
  if (!io::is_rig_only(calibration)) {
    io::write_summary(out, calibration.stats);
    io::write_provenance(out, calibration.provenance);
  }
  if (calibration.covariance)
    io::write_covariance(out, *calibration.covariance, several_boards, !effect_values(calibration).empty());
  if (!calibration.data.targets.empty()) io::write_data(out, calibration);
  return out;
}

Result<Calibration> parse_calibration(std::string_view yaml) {
  return io::read_yaml<Calibration>(yaml, "",
                                    [&](const io::Field& root) { return io::read_calibration(root, yaml); });
}

}  // namespace plumbline

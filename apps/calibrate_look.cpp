// SPDX-License-Identifier: Apache-2.0
#include "calibrate_look.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "plumbline/core/text.hpp"
#include "plumbline/io/formats.hpp"
#include "plumbline/refine/start.hpp"

namespace plumbline::apps {
namespace {

int n_added(const LookReport& report) {
  int n = 0;
  for (const LookCount& count : report.look.by_camera) n += count.corners;
  return n;
}

int n_added_views(const LookReport& report) {
  int n = 0;
  for (const LookCount& count : report.look.by_camera) n += count.views;
  return n;
}

/// Solves with the corners of `start`: as the first solve was made, so that the corners file that is written
/// gives the same result again.
Result<Calibration> solve(const Calibration& start, const RefineOptions& options, bool from_start,
                          const Calibration& first) {
  if (from_start) return refine(start, options);
  RefineOptions same = options;
  same.lenses.clear();
  for (const Camera& camera : first.rig.cameras) same.lenses.push_back(lens_spec(camera.lens));
  auto done = calibrate(start.data, same);
  if (!done) return done;
  done->provenance.lens_tries = first.provenance.lens_tries;
  if (const auto choice = first.provenance.options.find("lens_choice");
      choice != first.provenance.options.end())
    done->provenance.options.insert(*choice);
  return done;
}

/// The start of the last solve: with circles, when their centres stand.
Result<Calibration> last_start(const RefineOptions& options, LookReport& report) {
  if (report.look.circles.empty()) return report.look.start;
  RefineOptions between = options;
  between.lenses = {"opencv5"};  // not read: the lenses are those of the start
  auto settled =
      settle_circles(report.look, [&](const Calibration& start) { return refine(start, between); });
  if (!settled) return settled.error();
  report.circle_rounds = settled->rounds;
  report.largest_bias_px = settled->last.largest_px;
  return std::move(settled->calibration);
}

struct AddedFit {
  int used = 0, outliers = 0;
  double rms_px = 0;
};

/// What became of the corners that the second look added, in all cameras or in one.
AddedFit fit_of_added(const LookReport& report, const Calibration& cal) {
  AddedFit out;
  double sum = 0;
  for (std::size_t v = 0; v < cal.data.views.size() && v < report.first.views.size(); ++v) {
    if (!cal.view_reason[v].empty() || cal.fits[v].size() != cal.data.views[v].corners.size()) continue;
    const std::vector<Corner>& before = report.first.views[v].corners;
    for (std::size_t i = 0; i < cal.fits[v].size(); ++i) {
      const int point = cal.data.views[v].corners[i].point;
      if (std::any_of(before.begin(), before.end(), [&](const Corner& c) { return c.point == point; }))
        continue;
      ++(cal.fits[v][i].outlier ? out.outliers : out.used);
      if (!cal.fits[v][i].outlier) sum += cal.fits[v][i].residual_px.squaredNorm();
    }
  }
  out.rms_px = out.used > 0 ? std::sqrt(sum / out.used) : 0;
  return out;
}

std::string counts(int corners, int views) {
  std::string text = fmt::format("{} {}", corners, corners == 1 ? "corner" : "corners");
  if (views > 0) text += fmt::format(", {} {} that had none", views, views == 1 ? "view" : "views");
  return text;
}

Result<LookReport> look(const std::vector<CameraImages>& images, const Calibration& calibration,
                        const Common& common) {
  Progress progress("looking again", common);
  SecondLookOptions options;
  options.n_threads = common.n_threads;
  options.progress = [&](int done, int all) { progress(done, all); };
  auto looked = look_again(images, calibration, options);
  if (!looked) return looked.error();
  LookReport report;
  report.look = *std::move(looked);
  report.first = calibration.data;
  return report;
}

Json json_of_counts(const LookReport& report, const Dataset& data) {
  Json by_camera = Json::array();
  for (std::size_t cam = 0; cam < report.look.by_camera.size(); ++cam) {
    const LookCount& count = report.look.by_camera[cam];
    by_camera.push_back(
        {{"camera", data.cameras[cam].name}, {"added_corners", count.corners}, {"added_views", count.views}});
  }
  return {{"images_read", report.look.n_images},
          {"added_corners", n_added(report)},
          {"added_views", n_added_views(report)},
          {"cameras", by_camera}};
}

std::string text_of_counts(const LookReport& report, const Dataset& data) {
  if (n_added(report) == 0) {
    if (report.look.n_images == 0) return "second look: every board is whole, no image was read again";
    return fmt::format("second look: nothing new in {} {}", report.look.n_images,
                       report.look.n_images == 1 ? "image" : "images");
  }
  std::vector<std::string> parts;
  for (std::size_t cam = 0; cam < report.look.by_camera.size(); ++cam) {
    const LookCount& count = report.look.by_camera[cam];
    if (count.corners > 0)
      parts.push_back(data.cameras[cam].name + ": " + counts(count.corners, count.views));
  }
  return "second look added " + join(parts, "; ");
}

/// The remark and the option that tell readers of the files.
void note_look(const LookReport& report, Dataset& data) {
  if (n_added(report) > 0)
    data.detector += "; second look: " + counts(n_added(report), n_added_views(report));
}

}  // namespace

Result<LookReport> look_with(const std::string& file, const std::vector<CameraImages>& images,
                             const Common& common, Dataset& data) {
  auto rig = load_rig({file});
  if (!rig) return rig.error();
  StartFrom from;
  from.places_known = poses_known(*rig);
  from.n_threads = common.n_threads;
  auto start = start_from(data, *rig, from);
  if (!start) return start.error();
  RefineOptions options;
  options.fixed = {"lens"};
  if (data.cameras.size() > 1) options.fixed.push_back("rig");
  options.n_threads = common.n_threads;
  auto posed = refine(*start, options);
  if (!posed) return posed.error();
  auto report = look(images, *posed, common);
  if (!report) return report;
  data = report->look.start.data;
  note_look(*report, data);
  return report;
}

void add_look(const LookReport& report, const Dataset& data, Json& json) {
  json["second_look"] = json_of_counts(report, data);
}

std::string text_of_look(const LookReport& report, const Dataset& data) {
  return text_of_counts(report, data) + "\n";
}

bool can_look_again(const CalibrateInputs& inputs, bool has_earlier) {
  return inputs.corners.empty() && !inputs.cams.empty() && !has_earlier;
}

Result<LookReport> look_and_solve(const std::vector<CameraImages>& images, const RefineOptions& options,
                                  bool from_start, const Common& common, Calibration& calibration) {
  const auto begin = std::chrono::steady_clock::now();
  auto looked = look(images, calibration, common);
  if (!looked) return looked;
  LookReport report = *std::move(looked);
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (n_added(report) == 0 && report.look.circles.empty()) return report;
  auto start = last_start(options, report);
  if (start) start = solve(*start, options, from_start, calibration);
  if (!start) {
    report.note = start.error().text();
    return report;
  }
  start->provenance.options["second_look"] = counts(n_added(report), n_added_views(report));
  note_look(report, start->data);
  calibration = *std::move(start);
  return report;
}

void add_look(const LookReport& report, const Calibration& cal, Json& json) {
  const AddedFit fit = fit_of_added(report, cal);
  Json look = json_of_counts(report, cal.data);
  look["outliers"] = fit.outliers;
  look["rms_px"] = fit.used > 0 ? Json(fit.rms_px) : Json(nullptr);
  look["used"] = report.note.empty();
  look["reason"] = report.note.empty() ? Json(nullptr) : Json(report.note);
  json["second_look"] = look;
  if (report.circle_rounds == 0) return;
  Json diameters = Json::array();
  for (const double d : report.look.diameter_m) diameters.push_back(d > 0 ? Json(d) : Json(nullptr));
  json["circle_bias"] = {
      {"rounds", report.circle_rounds}, {"largest_px", report.largest_bias_px}, {"diameter_m", diameters}};
}

std::string text_of_look(const LookReport& report, const Calibration& cal) {
  std::string text = text_of_counts(report, cal.data);
  if (n_added(report) > 0 && report.note.empty()) {
    const AddedFit fit = fit_of_added(report, cal);
    text += fmt::format("; their rms {:.4f} px, {} outliers", fit.rms_px, fit.outliers);
  }
  text += "\n";
  if (!report.note.empty())
    text += "second look: what it added was left out again, the solve failed: " + report.note + "\n";
  if (report.circle_rounds > 0) {
    text += fmt::format(
        "circles: the bias of their centres, up to {:.4f} px, was taken out in {} {}; diameter",
        report.largest_bias_px, report.circle_rounds, report.circle_rounds == 1 ? "round" : "rounds");
    for (const double d : report.look.diameter_m)
      if (d > 0) text += fmt::format(" {:.3f} mm", 1e3 * d);
    text += " as seen\n";
  }
  return text;
}

}  // namespace plumbline::apps

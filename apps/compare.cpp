// SPDX-License-Identifier: Apache-2.0
#include "plumbline/assess/compare.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"

namespace plumbline::apps {
namespace {

struct Options {
  std::string a, b, align = "none";
  double distance_m = 1.0, max_diff_px = 0;
};

// Cameras of one name belong together; without common names, cameras in the same place.
Result<std::vector<std::pair<int, int>>> pairs_of(const Rig& a, const Rig& b) {
  std::vector<std::pair<int, int>> pairs;
  if (a.cameras.size() == 1 && b.cameras.size() == 1) return std::vector{std::pair{0, 0}};
  for (std::size_t i = 0; i < a.cameras.size(); ++i) {
    if (const auto j = b.find(a.cameras[i].name)) pairs.emplace_back(static_cast<int>(i), *j);
  }
  if (!pairs.empty()) return pairs;
  if (a.cameras.size() != b.cameras.size()) {
    return Error{
        ErrorCode::kInvalidData,
        fmt::format("{} cameras against {}, and no name in common", a.cameras.size(), b.cameras.size()),
        "compare"};
  }
  for (std::size_t i = 0; i < a.cameras.size(); ++i)
    pairs.emplace_back(static_cast<int>(i), static_cast<int>(i));
  return pairs;
}

Json json_of_diff(const DiffPx& d) {
  return {{"rms", d.rms}, {"p95", d.p95}, {"max", d.max}, {"compared_fraction", d.compared_fraction}};
}

Result<int> run(const Options& o, const Common& common) {
  auto a = load_rig({o.a});
  if (!a) return a.error();
  auto b = load_rig({o.b});
  if (!b) return b.error();
  auto pairs = pairs_of(*a, *b);
  if (!pairs) return pairs.error();
  const Align align = o.align == "rotation" ? Align::kRotation
                      : o.align == "pose"   ? Align::kPose
                                            : Align::kNone;
  Json json{{"align", o.align}, {"cameras", Json::array()}};
  std::string text;
  DiffPx worst;
  for (const auto& [i, j] : *pairs) {
    auto diff = compare_cameras(a->cameras[i], b->cameras[j], align, o.distance_m);
    if (!diff) return diff.error();
    json["cameras"].push_back({{"name", a->cameras[i].name}, {"diff_px", json_of_diff(*diff)}});
    text += fmt::format("{}: difference over the image {:.6g} px rms, {:.6g} p95, {:.6g} max{}\n",
                        a->cameras[i].name, diff->rms, diff->p95, diff->max,
                        diff->compared_fraction < 1
                            ? fmt::format(" (over {:.1f} % of it: beyond, a calibration says nothing)",
                                          100 * diff->compared_fraction)
                            : std::string());
    if (diff->max >= worst.max) worst = *diff;
  }
  json["diff_px"] = json_of_diff(worst);
  const bool missed = o.max_diff_px > 0 && !(worst.max <= o.max_diff_px);
  if (missed)
    text +=
        fmt::format("quality gate missed: {:.6g} px is above --max-diff {} px\n", worst.max, o.max_diff_px);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return missed ? kGateMissed : kDone;
}

}  // namespace

void add_compare(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("a", o->a, "calibration or camera file")->required();
  app.add_option("b", o->b, "calibration or camera file")->required();
  app.add_option("--align", o->align,
                 "none: the same ray through both; rotation, pose: after the fit that is best")
      ->check(CLI::IsMember({"none", "rotation", "pose"}));
  app.add_option("--distance", o->distance_m, "of the points compared with --align pose [m] (default: 1)")
      ->check(positive());
  app.add_option("--max-diff", o->max_diff_px, "exit with 3 when the largest difference is above this [px]")
      ->check(positive());
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/target/target.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <map>

#include "args.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/target_io.hpp"
#include "plumbline/synth/corner.hpp"
#include "plumbline/synth/print.hpp"

namespace plumbline::apps {
namespace {

struct NewOptions {
  std::string type, name, output;
  std::string corners, squares, tags, circles;  // COLUMNSxROWS
  double square_m = 0, marker_m = 0, tag_m = 0, tag_spacing = 0.3, spacing_m = 0, diameter_m = 0;
  std::string dictionary = "4X4_50", family = "36h11", layout = "auto";
  int first_id = 0, border = 2;
  bool outside = false;
};

// The counts of a board, which its type needs.
ImageSize counts(const std::string& text, const std::string& option, const std::string& type) {
  if (text.empty()) usage_error(fmt::format("--type {} needs {} COLUMNSxROWS", type, option));
  return parse_counts(text, option);
}

double length(double value, const std::string& option, const std::string& type) {
  if (value == 0) usage_error(fmt::format("--type {} needs {} in metres", type, option));
  return value;
}

Charuco charuco(const NewOptions& o) {
  const auto [columns, rows] = counts(o.squares, "--squares", o.type);
  const auto layout = o.layout == "legacy"    ? Charuco::Layout::kLegacy
                      : o.layout == "current" ? Charuco::Layout::kCurrent
                                              : Charuco::Layout::kAuto;
  return {columns,
          rows,
          length(o.square_m, "--square", o.type),
          length(o.marker_m, "--marker", o.type),
          o.dictionary,
          o.first_id,
          layout};
}

AprilGrid aprilgrid(const NewOptions& o) {
  const auto [columns, rows] = counts(o.tags, "--tags", o.type);
  return {columns,    rows,    length(o.tag_m, "--tag-size", o.type), o.tag_spacing, o.family,
          o.first_id, o.border};
}

Result<TargetSpec> spec_of(const NewOptions& o) {
  if (o.type == "chessboard") {
    const auto [columns, rows] = counts(o.corners, "--corners", o.type);
    return TargetSpec(Chessboard{columns, rows, length(o.square_m, "--square", o.type)});
  }
  if (o.type == "charuco") return TargetSpec(charuco(o));
  if (o.type == "aprilgrid") return TargetSpec(aprilgrid(o));
  if (o.type == "circles" || o.type == "acircles") {
    const auto [columns, rows] = counts(o.circles, "--circles", o.type);
    return TargetSpec(
        Circles{columns, rows, length(o.spacing_m, "--spacing", o.type), o.diameter_m, o.type == "acircles"});
  }
  const TargetSpec panel = o.tags.empty() ? TargetSpec(charuco(o)) : TargetSpec(aprilgrid(o));
  auto rig = corner_rig(panel, o.outside ? CornerKind::kOutside : CornerKind::kInside);
  if (!rig) return rig.error();
  return TargetSpec(*std::move(rig));
}

Result<int> run_new(const NewOptions& o, const Common& common) {
  if (Status s = check_output(o.output, common); !s) return s.error();
  auto spec = spec_of(o);
  if (!spec) return spec.error();
  auto target = make_target(*spec, o.name);
  if (!target) return target.error();
  if (Status s = write_file(o.output, format_target(*target), common.force); !s) return s.error();
  const Json json{{"name", target->name},
                  {"type", target_type(target->spec)},
                  {"points", target->points.size()},
                  {"planar", target->is_planar},
                  {"file", o.output}};
  const std::string text = fmt::format("{}: {} points{}\nwritten: {}\n", target->name, target->points.size(),
                                       target->is_planar ? "" : ", not in one plane", o.output);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

struct PrintArguments {
  std::string target, output, page = "auto";
  int dpi = 300;
};

Result<int> run_print(const PrintArguments& o, const Common& common) {
  auto format = print_format_of(o.output);
  if (!format) usage_error(fmt::format("-o {}: a board is printed as .pdf, .svg or .png", o.output));
  if (Status s = check_output(o.output, common); !s) return s.error();
  auto target = load_target(o.target);
  if (!target) return target.error();
  auto print = print_target(*target, {*format, o.page, o.dpi});
  if (!print) return print.error();
  if (Status s = write_file(o.output, print->bytes, common.force); !s) return s.error();
  const Json json{{"name", target->name},
                  {"page", print->page},
                  {"page_mm", {print->page_mm.x(), print->page_mm.y()}},
                  {"pages", print->n_pages},
                  {"file", o.output}};
  const std::string text = fmt::format(
      "{}: {} ({:g} x {:g} mm), {} page{}\nPrint at 100 %, without \"fit to page\", and measure a known "
      "length on the paper.\n"
      "written: {}\n",
      target->name, print->page, print->page_mm.x(), print->page_mm.y(), print->n_pages,
      print->n_pages == 1 ? "" : "s", o.output);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

// An option of another type of board is a mistake that would else pass in silence.
void check_options_fit(const CLI::App& app, const std::string& type) {
  const std::map<std::string, std::string> types_of{{"--corners", "chessboard"},
                                                    {"--squares", "charuco corner"},
                                                    {"--square", "chessboard charuco corner"},
                                                    {"--marker", "charuco corner"},
                                                    {"--dict", "charuco corner"},
                                                    {"--layout", "charuco corner"},
                                                    {"--tags", "aprilgrid corner"},
                                                    {"--tag-size", "aprilgrid corner"},
                                                    {"--tag-spacing", "aprilgrid corner"},
                                                    {"--family", "aprilgrid corner"},
                                                    {"--border", "aprilgrid corner"},
                                                    {"--first-id", "charuco aprilgrid corner"},
                                                    {"--circles", "circles acircles"},
                                                    {"--spacing", "circles acircles"},
                                                    {"--diameter", "circles acircles"},
                                                    {"--outside", "corner"}};
  for (const auto& [option, types] : types_of) {
    const auto words = split(types, ' ');
    if (app.count(option) > 0 && std::find(words.begin(), words.end(), type) == words.end()) {
      usage_error(fmt::format("{} is for {}, not for {}", option, join(words, ", "), type));
    }
  }
}

void add_new(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<NewOptions>();
  app.add_option("--type", o->type,
                 "what to make; corner: three boards on the faces of a right-angled corner")
      ->required()
      ->check(CLI::IsMember({"chessboard", "charuco", "aprilgrid", "circles", "acircles", "corner"}));
  app.add_option("--corners", o->corners, "chessboard: inner corners, COLUMNSxROWS");
  app.add_option("--squares", o->squares, "charuco, corner: squares, COLUMNSxROWS");
  app.add_option("--square", o->square_m, "chessboard, charuco: side of a square, metres");
  app.add_option("--marker", o->marker_m, "charuco: side of a marker, metres");
  app.add_option("--dict", o->dictionary, "charuco: OpenCV's dictionary (default: 4X4_50)");
  app.add_option("--layout", o->layout, "charuco: auto, current, legacy (before OpenCV 4.6; default: auto)")
      ->check(CLI::IsMember({"auto", "current", "legacy"}));
  app.add_option("--tags", o->tags, "aprilgrid, corner: tags, COLUMNSxROWS");
  app.add_option("--tag-size", o->tag_m, "aprilgrid: side of a tag, metres");
  app.add_option("--tag-spacing", o->tag_spacing,
                 "aprilgrid: gap as a ratio of the tag's side (default: 0.3)");
  app.add_option("--family", o->family, "aprilgrid: tag family, 36h11 or 25h9 (default: 36h11)");
  app.add_option("--border", o->border,
                 "aprilgrid: black modules around a tag's bits, 1 or 2 as Kalibr prints (default: 2)");
  app.add_option("--first-id", o->first_id, "charuco, aprilgrid: id of the first marker (default: 0)");
  app.add_option("--circles", o->circles, "circles, acircles: COLUMNSxROWS");
  app.add_option("--spacing", o->spacing_m,
                 "circles: between neighbours; acircles: half of that within a row; metres");
  app.add_option("--diameter", o->diameter_m,
                 "circles: diameter, metres (default: 0.5 of the spacing, acircles 0.8)");
  app.add_flag("--outside", o->outside,
               "corner: of a box seen from outside (default: of a room, from inside)");
  app.add_option("--name", o->name, "what the target is called (default: from its sizes)");
  app.add_option("-o,--output", o->output, "target file, for example board.yaml")->required();
  on_run(app, exit_code, [o, &app, &common] {
    check_options_fit(app, o->type);
    return run_new(*o, common);
  });
}

void add_print(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<PrintArguments>();
  app.add_option("target", o->target, "target file, ours or Kalibr's")->required();
  app.add_option("--page", o->page,
                 "A4 A3 A2 A1 A0 letter WxHmm (default: the smallest of A4..A0 that fits)");
  app.add_option("--dpi", o->dpi, "resolution of a .png (default: 300)")->check(CLI::Range(10, 2400));
  app.add_option("-o,--output", o->output, "board.pdf, board.svg or board.png")->required();
  on_run(app, exit_code, [o, &common] { return run_print(*o, common); });
}

}  // namespace

void add_target(CLI::App& app, const Common& common, int& exit_code) {
  app.require_subcommand(1);
  CLI::App* make = app.add_subcommand("new", "describe a board in a file");
  CLI::App* print = app.add_subcommand("print", "draw a board at true scale: .pdf, .svg or .png");
  make->fallthrough();
  print->fallthrough();
  add_new(*make, common, exit_code);
  add_print(*print, common, exit_code);
}

}  // namespace plumbline::apps

// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "args.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/formats.hpp"

namespace plumbline::apps {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<std::string> inputs;
  std::string output, to, from;
  double alpha = 0;
};

std::string format_names() {
  std::vector<std::string> names;
  for (const Format* f : formats()) names.emplace_back(f->name);
  return join(names, ", ");
}

// One file goes where -o says when -o looks like a file; otherwise -o is a folder.
bool output_is_file(const fs::path& output, const std::vector<NamedBytes>& files) {
  return files.size() == 1 && !fs::is_directory(output) && output.has_extension();
}

Status write_all(const Options& o, const Common& common, const std::vector<NamedBytes>& files) {
  if (output_is_file(o.output, files)) return write_file(o.output, files.front().bytes, common.force);
  return write_folder(o.output, common.force, [&](const fs::path& folder) -> Status {
    for (const NamedBytes& file : files) {
      if (Status s = write_file(folder / file.name, file.bytes, true); !s) return s;
    }
    return {};
  });
}

Result<int> run(const Options& o, const Common& common) {
  const Format* format = find_format(o.to);
  if (!format) usage_error(fmt::format("--to {}: there are: {}", o.to, format_names()));
  if (!format->write) usage_error(fmt::format("--to {}: this format can only be read", o.to));
  if (!o.from.empty() && !find_format(o.from))
    usage_error(fmt::format("--from {}: there are: {}", o.from, format_names()));
  if (Status s = check_output(o.output, common); !s) return s.error();
  auto rig = load_rig(o.inputs, o.from);
  if (!rig) {
    Error error = rig.error();
    if (o.from.empty() && error.code == ErrorCode::kParse) error.message += "; say which it is with --from";
    return error;
  }
  WriteOptions options;
  std::optional<StereoRectification> rectification;
  std::string note;
  if (rig->cameras.size() == 2) {
    auto rectified = rectify_stereo(*rig, 0, 1, {o.alpha, {}});
    if (rectified)
      rectification = *rectified;
    else
      note = "without a rectification: " + rectified.error().message + "\n";
    if (rectification) options.rectification = &*rectification;
  }
  if (Status fit = check_folds(*format, *rig); !fit) {
    if (!common.force) {
      Error error = fit.error();
      error.message += "; --force writes it nevertheless";
      return error;
    }
    fmt::print(stderr, "plumbline convert: WARNING: {}\n", fit.error().text());
    note += "warning: " + fit.error().text() + "\n";
  }
  auto files = format->write(*rig, options);
  if (!files) return files.error();
  if (files->size() > 1 && fs::path(o.output).has_extension() && !fs::is_directory(o.output)) {
    usage_error(fmt::format("-o {}: {} files are written; give a folder", o.output, files->size()));
  }
  if (Status s = write_all(o, common, *files); !s) return s.error();
  Json json{{"format", format->name}, {"files", Json::array()}};
  if (!note.empty()) json["notes"] = note;
  std::string text = note;
  for (const NamedBytes& file : *files) {
    const std::string path =
        output_is_file(o.output, *files) ? o.output : (fs::path(o.output) / file.name).string();
    json["files"].push_back(path);
    text += "written: " + path + "\n";
  }
  if (Status s = print_result(common, json, text); !s) return s.error();
  return kDone;
}

}  // namespace

void add_convert(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("camera-files", o->inputs,
                 "calibration.yaml, camera files of any known format, or a folder of them")
      ->required();
  app.add_option("--to", o->to, "format to write: " + format_names())->required();
  app.add_option("--from", o->from, "format to read (default: told from the content)");
  app.add_option("--alpha", o->alpha, "of the rectification that some formats carry (default: 0)")
      ->check(between(0.0, 1.0));
  app.add_option("-o,--output", o->output, "a folder, or a file where the format is one file")->required();
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

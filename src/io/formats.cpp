// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/formats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>

#include "io/formats/common.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/rig/validity.hpp"

namespace plumbline {
namespace {

/// THE table of formats: a new one is its file in formats/, its name in formats/common.hpp and its line here.
constexpr std::array<const Format*, 6> kFormats{&io::kNativeFormat, &io::kOpencvFormat, &io::kRosFormat,
                                                &io::kKalibrFormat, &io::kMrcalFormat,  &io::kColmapFormat};

std::string known_names() {
  std::vector<std::string> names;
  for (const Format* format : kFormats) names.emplace_back(format->name);
  return join(names, ", ");
}

Result<const Format*> format_of(std::span<const NamedBytes> files) {
  const Format* found = nullptr;
  for (const NamedBytes& file : files) {
    const auto format = std::find_if(kFormats.begin(), kFormats.end(),
                                     [&](const Format* f) { return f->recognises(file.bytes); });
    if (format == kFormats.end()) {
      return Error{ErrorCode::kParse, "not a camera file of a format that is known (" + known_names() + ")",
                   file.name};
    }
    if (found && found != *format) {
      return Error{ErrorCode::kInvalidData,
                   fmt::format("this file is of format {}, those before are of {}; give files of one format",
                               (*format)->name, found->name),
                   file.name};
    }
    found = *format;
  }
  return found;
}

/// Names come from files and from file names, so that two may be the same.
void make_names_distinct(Rig& rig) {
  std::set<std::string> taken;
  for (Camera& camera : rig.cameras) {
    const std::string base = camera.name.empty() ? "camera" : camera.name;
    camera.name = base;
    for (int n = 2; !taken.insert(camera.name).second; ++n) camera.name = fmt::format("{}_{}", base, n);
  }
}

}  // namespace

std::span<const Format* const> formats() { return kFormats; }

const Format* find_format(std::string_view name) {
  for (const Format* format : kFormats) {
    if (format->name == name) return format;
  }
  return nullptr;
}

bool poses_known(const Rig& rig) {
  // Two may share a place (behind a beam splitter); all of them do where a file says nothing.
  for (const SE3& T : rig.T_cam_rig) {
    if (box_minus(T, rig.T_cam_rig[0]).norm() >= 1e-9) return true;
  }
  return rig.T_cam_rig.size() < 2;
}

Status check_folds(const Format& format, const Rig& rig) {
  if (format.carries_validity) return {};
  for (const Camera& camera : rig.cameras) {
    if (!folds_in_image(camera)) continue;
    const Fold fold = fold_of(camera.lens);
    const Validity at = camera.validity ? *camera.validity : fold.end;
    std::vector<std::string> able;
    for (const Format* f : kFormats) {
      if (f->carries_validity) able.emplace_back(f->name);
    }
    return Error{
        ErrorCode::kUnsupported,
        fmt::format("lens {} {} inside the picture and holds up to {:.0f} px from its centre only, which "
                    "format {} cannot say; {} can",
                    lens_name(camera.lens), fold.is_pole ? "runs off to infinity" : "turns back",
                    at.radius_px, format.name, join(able, ", ")),
        "camera " + camera.name};
  }
  return {};
}

Result<Rig> read_rig(std::span<const NamedBytes> files, std::string_view format_name) {
  if (files.empty()) return Error{ErrorCode::kInvalidData, "no camera file was given", ""};
  const Format* format = find_format(format_name);
  if (!format && !format_name.empty()) {
    return Error{ErrorCode::kUnsupported,
                 fmt::format("no format is called '{}'; known are: {}", format_name, known_names()), ""};
  }
  if (!format) {
    auto found = format_of(files);
    if (!found) return found.error();
    format = *found;
  }
  if (!format->read)
    return Error{ErrorCode::kUnsupported, fmt::format("format {} can only be written", format->name),
                 files[0].name};
  auto rig = format->read(files);
  if (!rig) return rig.error();
  make_names_distinct(*rig);
  return rig;
}

}  // namespace plumbline

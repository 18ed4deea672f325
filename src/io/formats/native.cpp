// SPDX-License-Identifier: Apache-2.0
#include "io/formats/common.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/calibration_io.hpp"

/// Our own calibration.yaml as a format of camera files: every lens, and the rig whole.
namespace plumbline::io {
namespace {

Result<std::vector<NamedBytes>> write(const Rig& rig, const WriteOptions&) {
  Calibration calibration;
  calibration.rig = rig;
  return std::vector<NamedBytes>{{"calibration.yaml", format_calibration(calibration)}};
}

Result<Rig> read(std::span<const NamedBytes> files) {
  if (files.size() != 1)
    return Error{ErrorCode::kInvalidData, "one calibration.yaml holds a whole rig; give one", files[1].name};
  auto calibration = parse_calibration(files[0].bytes);
  if (calibration) return std::move(calibration->rig);
  Error error = calibration.error();
  error.where = error.where.empty() ? files[0].name : files[0].name + ": " + error.where;
  return error;
}

bool recognises(std::string_view bytes) {
  return bytes.find("plumbline_calibration:") != std::string_view::npos;
}

/// Every lens of the list: a new one is written without a change here.
const std::string& all_lenses() {
  static const std::string names = [] {
    const auto list = lens_names();
    return join({list.begin(), list.end()}, " ");
  }();
  return names;
}

}  // namespace

const Format kNativeFormat{"plumbline",
                           "Plumbline's own calibration.yaml",
                           "calibration.yaml",
                           all_lenses(),
                           true,
                           write,
                           read,
                           recognises,
                           true};

}  // namespace plumbline::io

// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/rectify/rectify.hpp"
#include "plumbline/rig/rig.hpp"

namespace plumbline {

/// What a format may need besides the rig.
struct WriteOptions {
  const StereoRectification* rectification = nullptr;  ///< of cameras 0 and 1; for formats that carry R and P
  double rms_px = 0;                                   ///< 0: not known, not written
};

/// A format of camera files. Each knows which lenses it can express; text in, text out, so that each can be
/// tested and fuzzed in memory. Adding one: docs/io.md.
struct Format {
  std::string_view name;     ///< "opencv", what --to and --from take
  std::string_view summary;  ///< one line for help and README
  std::string_view files;    ///< "CAMERA.yml, or intrinsics.yml + extrinsics.yml"
  std::string_view
      lenses;  ///< names of the lenses it can express, separated by blanks; a test holds it to that
  bool carries_extrinsics;  ///< whether a rig comes back whole
  /// kUnsupported names the lens or the number of cameras that the format cannot express, or says that the
  /// format's files need poses and poses_known() is false.
  Result<std::vector<NamedBytes>> (*write)(const Rig&, const WriteOptions&);
  /// From the files of one rig, in the order of its cameras. nullptr: write only.
  Result<Rig> (*read)(std::span<const NamedBytes>);
  /// Whether these bytes look like this format; cheap.
  bool (*recognises)(std::string_view bytes);
  bool carries_validity = false;  ///< whether Camera::validity comes back
};

/// The one table.
std::span<const Format* const> formats();
const Format* find_format(std::string_view name);

/// kUnsupported names the camera whose lens folds inside its picture (folds_in_image()) when the format
/// cannot say up to where it holds: whoever reads the file would use it all over the image.
Status check_folds(const Format& format, const Rig& rig);

/// Reads camera files of any known format (told from their content), Plumbline's own calibration.yaml
/// included. `format_name` empty: find out. Where the files say nothing about where the cameras stand, every
/// T_cam_rig is the identity, and poses_known() of the rig is false.
Result<Rig> read_rig(std::span<const NamedBytes> files, std::string_view format_name = "");

/// False when all cameras of a rig of several have the same pose, to 1e-9 m and rad: those poses are the
/// identities of a file without any. (Two may well share one, behind a beam splitter.) Such a rig serves for
/// what concerns each camera by itself. A rig of one camera has its pose.
bool poses_known(const Rig& rig);

}  // namespace plumbline

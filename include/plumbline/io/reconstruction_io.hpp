// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/rig/reconstruction.hpp"

namespace plumbline {

/// COLMAP's text model: cameras.txt, images.txt and points3D.txt (told by the ends of their names; others are
/// passed over). Its pixels are half a pixel larger than ours, its poses are our T_cam_world. Cameras are
/// named "camera" and their id. Key points without a scene point are not kept. kParse names the file and the
/// line: a file that is cut off, an id that is nowhere or there twice, a track that does not agree with the
/// images; kUnsupported a camera model that is none of our lenses.
Result<Reconstruction> parse_colmap_model(std::span<const NamedBytes> files);

/// The same three files. Numbers have 17 digits, so that what is written is read back, but for the rounding
/// of the half pixel (one unit in the last place, the first time). Ids are kept where all of a kind are there
/// and differ, and else are 1, 2, ...; a view without an image's name is called "viewN". Sigmas are not kept.
/// The ERROR of a point is the mean distance of its sightings that project, or -1. kUnsupported names a lens
/// that COLMAP does not have, a camera without its images' size, or a name with a line break. \pre
/// validate(scene) holds
Result<std::vector<NamedBytes>> format_colmap_model(const Reconstruction& scene);

/// A "bundle adjustment in the large" problem (Agarwal, Snavely, Seitz, Szeliski, 2010). There the camera
/// looks down -z with y up: p = -P / P.z, px = f (1 + k1 |p|^2 + k2 |p|^4) p, measured from the image's
/// centre, x right and y up. Turned about x by pi this is opencv4 with fx = fy = f, cx = cy = p1 = p2 = 0 and
/// pixels (x, -y). Every camera has one view and no size. kParse names the line.
Result<Reconstruction> parse_bal(std::string_view text);

/// Poses come back to 1e-15 rad and of their size, all else to the last digit. Pixels are written from the
/// principal point. kUnsupported names a lens with fx != fy or with a term besides k1 and k2. \pre
/// validate(scene) holds
Result<std::string> format_bal(const Reconstruction& scene);

/// Whether the bytes begin as a BAL problem does: three whole numbers, then two and two numbers.
bool looks_like_bal(std::string_view bytes);

}  // namespace plumbline

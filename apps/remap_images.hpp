// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "args.hpp"
#include "plumbline/rectify/remap.hpp"

namespace plumbline::apps {

/// The camera of that name; a rig of one answers to any name, because many camera files hold none.
Result<int> find_camera(const Rig& rig, const std::string& name, const std::string& file);

/// Reads every image, remaps it and writes FOLDER/CAMERA/STEM.png (the frame's name where two stems are the
/// same). kInvalidData when an image has another size than the camera.
Status remap_images(const CameraImages& images, ImageSize size, const RemapMaps& maps,
                    const std::filesystem::path& folder, const Common& common, Progress& progress);

/// Writes FOLDER/pairs/FRAME.png for every frame that both cameras have: the two rectified pictures side by
/// side (one above the other for a vertical pair) with lines along the epipolar lines, so that one can see
/// the rows match.
Status write_pairs(const std::vector<CameraImages>& images, const std::filesystem::path& folder,
                   bool vertical, const Common& common);

}  // namespace plumbline::apps

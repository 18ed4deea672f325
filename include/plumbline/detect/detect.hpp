// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/dataset.hpp"

namespace plumbline {

struct DetectOptions {
  int n_threads = 0;  ///< <= 0: all cores; results do not depend on it
  /// Called after each image, from any thread but never from two at once: images done, images in all.
  std::function<void(int, int)> progress;
};

/// What was found in one image. Exactly one of corners and reason is non-empty.
struct Detection {
  std::vector<Corner> corners;  ///< ascending by point; px with pixel centres at integers
  std::string reason;  ///< "no 9x6 chessboard found", "3 of 36 tags found, at least 4 are needed", ...
  std::string method;  ///< "saddle fit", ...; empty when nothing was found
  /// ChArUco with an even number of rows and layout kAuto: how many more markers fit their neighbours under
  /// the current layout than under the legacy one; below 0 the legacy layout was used. 0: the image fits
  /// both.
  int layout_vote = 0;
};

/// Finds the target in one 8-bit grey image. Thread-safe. kUnsupported when the target cannot be detected
/// (free points).
Result<Detection> detect_target(const cv::Mat& grey, const Target& target);

/// The images of one camera, in order, with the frame key of each (the text that the wildcards matched).
struct CameraImages {
  std::string camera;
  std::vector<std::filesystem::path> files;
  std::vector<std::string> names;   ///< what files call them: never absolute
  std::vector<std::string> frames;  ///< one key per file; equal keys of different cameras are one frame
};

/// Detects the target in every image on all cores. A failure of one image (cannot be decoded) fails the run
/// with its name; an image without the board becomes a View with a reason. kInvalidData: two image sizes in
/// one camera. kDegenerate: the board is in no image of a camera.
/// ChArUco boards whose layout is kAuto are found under one layout in all images: the sum of the images'
/// votes decides, the current layout where it is 0; `detector` says "layout current" or "layout legacy". In a
/// rig all boards are taken to have the same layout.
Result<Dataset> detect_dataset(const std::vector<CameraImages>& cameras, const Target& target,
                               const DetectOptions& options = {});

/// The same for several boards: every image is searched for every board and gives a view for each. In
/// addition kInvalidData is what check_distinct() says, and kDegenerate: no board is in any image of a
/// camera, or a board is in no image at all. \pre at least one target, with names of their own
Result<Dataset> detect_dataset(const std::vector<CameraImages>& cameras, const std::vector<Target>& targets,
                               const DetectOptions& options = {});

}  // namespace plumbline

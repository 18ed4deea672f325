// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "plumbline/core/result.hpp"
#include "plumbline/rig/dataset.hpp"

namespace plumbline {

struct DetectOptions {
  int n_threads = 0;  ///< <= 0: all cores; results do not depend on it
  /// Called after each image, from any thread but never from two at once: images done, images in all.
  std::function<void(int, int)> progress;
  /// thin_near_duplicates() of what was found.
  std::optional<double> thin_px;
  /// Called after the detection with one sentence for each thing about a camera's images that their user has
  /// to know ("left: 12 of 13 images carry EXIF orientation 6 ..."), in the order of the cameras.
  std::function<void(const std::string&)> note;
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
  std::vector<std::string> names;    ///< what files call them: never absolute
  std::vector<std::string> frames;   ///< one key per file; equal keys of different cameras are one frame
  std::vector<std::string> notes{};  ///< what a user has to know of them; detect_dataset() passes it on
};

struct VideoOptions {
  int every = 15;     ///< frames of a window, of which the sharpest is taken
  int n_threads = 0;  ///< <= 0: all cores; results do not depend on it
  /// Called from any thread but never from two at once: frames done, frames in all as the files promise.
  std::function<void(int, int)> progress;
};

/// Puts in the place of each video among the files the sharpest frame of each window (sharpest_frames() of
/// image/video.hpp): file "left.mp4#000120", name likewise, frame key "KEY/000120". Where no camera has more
/// than one video and nothing else they belong together whatever they are called, and the key is "000120".
/// Videos of one key are searched together, so that each window gives one frame of all cameras. Each video is
/// decoded once. \pre \c every > 0
Result<std::vector<CameraImages>> sample_videos(std::vector<CameraImages> cameras,
                                                const VideoOptions& options = {});

/// Leaves out frames that show again what an earlier one shows: views lose their corners and get the reason
/// "near-duplicate of frame 000090: corners moved by 0.4 px at most" where every corner of every view of the
/// frame lies within `thin_px` of the same corner of the same camera and target in one earlier frame that is
/// kept. So a frame of a rig goes only when all cameras agree. Without `thin_px` only frames of videos go, by
/// kThinFraction of the image's diagonal; 0: none.
void thin_near_duplicates(Dataset& data, std::optional<double> thin_px = std::nullopt);
inline constexpr double kThinFraction = 0.002;  ///< 1.6 px in 640x480, 4.4 px in 1920x1080

/// Whether a view has lost its corners to thin_near_duplicates().
bool is_near_duplicate(const View& view);

/// Detects the target in every image on all cores. No more images are in memory than threads. A failure of
/// one image (cannot be decoded) fails the run with its name; an image without the board becomes a View with
/// a reason. kInvalidData: two image sizes in one camera. kDegenerate: the board is in no image of a camera.
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

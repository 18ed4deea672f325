// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "plumbline/detect/detect.hpp"
#include "plumbline/synth/render.hpp"
#include "plumbline/synth/scene.hpp"
#include "support/support.hpp"

namespace plumbline::test {

/// A simulated scene of which the photographs exist: files, and the truth with exact projections as corners.
struct RenderedScene {
  Calibration truth;
  std::vector<CameraImages> cameras;
  /// The truth about a point of a view, whether it was seen or not.
  std::optional<Vec2> px_of(const View& view, int point) const;
};

/// `edit` may paint into a photograph before it is written (camera, frame, image).
RenderedScene render_scene(const TempDir& dir, const Target& target, SceneOptions scene,
                           const RenderOptions& look,
                           const std::function<void(int, int, cv::Mat&)>& edit = {});

/// Root mean square difference between true projections and those of a calibration, over the part of a
/// camera's image where true corners are (to 40 px: beyond them every lens only guesses), after the rotation
/// that fits best. What a view that was held out would see of it.
double projection_error_px(const RenderedScene& scene, int cam, const Calibration& calibration);

}  // namespace plumbline::test

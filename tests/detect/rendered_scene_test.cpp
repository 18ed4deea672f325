// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "detect/rendered_scene.hpp"
#include "plumbline/assess/compare.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline::test {

std::optional<Vec2> RenderedScene::px_of(const View& view, int point) const {
  return predict(truth, view, point);
}

RenderedScene render_scene(const TempDir& dir, const Target& target, SceneOptions scene,
                           const RenderOptions& look, const std::function<void(int, int, cv::Mat&)>& edit) {
  scene.noise_px = 0;
  RenderedScene out;
  auto truth = simulate(target, scene);
  EXPECT_TRUE(truth) << truth.error().text();
  out.truth = *std::move(truth);
  const auto drawings = *draw_target(target);
  for (std::size_t cam = 0; cam < out.truth.rig.cameras.size(); ++cam) {
    const Camera& camera = out.truth.rig.cameras[cam];
    const CameraRays rays = camera_rays(camera.lens, camera.size, 1);
    CameraImages images{camera.name, {}, {}, {}};
    for (std::size_t frame = 0; frame < out.truth.data.frames.size(); ++frame) {
      const std::string key = out.truth.data.frames[frame], name = fmt::format("{}/{}.png", camera.name, key);
      RenderOptions how = look;
      how.seed = look.seed + 100 * cam + frame;
      how.n_threads = 1;
      cv::Mat grey =
          render(drawings, rays, out.truth.rig.T_cam_rig[cam] * *out.truth.T_rig_board[frame], how);
      if (edit) edit(static_cast<int>(cam), static_cast<int>(frame), grey);
      std::filesystem::create_directories(dir / camera.name);
      EXPECT_TRUE(write_png(dir / name, grey));
      images.files.push_back(dir / name);
      images.names.push_back(name);
      images.frames.push_back(key);
    }
    out.cameras.push_back(std::move(images));
  }
  return out;
}

double projection_error_px(const RenderedScene& scene, int cam, const Calibration& calibration) {
  const auto wanted = [&](const Vec2& px) {
    return std::any_of(scene.truth.data.views.begin(), scene.truth.data.views.end(), [&](const View& view) {
      return view.cam == cam && std::any_of(view.corners.begin(), view.corners.end(),
                                            [&](const Corner& c) { return (c.px - px).norm() < 40; });
    });
  };
  const Lens& lens = calibration.rig.cameras[cam].lens;
  const auto ours = [&](const Vec3& p, Mat23* J) { return project(lens, p, J); };
  const auto diff = compare_projection(scene.truth.rig.cameras[cam], ours, Align::kRotation, 1, wanted);
  EXPECT_TRUE(diff) << diff.error().text();
  return diff ? diff->rms : 1e9;
}

}  // namespace plumbline::test

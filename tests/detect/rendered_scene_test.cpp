// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "detect/rendered_scene.hpp"
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

}  // namespace plumbline::test

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/scene.hpp"

#include <numbers>
#include <opencv2/core.hpp>

#include "plumbline/core/random.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/calibration_io.hpp"
#include "plumbline/io/dataset_io.hpp"
#include "plumbline/synth/corner.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {

Target target_of(const TargetSpec& spec) { return make_target(spec).value(); }

const TargetSpec kChessboard = Chessboard{9, 6, 0.025};
const TargetSpec kCharuco = Charuco{8, 11, 0.024, 0.018, "4X4_50"};

double angle_deg(const Vec3& a, const Vec3& b) {
  return std::acos(a.normalized().dot(b.normalized())) * 180 / std::numbers::pi;
}

// Every lens of the list has the field of view that was asked for, sees its whole image (the square fisheyes'
// corners aside) and, unless it has nothing to distort with, is distorted.
TEST(SimulatedLens, HasTheFieldOfView) {
  for (const std::string_view name : lens_names()) {
    for (const double fov : {40.0, 90.0, 120.0}) {
      const ImageSize size{800, 600};
      const Lens plain = simulated_lens(name, fov, size, false, 3).value();
      const auto left = unproject(plain, {-0.5, 299.5}), right = unproject(plain, {799.5, 299.5});
      ASSERT_TRUE(left && right) << name;
      EXPECT_NEAR(angle_deg(*left, *right), fov, 1e-6) << name;
      const Lens lens = simulated_lens(name, fov, size, true, 3).value();
      const auto k = params(lens);
      const auto l = unproject(lens, {-0.5, k[3]}), r = unproject(lens, {799.5, k[3]});
      ASSERT_TRUE(l && r) << name << " " << fov;
      EXPECT_NEAR(angle_deg(*l, *r), fov, 0.02 * fov)
          << name;  // the principal point is off the middle by up to 1 %
      for (const Vec2& corner :
           {Vec2(-0.5, -0.5), Vec2(799.5, -0.5), Vec2(799.5, 599.5), Vec2(-0.5, 599.5)}) {
        EXPECT_TRUE(unproject(lens, corner)) << name << " " << fov;
      }
      EXPECT_NE(k[0], k[1]);
    }
  }
  const Lens wide = simulated_lens("kb4", 200, {800, 800}, true, 0).value();
  const auto edge = unproject(wide, {0, params(wide)[3]});
  ASSERT_TRUE(edge);
  EXPECT_LT(edge->z(), 0);  // beyond 90 degrees
}

TEST(SimulatedLens, RefusesWhatALensCannotSee) {
  EXPECT_EQ(simulated_lens("opencv5", 180, {640, 480}, true, 0).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(simulated_lens("kb4", 340, {640, 480}, true, 0).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(simulated_lens("opencv5", -3, {640, 480}, true, 0).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(simulated_lens("opencv5", NAN, {640, 480}, true, 0).error().code, ErrorCode::kInvalidData);
  EXPECT_EQ(simulated_lens("nolens", 60, {640, 480}, true, 0).error().code, ErrorCode::kUnsupported);
}

TEST(Simulate, WithoutNoiseCornersAreProjections) {
  for (const TargetSpec& spec : {kChessboard, kCharuco, TargetSpec(AprilGrid{6, 6, 0.024, 0.3})}) {
    SceneOptions o;
    o.noise_px = 0, o.n_cameras = 2, o.n_views = 12;
    const Calibration truth = simulate(target_of(spec), o).value();
    ASSERT_TRUE(validate(truth.data));
    ASSERT_EQ(truth.data.views.size(), 24u);
    int n = 0;
    for (const View& view : truth.data.views) {
      const Camera& camera = truth.rig.cameras[view.cam];
      const SE3 T = truth.rig.T_cam_rig[view.cam] * *truth.T_rig_board[view.frame];
      for (const Corner& corner : view.corners) {
        const auto px = project(camera.lens, T * truth.data.targets[0].points[corner.point]);
        ASSERT_TRUE(px);
        EXPECT_LT((*px - corner.px).norm(), 1e-10);
        EXPECT_TRUE(px->x() > 0 && px->y() > 0 && px->x() < camera.size.width - 1 &&
                    px->y() < camera.size.height - 1);
        ++n;
      }
    }
    EXPECT_EQ(n, truth.stats.n_corners);
    EXPECT_GT(n, 24 * 0.6 * static_cast<double>(truth.data.targets[0].points.size()));
    EXPECT_EQ(truth.stats.rms_px, 0);
    EXPECT_NEAR(truth.rig.T_cam_rig[1].centre().x(), 0.1, 1e-12);
  }
}

TEST(Simulate, NoiseHasItsSizeAndIsWhatFitsHold) {
  SceneOptions o;
  o.noise_px = 0.3, o.n_views = 60;
  const Calibration truth = simulate(target_of(kCharuco), o).value();
  double sum = 0, x = 0;
  int n = 0;
  for (std::size_t v = 0; v < truth.data.views.size(); ++v) {
    for (std::size_t i = 0; i < truth.data.views[v].corners.size(); ++i, ++n) {
      const Vec2 r = truth.fits[v][i].residual_px;
      const Corner& corner = truth.data.views[v].corners[i];
      EXPECT_TRUE(r.isApprox(*predict(truth, truth.data.views[v], corner.point) - corner.px, 1e-9));
      sum += r.squaredNorm(), x += r.x();
    }
  }
  ASSERT_GT(n, 3000);
  // 2 n samples: the sample deviation is good to 1 / sqrt(4 n) = 0.9 %; four of those.
  EXPECT_NEAR(std::sqrt(sum / (2.0 * n)), 0.3, 0.3 * 4 / std::sqrt(4.0 * n));
  EXPECT_NEAR(x / n, 0, 4 * 0.3 / std::sqrt(n));
  EXPECT_NEAR(truth.stats.rms_px, std::sqrt(sum / n), 1e-12);
}

// Boards everywhere in the image and tilted both ways: what a calibration needs.
TEST(Simulate, ViewsCoverTheImageAndTilt) {
  SceneOptions o;
  o.n_views = 40;
  const Calibration truth = simulate(target_of(kCharuco), o).value();
  cv::Mat1i cells(3, 4, 0);
  double most_tilted = 0, least_tilted = 90;
  for (const View& view : truth.data.views) {
    for (const Corner& c : view.corners)
      ++cells(static_cast<int>(c.px.y() * 3 / 480), static_cast<int>(c.px.x() * 4 / 640));
    const double tilt =
        angle_deg(truth.T_rig_board[view.frame]->R().col(2), truth.T_rig_board[view.frame]->t());
    most_tilted = std::max(most_tilted, tilt);
    least_tilted = std::min(least_tilted, tilt);
  }
  double fewest = 0;
  cv::minMaxLoc(cells, &fewest);
  EXPECT_GT(fewest, 20);
  EXPECT_GT(most_tilted, 35);
  EXPECT_LT(least_tilted, 20);
}

TEST(Simulate, AFisheyeSeesBoardsBehindItself) {
  SceneOptions o;
  o.lens = "kb4", o.fov_deg = 220, o.size = {800, 800}, o.n_views = 60;
  const Calibration truth = simulate(target_of(AprilGrid{6, 6, 0.024, 0.3}), o).value();
  int n_behind = 0;
  for (const View& view : truth.data.views) {
    for (const Corner& c : view.corners) {
      n_behind +=
          (truth.rig.T_cam_rig[0] * *truth.T_rig_board[view.frame] * truth.data.targets[0].points[c.point])
              .z() < 0;
    }
  }
  EXPECT_GT(n_behind, 0);
}

TEST(Simulate, ChessboardsAreSeenWholeOrNotAtAll) {
  SceneOptions o;
  o.n_cameras = 3, o.baseline_m = 0.15, o.n_views = 15;
  const Calibration truth = simulate(target_of(kChessboard), o).value();
  for (const View& view : truth.data.views) {
    EXPECT_TRUE(view.corners.empty() || view.corners.size() == 54) << view.corners.size();
    EXPECT_EQ(view.corners.empty(), !view.reason.empty());
  }
}

// In the corner of a room all three boards face the camera. Behind a box corner one sees none of its points.
TEST(Simulate, ACornerOfBoardsIsSeenFromItsPrintedSide) {
  const Charuco panel{5, 5, 0.03, 0.022, "4X4_50"};
  for (const CornerKind kind : {CornerKind::kInside, CornerKind::kOutside}) {
    const Target target = target_of(corner_rig(panel, kind).value());
    EXPECT_FALSE(target.is_planar);
    SceneOptions o;
    o.n_views = 5;
    const Calibration truth = simulate(target, o).value();
    for (const View& view : truth.data.views) EXPECT_GT(view.corners.size(), 24u);
    const auto drawings = draw_target(target).value();
    const Camera camera{"cam", {640, 480}, make_lens("pinhole", ImageSize{640, 480}, 300).value()};
    // The camera looks at the corner along (1, 1, 1), from the other side.
    const Vec3 z = Vec3(1, 1, 1).normalized(), x = z.unitOrthogonal(), y = z.cross(x);
    Mat3 R;
    R << x.transpose(), y.transpose(), z.transpose();
    EXPECT_TRUE(visible_corners(target, drawings, camera, SE3(R, {0, 0, 1})).empty());
  }
}

// The sheets of a corner meet at its edges: every panel ends where the two others begin.
TEST(CornerRig, SheetsMeetAtTheEdges) {
  for (const TargetSpec& panel :
       {TargetSpec(Charuco{5, 5, 0.03, 0.022, "4X4_50"}), TargetSpec(AprilGrid{3, 3, 0.04, 0.3})}) {
    for (const CornerKind kind : {CornerKind::kInside, CornerKind::kOutside}) {
      const auto drawings = draw_target(target_of(corner_rig(panel, kind).value())).value();
      ASSERT_EQ(drawings.size(), 3u);
      for (int i = 0; i < 3; ++i) {
        const BoardDrawing& d = drawings[i];
        const Vec2 a2 = d.sheet_low(), b2 = d.sheet_high();
        const Vec3 a = d.T_target_board * Vec3(a2.x(), a2.y(), 0),
                   b = d.T_target_board * Vec3(b2.x(), b2.y(), 0);
        Eigen::AlignedBox3d box;
        box.extend(a), box.extend(b);
        const int flat = (i + 2) % 3;
        for (int axis = 0; axis < 3; ++axis) {
          const bool inside = kind == CornerKind::kInside;
          EXPECT_NEAR(box.min()[axis], axis == flat || inside ? 0 : -0.18, 1e-12);
          EXPECT_NEAR(box.max()[axis], axis == flat || !inside ? 0 : 0.18, 1e-12);
        }
        const Vec3 out = (d.y_up ? 1 : -1) * d.T_target_board.R().col(2);
        EXPECT_NEAR(out[flat], 1, 1e-12);  // the printed side
      }
    }
  }
  EXPECT_EQ(corner_rig(kChessboard, CornerKind::kInside).error().code, ErrorCode::kUnsupported);
  EXPECT_EQ(corner_rig(kCharuco, CornerKind::kInside).error().code,
            ErrorCode::kInvalidData);  // 132 markers of 50
}

TEST(Simulate, SameSeedSameBytesAndAnotherSeedOthers) {
  SceneOptions o;
  o.n_cameras = 2;
  const auto bytes = [&] {
    const Calibration truth = simulate(target_of(kCharuco), o).value();
    return format_corners(truth.data) + format_calibration(truth);
  };
  const std::string first = bytes();
  EXPECT_EQ(first, bytes());
  o.seed = 1;
  EXPECT_NE(first, bytes());
}

TEST(Simulate, FreePointsAndAGivenLensWork) {
  Points3d points;
  Rng rng(3);
  for (int i = 0; i < 60; ++i)
    points.points_m.emplace_back(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1));
  SceneOptions o;
  o.exact_lens = make_lens("opencv4", std::vector<double>{600, 601, 320, 240, -0.2, 0.05, 0.001, 0}).value();
  o.n_cameras = 2, o.n_views = 4;
  const Calibration truth = simulate(target_of(points), o).value();
  EXPECT_GT(truth.stats.n_corners, 8 * 30);
  EXPECT_EQ(params(truth.rig.cameras[1].lens)[4], -0.2);
}

TEST(Simulate, OptionsThatMakeNoSenseAreNamed) {
  const Target target = target_of(kChessboard);
  const auto refused = [&](auto change, const std::string& word) {
    SceneOptions o;
    change(o);
    const auto result = simulate(target, o);
    ASSERT_FALSE(result) << word;
    EXPECT_NE(result.error().text().find(word), std::string::npos) << result.error().text();
  };
  refused([](SceneOptions& o) { o.n_views = 0; }, "0 views");
  refused([](SceneOptions& o) { o.n_cameras = -1; }, "-1 cameras");
  refused([](SceneOptions& o) { o.size = {0, 480}; }, "0x480");
  refused([](SceneOptions& o) { o.noise_px = -1; }, "noise");
  refused([](SceneOptions& o) { o.n_cameras = 2, o.baseline_m = 0; }, "baseline");
  refused([](SceneOptions& o) { o.n_cameras = 2, o.baseline_m = NAN; }, "baseline");
  refused([](SceneOptions& o) { o.fov_deg = 200; }, "field of view");
}

}  // namespace
}  // namespace plumbline

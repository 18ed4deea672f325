// SPDX-License-Identifier: Apache-2.0
// Every kind of target is printed and rendered, and found again by our own detectors: the points that are
// there, under their own ids, where they are.
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "plumbline/detect/detect.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/synth/corner.hpp"
#include "plumbline/synth/print.hpp"
#include "plumbline/synth/scene.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {

struct Kind {
  std::string name;
  TargetSpec spec;
  // In views by a camera, of each image: the least share of the true corners, the worst error, the RMS of
  // all.
  double min_found = 0.75, worst_px = 0.25, rms_px = 0.1;
};

// Circle centres are seen as the centres of ellipses, which are not the images of the circles' centres: with
// a diameter of a third of the spacing the difference stays below 0.05 px in these views.
std::vector<Kind> kinds() {
  const Charuco charuco{7, 5, 0.03, 0.022, "4X4_50"};
  Charuco even{7, 6, 0.028, 0.021, "5X5_100", 3, Charuco::Layout::kAuto}, legacy = even;
  legacy.layout = Charuco::Layout::kLegacy;
  return {
      {"chessboard", Chessboard{9, 6, 0.025}},
      // In view 000 13 of 20 corners are told, none wrongly; what leaves out the other seven is not known.
      {"charuco", charuco, 0.6},
      {"charuco_even_rows", even},
      {"charuco_legacy", legacy},
      {"aprilgrid", AprilGrid{4, 3, 0.04, 0.3}},
      {"circles", Circles{9, 7, 0.025, 0.009}},
      {"acircles", Circles{4, 11, 0.02, 0.012, true}},
      {"corner_charuco", corner_rig(Charuco{5, 5, 0.03, 0.022, "4X4_50"}, CornerKind::kInside).value()},
      // A face that is seen at more than some 70 degrees has gaps of a few pixels: its corners are left out,
      // and of those that are left the worst is off by 0.27 px (AprilGrid);
      // with markers 3 px from a ChArUco corner the window still sees them, and the worst is off by 1.1 px.
      {"corner_charuco_outside",
       corner_rig(Charuco{5, 5, 0.03, 0.022, "4X4_50"}, CornerKind::kOutside).value(), 0.5, 1.2, 0.25},
      {"corner_aprilgrid", corner_rig(AprilGrid{3, 3, 0.04, 0.3}, CornerKind::kOutside).value(), 0.5, 0.3}};
}

std::ostream& operator<<(std::ostream& out, const Kind& kind) { return out << kind.name; }

class Detector : public testing::TestWithParam<Kind> {};

// Corners against the truth: how many of the true ones were found, and the worst error of those.
struct Score {
  std::size_t n_found = 0, n_true = 0;
  double worst_px = 0, rms_px = 0;
  int wrong_id = 0;  // found where the truth has nothing, or farther than 2 px away
};

Score score(const Detection& found, const std::vector<Corner>& truth) {
  Score s;
  s.n_true = truth.size();
  for (const Corner& corner : found.corners) {
    const auto at =
        std::find_if(truth.begin(), truth.end(), [&](const Corner& t) { return t.point == corner.point; });
    const double error = at == truth.end() ? 1e9 : (at->px - corner.px).norm();
    if (error > 2) {
      ++s.wrong_id;
      continue;
    }
    ++s.n_found;
    s.worst_px = std::max(s.worst_px, error);
    s.rms_px += error * error;
  }
  s.rms_px = std::sqrt(s.rms_px / std::max<std::size_t>(1, s.n_found));
  return s;
}

TEST_P(Detector, FindsARenderedBoard) {
  const Target target = make_target(GetParam().spec).value();
  SceneOptions o;
  o.size = {1280, 960}, o.fov_deg = 75, o.n_views = 5, o.noise_px = 0, o.seed = 11;
  const Calibration truth = simulate(target, o).value();
  const auto drawings = draw_target(target).value();
  const CameraRays rays = camera_rays(truth.rig.cameras[0].lens, o.size);
  double sum = 0;
  int n_seen = 0;
  for (const View& view : truth.data.views) {
    RenderOptions look;
    look.blur_sigma_px = 0.6, look.noise_grey = 1.5, look.texture_grey = 20, look.vignetting = 0.2;
    look.seed = static_cast<std::uint64_t>(view.frame);
    const auto found = detect_target(render(drawings, rays, *truth.T_rig_board[view.frame], look), target);
    ASSERT_TRUE(found) << found.error().text();
    // Detectors may report corners within 2 px of the image's edge, which the simulation leaves out.
    Detection inside = *found;
    std::erase_if(inside.corners, [&](const Corner& c) {
      return (c.px.array() < 3).any() || c.px.x() > o.size.width - 4 || c.px.y() > o.size.height - 4;
    });
    const Score s = score(inside, view.corners);
    EXPECT_EQ(s.wrong_id, 0) << view.image << " " << found->reason;
    // Tags that the image's edge cuts have corners in the image and cannot be read: two of ten in one view
    // here.
    EXPECT_GE(static_cast<double>(s.n_found), GetParam().min_found * static_cast<double>(s.n_true))
        << view.image << " " << found->reason;
    EXPECT_LT(s.worst_px, GetParam().worst_px) << view.image;
    sum += s.rms_px * s.rms_px * static_cast<double>(s.n_found);
    n_seen += static_cast<int>(s.n_found);
  }
  EXPECT_LT(std::sqrt(sum / n_seen), GetParam().rms_px);
  RecordProperty("rms_px", std::to_string(std::sqrt(sum / n_seen)));
}

// Where a print of that resolution has the target's points.
std::vector<Corner> printed_corners(const Target& target, const Print& print, int dpi) {
  const BoardDrawing d = draw_target(target)->at(0);
  std::vector<Corner> truth;
  for (std::size_t i = 0; i < target.points.size(); ++i) {
    Vec2 mm = 1e3 * (target.points[i].head<2>() - 0.5 * (d.low + d.high));
    if (d.y_up) mm.y() = -mm.y();
    // The page's corner is the pixel's corner, (-0.5, -0.5).
    truth.push_back(
        {static_cast<int>(i), (0.5 * print.page_mm + mm) * dpi / 25.4 - Vec2::Constant(0.5), 1.0});
  }
  return truth;
}

// The PNG that `target print` writes, as a scanner would give it back: corners are where the page has them.
TEST_P(Detector, FindsAPrint) {
  const Target target = make_target(GetParam().spec).value();
  if (std::holds_alternative<BoardRig>(target.spec))
    return;  // its parts are printed apart, not in their poses
  const int dpi = 80;
  const Print print = print_target(target, {PrintFormat::kPng, "auto", dpi}).value();
  cv::Mat image =
      cv::imdecode(std::vector<unsigned char>(print.bytes.begin(), print.bytes.end()), cv::IMREAD_GRAYSCALE);
  cv::GaussianBlur(image, image, {5, 5}, 0.7);  // no scanner is as sharp as the print itself
  const auto found = detect_target(image, target);
  ASSERT_TRUE(found) << found.error().text();
  const std::vector<Corner> truth = printed_corners(target, print, dpi);
  const Score s = score(*found, truth);
  EXPECT_EQ(s.n_found, truth.size()) << found->reason;
  EXPECT_EQ(s.wrong_id, 0);
  EXPECT_LT(s.worst_px, 0.1);
}

// A legacy board without its last column is a current board shifted by one column: such an image cannot tell.
// Another one of the run can.
TEST(DetectorLayout, IsOneForAllImagesOfARun) {
  Charuco board{7, 6, 0.028, 0.021, "5X5_100", 3, Charuco::Layout::kLegacy};
  const Target printed = make_target(board).value();
  board.layout = Charuco::Layout::kAuto;
  const Target open = make_target(board).value();
  const int dpi = 80;
  const Print print = print_target(printed, {PrintFormat::kPng, "auto", dpi}).value();
  cv::Mat whole =
      cv::imdecode(std::vector<unsigned char>(print.bytes.begin(), print.bytes.end()), cv::IMREAD_GRAYSCALE);
  cv::GaussianBlur(whole, whole, {5, 5}, 0.7);
  std::vector<Corner> truth = printed_corners(printed, print, dpi);
  cv::Mat cut = whole.clone();
  cut.colRange(static_cast<int>(0.5 * (truth[4].px.x() + truth[5].px.x())), cut.cols).setTo(255);
  const auto alone = detect_target(cut, open);
  ASSERT_TRUE(alone);
  EXPECT_EQ(alone->layout_vote, 0);
  EXPECT_EQ(score(*alone, truth).n_found, 0U) << "the image tells the layout, so it tests nothing";

  const test::TempDir dir;
  cv::imwrite(dir / "whole.png", whole);
  cv::imwrite(dir / "cut.png", cut);
  const CameraImages a{"a", {dir / "cut.png"}, {"cut.png"}, {"cut"}};
  const CameraImages b{"b", {dir / "whole.png"}, {"whole.png"}, {"whole"}};
  const auto both = detect_dataset({a, b}, open);
  ASSERT_TRUE(both) << both.error().text();
  EXPECT_NE(both->detector.find("layout legacy"), std::string::npos) << both->detector;
  EXPECT_EQ(both->detector.find("layout current"), std::string::npos) << both->detector;
  for (const View& view : both->views) {
    const Score s = score({view.corners, "", "", 0}, truth);
    EXPECT_EQ(s.wrong_id, 0) << view.image;
    EXPECT_GE(s.n_found, view.image == "cut.png" ? 15U : 30U) << view.image;
  }
  const auto one = detect_dataset({a}, open);
  ASSERT_TRUE(one) << one.error().text();
  EXPECT_NE(one->detector.find("layout current"), std::string::npos) << one->detector;
  EXPECT_NE(one->detector.find("no image tells"), std::string::npos) << one->detector;
}

INSTANTIATE_TEST_SUITE_P(Targets, Detector, testing::ValuesIn(kinds()),
                         [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace plumbline

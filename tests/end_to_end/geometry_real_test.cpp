// SPDX-License-Identifier: Apache-2.0
// Photographs of real rigs: what `plumbline geometry` finds from their pixels alone agrees with the
// calibrated rig.
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "end_to_end/geometry_files.hpp"
#include "plumbline/core/linalg.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/io/calibration_io.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using test::Json;
using test::mat3_of;
using test::vec3_of;

constexpr double kDegPerRad = 180 / std::numbers::pi;

// A rig of two cameras, the photographs of a chessboard that calibrate it, and how well boards come out flat.
struct Pair {
  std::string name, left, right, corners, lens;
  double flat;  // root mean square distance of a board's points from its plane, over the board's diagonal
};

void PrintTo(const Pair& pair, std::ostream* out) { *out << pair.name; }

const std::string kBoof = "boofcv_calibration",
                  kJy = "opencv_extra/cameracalibration/fisheye/calib-3_stereo_from_JY";

// Depth is uncertain by Z^2 / (f b) sigma sqrt(2): with sigma 0.15 px, and boards at five to ten baselines
// that measure three baselines or more, some 0.3 % of the diagonal. Three times that is asked for. The boards
// are those that calibrated the rig: this holds triangulation, not the calibration, to them.
std::vector<Pair> pairs() {
  return {
      {"demo", "opencv_leftright/left*.jpg", "opencv_leftright/right*.jpg", "9x6", "opencv5", 0.01},
      {"bumblebee", kBoof + "/stereo/Bumblebee2_Chess/left*.jpg",
       kBoof + "/stereo/Bumblebee2_Chess/right*.jpg", "4x6", "opencv5", 0.01},
      {"fisheye", kJy + "/left/stereo_pair_00*.jpg", kJy + "/right/stereo_pair_00*.jpg", "8x6", "kb4", 0.01},
      {"stereopi", "stereopi_fisheye/pairs/left_*.png", "stereopi_fisheye/pairs/right_*.png", "9x6", "kb4",
       0.01},
      {"trinocular", kBoof + "/trinocular/left/left?.jpg", kBoof + "/trinocular/middle/middle?.jpg", "13x9",
       "opencv5", 0.01}};
}

// Calibrated once for all tests of a rig.
struct Calibrated {
  test::TempDir dir;
  Calibration calibration;
  std::string camera;
};

std::shared_ptr<Calibrated> calibrated(const Pair& pair) {
  static std::map<std::string, std::shared_ptr<Calibrated>> done;
  auto& out = done[pair.name];
  const auto data = test::data_dir("");
  if (out || !data) return out;
  auto made = std::make_shared<Calibrated>();
  test::write_text(made->dir / "board.yaml",
                   "type: chessboard\ncorners: [" + pair.corners.substr(0, pair.corners.find('x')) + ", " +
                       pair.corners.substr(pair.corners.find('x') + 1) + "]\nsquare_m: 0.025\n");
  const test::Run run = test::plumbline("calibrate --target " + (made->dir / "board.yaml").string() +
                                        " --cam 'left=" + (*data / pair.left).string() +
                                        "' --cam 'right=" + (*data / pair.right).string() + "' --lens " +
                                        pair.lens + " -o " + (made->dir / "rig").string());
  if (run.exit_code != 0) ADD_FAILURE() << run.err;
  if (run.exit_code != 0) return nullptr;
  made->camera = (made->dir / "rig/calibration.yaml").string();
  made->calibration = parse_calibration(test::read_text(made->camera)).value();
  return out = made;
}

// A board corner seen by both cameras.
struct Match {
  int frame, point;
  Vec2 px1, px2;
};

std::vector<Match> board_matches(const Calibration& c) {
  std::map<std::pair<int, int>, Vec2> left;
  std::vector<Match> out;
  for (const int cam : {0, 1}) {
    for (std::size_t v = 0; v < c.data.views.size(); ++v) {
      const View& view = c.data.views[v];
      if (view.cam != cam || c.fits[v].size() != view.corners.size()) continue;
      for (std::size_t i = 0; i < view.corners.size(); ++i) {
        const Corner& corner = view.corners[i];
        if (c.fits[v][i].outlier) continue;
        const std::pair key{view.frame, corner.point};
        if (cam == 0)
          left[key] = corner.px;
        else if (left.count(key))
          out.push_back({view.frame, corner.point, left[key], corner.px});
      }
    }
  }
  return out;
}

std::string csv_of(const std::vector<Match>& matches) {
  std::string text = "u1,v1,u2,v2\n";
  for (const Match& m : matches)
    text += fmt::format("{:.17g},{:.17g},{:.17g},{:.17g}\n", m.px1.x(), m.px1.y(), m.px2.x(), m.px2.y());
  return text;
}

Json answer(const std::string& arguments) {
  const test::Run run = test::plumbline("geometry " + arguments + " --json");
  EXPECT_EQ(run.exit_code, 0) << arguments << "\n" << run.err;
  return run.exit_code == 0 ? Json::parse(run.out) : Json();
}

struct Disagreement {
  double rotation_deg, direction_deg;
};

Disagreement between(const Json& essential, const SE3& T_2_1) {
  const Mat3 R = mat3_of(essential["R"]);
  const Vec3 t = vec3_of(essential["t"]), truth = T_2_1.t().normalized();
  return {rotation_angle(R * T_2_1.R().transpose()) * kDegPerRad,
          std::atan2(t.cross(truth).norm(), t.dot(truth)) * kDegPerRad};
}

class RealPair : public ::testing::TestWithParam<Pair> {
 protected:
  void SetUp() override {
    PLUMBLINE_NEEDS(test::data_dir(GetParam().left.substr(0, GetParam().left.find('/'))));
    rig = calibrated(GetParam());
    ASSERT_TRUE(rig);
    matches = board_matches(rig->calibration);
    ASSERT_GT(matches.size(), 200u);
    csv = (rig->dir / "matches.csv").string();
    test::write_text(csv, csv_of(matches));
  }
  std::shared_ptr<Calibrated> rig;
  std::vector<Match> matches;
  std::string csv;
};

TEST_P(RealPair, EssentialMatrixAgreesWithTheRig) {
  for (const std::string more : {"", " --ransac --inlier-px 1"}) {
    const Json e = answer("essential --points " + csv + " --camera " + rig->camera + more);
    const Disagreement d = between(e, rig->calibration.rig.T_cam_rig[1]);
    EXPECT_LT(d.rotation_deg, 0.2) << more;
    EXPECT_LT(d.direction_deg, 1.0) << more;
    RecordProperty("rotation_deg" + more, fmt::format("{:.4f}", d.rotation_deg));
    fmt::print("{}{}: {} corners, rotation {:.4f} deg, baseline {:.4f} deg from the rig's\n", GetParam().name,
               more, matches.size(), d.rotation_deg, d.direction_deg);
  }
}

TEST_P(RealPair, TriangulatedBoardsAreFlatAndSquare) {
  const Json all = answer("triangulate --points " + csv + " --camera " + rig->camera);
  const auto [columns, rows] = [&] {
    const auto& board = std::get<Chessboard>(rig->calibration.data.targets[0].spec);
    return std::pair{board.columns, board.rows};
  }();
  const double diagonal = 0.025 * std::hypot(columns - 1, rows - 1);
  double worst_flat = 0, across = 0, down = 0;
  int n_across = 0, n_down = 0, n_boards = 0;
  std::map<int, std::map<int, Vec3>> boards;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!all["points"][i].is_null()) boards[matches[i].frame][matches[i].point] = vec3_of(all["points"][i]);
  }
  for (const auto& [frame, points] : boards) {
    if (static_cast<int>(points.size()) < columns * rows / 2) continue;
    ++n_boards;
    Vec3 mean = Vec3::Zero();
    for (const auto& [i, p] : points) mean += p / static_cast<double>(points.size());
    MatX scatter = MatX::Zero(3, 3);
    for (const auto& [i, p] : points) {
      scatter += (p - mean) * (p - mean).transpose();
      const auto right = points.find(i + 1), below = points.find(i + columns);
      if (right != points.end() && (i + 1) % columns != 0) {
        across += (right->second - p).norm();
        ++n_across;
      }
      if (below != points.end()) {
        down += (below->second - p).norm();
        ++n_down;
      }
    }
    const double off =
        std::sqrt(std::max(0.0, sym_eigen(scatter).values[0]) / static_cast<double>(points.size()));
    worst_flat = std::max(worst_flat, off / diagonal);
  }
  EXPECT_GT(n_boards, 3);
  EXPECT_EQ(all["n_points"], matches.size());
  EXPECT_LT(worst_flat, GetParam().flat);
  across /= n_across;
  down /= n_down;
  // Averages over hundreds of squares: half a percent is what the boards' print and paper may be off by.
  EXPECT_NEAR(across / down, 1, 0.005);
  EXPECT_NEAR(across / 0.025, 1, 0.01);
  fmt::print(
      "{}: {} boards, off their planes by {:.2f} % of their diagonal at most; squares {:.3f} x {:.3f} mm\n",
      GetParam().name, n_boards, 100 * worst_flat, 1000 * across, 1000 * down);
}

INSTANTIATE_TEST_SUITE_P(All, RealPair, ::testing::ValuesIn(pairs()),
                         [](const auto& info) { return info.param.name; });

// SIFT features of two images that pass Lowe's ratio test.
std::vector<Match> features(const fs::path& left, const fs::path& right) {
  const cv::Mat a = cv::imread(left.string(), cv::IMREAD_GRAYSCALE),
                b = cv::imread(right.string(), cv::IMREAD_GRAYSCALE);
  const auto sift = cv::SIFT::create(2000);
  std::vector<cv::KeyPoint> points_a, points_b;
  cv::Mat words_a, words_b;
  sift->detectAndCompute(a, {}, points_a, words_a);
  sift->detectAndCompute(b, {}, points_b, words_b);
  std::vector<std::vector<cv::DMatch>> nearest;
  cv::BFMatcher(cv::NORM_L2).knnMatch(words_a, words_b, nearest, 2);
  std::vector<Match> out;
  for (const auto& two : nearest) {
    if (two.size() < 2 || two[0].distance > 0.75F * two[1].distance) continue;
    const cv::Point2f p = points_a[two[0].queryIdx].pt, q = points_b[two[0].trainIdx].pt;
    out.push_back({0, 0, Vec2(p.x, p.y), Vec2(q.x, q.y)});
  }
  return out;
}

const std::vector<std::string> kScenes{"chair01", "chair02", "garden01", "garden02", "lantern01"};

// Matched features of the scenes that the bumblebee rig photographed.
class RealScenes : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto data = test::data_dir("boofcv_stereo");
    PLUMBLINE_NEEDS(data);
    rig = calibrated(pairs()[1]);
    ASSERT_TRUE(rig);
    for (const std::string& scene : kScenes) {
      if (!found.count(scene))
        found[scene] =
            features(*data / "stereo" / (scene + "_left.jpg"), *data / "stereo" / (scene + "_right.jpg"));
    }
  }
  std::string write(const std::string& name, const std::vector<Match>& matches) {
    test::write_text(rig->dir / name, csv_of(matches));
    return (rig->dir / name).string();
  }
  std::shared_ptr<Calibrated> rig;
  static inline std::map<std::string, std::vector<Match>> found;
};

TEST_F(RealScenes, FeaturesOfAllScenesAgreeWithTheRig) {
  std::vector<Match> all;
  for (const auto& [scene, matches] : found) all.insert(all.end(), matches.begin(), matches.end());
  const std::string csv = write("scenes.csv", all);
  const Json e = answer("essential --ransac --inlier-px 1 --points " + csv + " --camera " + rig->camera);
  const Disagreement d = between(e, rig->calibration.rig.T_cam_rig[1]);
  fmt::print("scenes: {} of {} features, rotation {:.3f} deg, baseline {:.3f} deg from the rig's\n",
             int(e["inliers"]), all.size(), d.rotation_deg, d.direction_deg);
  EXPECT_LT(d.rotation_deg, 0.2);
  EXPECT_LT(d.direction_deg, 1.0);
  EXPECT_GT(double(e["inliers"]), 0.85 * double(all.size()));
  // One scene alone, of far gardens, speaks of the turn about the vertical by the corners of the image only,
  // where the lens of eleven small boards is not known to the half pixel that this takes (0.3 deg is 2.8 px
  // at the centre).
  for (const auto& [scene, matches] : found) {
    const Disagreement one = between(answer("essential --ransac --inlier-px 1 --points " +
                                            write(scene + ".csv", matches) + " --camera " + rig->camera),
                                     rig->calibration.rig.T_cam_rig[1]);
    fmt::print("{}: rotation {:.3f} deg, baseline {:.3f} deg\n", scene, one.rotation_deg, one.direction_deg);
    EXPECT_LT(one.rotation_deg, 0.5) << scene;
    EXPECT_LT(one.direction_deg, 2.0) << scene;
  }
}

TEST_F(RealScenes, PointsOfTheScenesLieInFront) {
  for (const auto& [scene, matches] : found) {
    const std::string csv = write(scene + ".csv", matches);
    const Json e = answer("essential --ransac --inlier-px 1 --points " + csv + " --camera " + rig->camera);
    const Json all = answer("triangulate --points " + csv + " --camera " + rig->camera);
    std::set<int> outliers(e["outliers"].begin(), e["outliers"].end());
    int n = 0, n_behind = 0, n_far = 0;
    for (int i = 0; i < static_cast<int>(matches.size()); ++i) {
      if (outliers.count(i)) continue;
      ++n;
      if (all["reasons"][i].is_null()) {
        EXPECT_GT(vec3_of(all["points"][i]).z(), 0) << scene << " " << i;
        continue;
      }
      const std::string reason = all["reasons"][i];
      n_far += reason.find("parallel") != std::string::npos;
      n_behind += reason.find("behind") != std::string::npos;
    }
    fmt::print("{}: {} points, {} too far for the baseline, {} behind\n", scene, n, n_far, n_behind);
    // With sigma 1 px rays that differ by less than some 4 px count as parallel: beyond 13 m for this rig.
    // What agrees with its epipolar line by chance may lie behind.
    EXPECT_LT(n_behind, 0.02 * n + 1) << scene;
    EXPECT_LT(n_far, 0.3 * n) << scene;
    EXPECT_GE(n_far + n_behind + int(all["n_points"]), n) << scene;
  }
}

TEST_F(RealScenes, RowsMatchWithoutACalibration) {
  for (const auto& [scene, matches] : found) {
    // Homographies are of straight lenses: the features are moved to where a pinhole shows them.
    std::vector<Match> straight;
    for (const Match& m : matches) {
      const auto &left = rig->calibration.rig.cameras[0].lens, &right = rig->calibration.rig.cameras[1].lens;
      const auto a = unproject(left, m.px1), b = unproject(right, m.px2);
      if (a && b)
        straight.push_back(
            {0, 0, (camera_matrix_k(left) * *a).hnormalized(), (camera_matrix_k(right) * *b).hnormalized()});
    }
    const Json r =
        answer("rectify --ransac --inlier-px 1 --size 640x480 --points " + write("straight.csv", straight));
    fmt::print("{}: rows match to {:.3f} px, stretches {:.4f} and {:.4f} from 1\n", scene,
               double(r["row_rms_px"]), double(r["distortion"][0]), double(r["distortion"][1]));
    // Features of 0.25 px in each coordinate: the rows of two differ by 0.35 px.
    EXPECT_LT(double(r["row_rms_px"]), 0.6) << scene;
    EXPECT_FALSE(r["vertical"]);
    // The rig's cameras look the same way to half a degree, so little is to be done, but the epipoles of far
    // features are not sure: the stretches that they ask for are of some percent, and of 1 to 14 % for
    // garden02, by which of its features count as inliers (eight seeds).
    EXPECT_LT(double(r["distortion"][0]), 0.2) << scene;
    EXPECT_LT(double(r["distortion"][1]), 0.2) << scene;
  }
}

}  // namespace
}  // namespace plumbline

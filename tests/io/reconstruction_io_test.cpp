// SPDX-License-Identifier: Apache-2.0
#include "plumbline/io/reconstruction_io.hpp"

#include <gmock/gmock.h>

#include <opencv2/calib3d.hpp>

#include "plumbline/core/random.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

using ::testing::HasSubstr;

Reconstruction example_scene() {
  Rng rng(3);
  Reconstruction scene;
  for (const char* lens : {"opencv4", "kb4"}) {
    Lens made = make_lens(lens, {640, 480}, 500.0 / 3).value();
    for (double& value : params(made).subspan(4)) value = rng.normal(0.01);
    scene.cameras.push_back({"camera" + std::to_string(3 * scene.cameras.size() + 2), {640, 480}, made});
  }
  for (int v = 0; v < 5; ++v)
    scene.views.push_back(
        {v % 2, "some folder/img " + std::to_string(v) + ".jpg",
         SE3(so3_exp(Vec3(rng.normal(), rng.normal(), rng.normal())), Vec3(rng.normal(), 0.1, 3)), 10 - v});
  for (int p = 0; p < 7; ++p) {
    scene.p_world.emplace_back(rng.normal(), rng.normal(), rng.normal());
    scene.tags.push_back({100 - 9 * p, {static_cast<std::uint8_t>(p), 0, 255}});
  }
  for (int v = 0; v < 4; ++v) {  // the last view sees nothing
    for (int p = v; p < 7; ++p)
      scene.sightings.push_back({v, p, Vec2(rng.uniform(1, 639), rng.uniform(1, 479)), 1.0});
  }
  // What COLMAP's half pixel rounds away is rounded here, so that the rest must come back to the last digit.
  for (Sighting& s : scene.sightings) s.px = (s.px.array() + 0.5) - 0.5;
  for (Camera& camera : scene.cameras)
    for (double& c : params(camera.lens).subspan(2, 2)) c = (c + 0.5) - 0.5;
  return scene;
}

void expect_same(const Reconstruction& a, const Reconstruction& b) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (std::size_t c = 0; c < a.cameras.size(); ++c) {
    EXPECT_EQ(lens_name(a.cameras[c].lens), lens_name(b.cameras[c].lens));
    EXPECT_TRUE(std::ranges::equal(params(a.cameras[c].lens), params(b.cameras[c].lens))) << c;
    EXPECT_EQ(a.cameras[c].size, b.cameras[c].size);
    EXPECT_EQ(a.cameras[c].name, b.cameras[c].name);
  }
  ASSERT_EQ(a.views.size(), b.views.size());
  for (std::size_t v = 0; v < a.views.size(); ++v) {
    EXPECT_EQ(a.views[v].T_cam_world, b.views[v].T_cam_world) << v;
    EXPECT_EQ(a.views[v].camera, b.views[v].camera);
    EXPECT_EQ(a.views[v].image, b.views[v].image);
    EXPECT_EQ(a.views[v].id, b.views[v].id);
  }
  EXPECT_EQ(a.p_world, b.p_world);
  ASSERT_EQ(a.sightings.size(), b.sightings.size());
  for (std::size_t i = 0; i < a.sightings.size(); ++i) {
    EXPECT_EQ(a.sightings[i].view, b.sightings[i].view);
    EXPECT_EQ(a.sightings[i].point, b.sightings[i].point);
    EXPECT_EQ(a.sightings[i].px, b.sightings[i].px) << i;
  }
  ASSERT_EQ(a.tags.size(), b.tags.size());
  for (std::size_t p = 0; p < a.tags.size(); ++p) {
    EXPECT_EQ(a.tags[p].id, b.tags[p].id);
    EXPECT_EQ(a.tags[p].rgb, b.tags[p].rgb);
  }
}

TEST(ColmapModel, ComesBackToTheLastDigit) {
  const Reconstruction scene = example_scene();
  ASSERT_TRUE(validate(scene));
  const auto files = format_colmap_model(scene);
  ASSERT_TRUE(files) << files.error().text();
  const auto read = parse_colmap_model(*files);
  ASSERT_TRUE(read) << read.error().text();
  expect_same(scene, *read);
  const auto again = format_colmap_model(*read);
  ASSERT_TRUE(again);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ((*again)[i].bytes, (*files)[i].bytes);
}

// As COLMAP writes it: remarks with means, key points without a scene point, ids with gaps, an empty list.
std::vector<NamedBytes> by_hand() {
  return {{"model/cameras.txt",
           "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
           "# Number of cameras: 1\n7 SIMPLE_RADIAL 640 480 500 320 240 -0.1\n"},
          {"model/images.txt",
           "# Image list with two lines of data per image:\n"
           "# Number of images: 3, mean observations per image: 1.33\n"
           "4 1 0 0 0 0.5 0 2 7 a b.jpg\n100.5 200.5 -1 320 240 63 10 20 5\n"
           "2 0.70710678 0 0.70710678 0 0 0 3 7 c.jpg\n1 2 5 3 4 63\n"
           "9 1 0 0 0 0 0 1 7 empty.jpg\n\n"},
          {"model/points3D.txt",
           "# Number of points: 2, mean track length: 2\n"
           "63 0.1 0.2 4 255 0 7 0.5 4 1 2 1\n5 1 2 3 1 2 3 -1 4 2 2 0\n"}};
}

TEST(ColmapModel, ReadsColmapsOwnShape) {
  const auto scene = parse_colmap_model(by_hand());
  ASSERT_TRUE(scene) << scene.error().text();
  ASSERT_EQ(scene->views.size(), 3u);
  EXPECT_EQ(scene->views[0].image, "a b.jpg");
  EXPECT_EQ(scene->views[0].id, 4);
  EXPECT_EQ(scene->views[0].T_cam_world.t(), Vec3(0.5, 0, 2));
  // A quaternion of eight digits is made a unit one.
  EXPECT_NEAR(scene->views[1].T_cam_world.qt[0], std::sqrt(0.5), 1e-15);
  EXPECT_EQ(scene->cameras[0].name, "camera7");
  // COLMAP's (0.5, 0.5) is the centre of the first pixel, ours (0, 0).
  EXPECT_EQ(params(scene->cameras[0].lens)[2], 319.5);
  ASSERT_EQ(scene->sightings.size(), 4u);
  EXPECT_EQ(scene->sightings[0].px, Vec2(319.5, 239.5));
  EXPECT_EQ(scene->sightings[0].point, 0);
  EXPECT_EQ(scene->sightings[1].point, 1);
  EXPECT_EQ(scene->tags[0].id, 63);
  EXPECT_EQ(scene->tags[1].rgb, (std::array<std::uint8_t, 3>{1, 2, 3}));
  EXPECT_EQ(point_name(*scene, 0), "point 0 (id 63)");
  EXPECT_TRUE(validate(*scene));
}

TEST(ColmapModel, FaultsAreNamedWithTheirLine) {
  struct Case {
    int file;
    std::string from, to, words;
  };
  for (const Case& c : std::vector<Case>{
           {0, "7 SIMPLE_RADIAL", "x SIMPLE_RADIAL", "ids of cameras"},
           {1, "4 1 0 0 0", "4 2 0 0 0", "images.txt: line 3: a unit quaternion is needed, its length is 2"},
           {1, "0.5 0 2 7 a", "0.5 0 2 8 a", "line 3: camera '8' is not in cameras.txt"},
           {1, "2 0.70710678", "4 0.70710678", "line 5: an id that no other image has"},
           {1, "100.5", "nan", "line 4: a pixel is needed, not 'nan 200.5'"},
           {1, "10 20 5", "10 20 6", "line 4: point 6 is not in points3D.txt"},
           {1, "10 20 5", "10 20", "line 4: POINTS2D[]"},
           {1, "10 20 5", "10 20 -1", "points3D.txt: line 3: image '4' has no point '2'"},
           {2, " 4 2 2 0\n", " 4 2\n", "its tracks name 3 points of images, images.txt has 4"},
           {1, "images: 3,", "images: 4,", "cut off"},
           {2, "0.5 4 1 2 1", "0.5 4 1 2 7", "points3D.txt: line 2: image '2' has no point '7'"},
           {2, "0.5 4 1 2 1", "0.5 4 1 99 1", "line 2: image '99' has no point '1'"},
           {2, "0.5 4 1 2 1", "0.5 4 1", "3 points of images, images.txt has 4"},
           {2, "63 0.1", "63 inf", "line 2: a finite coordinate is needed, not 'inf'"},
           {2, "255 0 7", "256 0 7", "a colour from 0 to 255"},
           {2, "\n5 1 2 3", "\n63 1 2 3", "line 3: an id that no other point has"},
           {2, "points: 2,", "points: 2000000000,", "cut off"},
       }) {
    auto files = by_hand();
    std::string& text = files[static_cast<std::size_t>(c.file)].bytes;
    ASSERT_NE(text.find(c.from), std::string::npos) << c.from;
    text.replace(text.find(c.from), c.from.size(), c.to);
    const auto scene = parse_colmap_model(files);
    ASSERT_FALSE(scene) << c.to;
    EXPECT_EQ(scene.error().code, ErrorCode::kParse) << scene.error().text();
    EXPECT_THAT(scene.error().text(), HasSubstr(c.words));
  }
  auto two = by_hand();
  two.pop_back();
  EXPECT_THAT(parse_colmap_model(two).error().text(), HasSubstr("there is no points3D.txt"));
}

TEST(ColmapModel, CutOffOrChangedAnywhereItDoesNotCrashOrPass) {
  const auto files = format_colmap_model(example_scene()).value();
  for (std::size_t f = 0; f < 3; ++f) {
    for (std::size_t n = 0; n + 1 < files[f].bytes.size(); ++n) {
      auto cut = files;
      cut[f].bytes.resize(n);
      EXPECT_FALSE(parse_colmap_model(cut)) << files[f].name << " cut at " << n;
    }
    for (std::size_t i = 0; i < files[f].bytes.size(); i += 3) {
      for (char c : {'\0', '\xff', '-', '9', '\n', ' ', '#'}) {
        auto changed = files;
        changed[f].bytes[i] = c;
        const auto scene = parse_colmap_model(changed);
        if (scene) EXPECT_TRUE(validate(*scene)) << files[f].name << " at " << i;
      }
    }
  }
}

TEST(ColmapModel, SaysWhatItCannotHold) {
  Reconstruction scene = example_scene();
  scene.cameras[0].size = {};
  EXPECT_THAT(format_colmap_model(scene).error().text(),
              HasSubstr("camera camera2: COLMAP's model needs the size"));
  scene = example_scene();
  scene.cameras[0].lens = make_lens("opencv12", {640, 480}, 500).value();
  params(scene.cameras[0].lens)[13] = 0.1;
  EXPECT_EQ(format_colmap_model(scene).error().code, ErrorCode::kUnsupported);
  scene = example_scene();
  scene.views[1].image = "a\nb";
  EXPECT_THAT(format_colmap_model(scene).error().text(), HasSubstr("view 1"));
  // Ids that are there twice, and none at all: counted anew.
  scene = example_scene();
  scene.views[0].id = scene.views[1].id;
  scene.tags.clear();
  const auto read = parse_colmap_model(format_colmap_model(scene).value()).value();
  EXPECT_EQ(read.views[4].id, 5);
  EXPECT_EQ(read.tags[6].id, 7);
}

// --- BAL ---

struct BalCamera {
  Vec3 w, t;
  double f, k1, k2;
};

// As its authors define it, with OpenCV's Rodrigues: P = R X + t, p = -P / P.z, p' = f (1 + k1 |p|^2 + k2
// |p|^4) p.
Vec2 project_by_definition(const BalCamera& c, const Vec3& X) {
  cv::Matx33d R;
  cv::Rodrigues(cv::Vec3d(c.w.x(), c.w.y(), c.w.z()), R);
  const cv::Vec3d P = R * cv::Vec3d(X.x(), X.y(), X.z()) + cv::Vec3d(c.t.x(), c.t.y(), c.t.z());
  const double x = -P[0] / P[2], y = -P[1] / P[2], s = x * x + y * y;
  const double r = 1 + c.k1 * s + c.k2 * s * s;
  return {c.f * r * x, c.f * r * y};
}

struct BalProblem {
  std::vector<BalCamera> cameras;
  std::vector<Vec3> points;
  std::string text;
};

BalProblem bal_problem() {
  Rng rng(11);
  BalProblem b;
  std::string tail;
  for (int c = 0; c < 4; ++c) {
    b.cameras.push_back({Vec3(rng.normal(0.3), rng.normal(0.3), rng.normal(0.3)),
                         Vec3(rng.normal(0.3), rng.normal(0.3), -5), 400.0 + c, -0.05, 0.01});
    const BalCamera& k = b.cameras.back();
    for (double value : {k.w.x(), k.w.y(), k.w.z(), k.t.x(), k.t.y(), k.t.z(), k.f, k.k1, k.k2})
      tail += format_double(value) + "\n";
  }
  for (int p = 0; p < 9; ++p) {
    b.points.emplace_back(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1));
    for (double value : b.points.back()) tail += format_double(value) + "\n";
  }
  b.text = "4 9 36\n";
  for (int p = 0; p < 9; ++p) {
    for (int c = 0; c < 4; ++c) {
      const Vec2 px = project_by_definition(b.cameras[c], b.points[p]);
      b.text += std::to_string(c) + " " + std::to_string(p) + "     " + format_double(px.x()) + " " +
                format_double(px.y()) + "\n";
    }
  }
  b.text += tail;
  return b;
}

TEST(Bal, ProjectsAsItsAuthorsDefineIt) {
  const BalProblem b = bal_problem();
  const auto scene = parse_bal(b.text);
  ASSERT_TRUE(scene) << scene.error().text();
  EXPECT_TRUE(validate(*scene));
  EXPECT_TRUE(looks_like_bal(b.text));
  ASSERT_EQ(scene->sightings.size(), 36u);
  for (const Sighting& s : scene->sightings) {
    const Vec2 px = project_by_definition(b.cameras[s.view], b.points[s.point]);
    EXPECT_EQ(s.px, Vec2(px.x(), -px.y()));
    const auto ours = predict(*scene, s);
    ASSERT_TRUE(ours);
    EXPECT_LT((*ours - s.px).norm(), 1e-11);  // rounding at 500 px
  }
}

TEST(Bal, ComesBack) {
  const auto scene = parse_bal(bal_problem().text).value();
  const auto text = format_bal(scene);
  ASSERT_TRUE(text) << text.error().text();
  const auto again = parse_bal(*text);
  ASSERT_TRUE(again) << again.error().text();
  EXPECT_EQ(again->p_world, scene.p_world);
  for (std::size_t i = 0; i < scene.sightings.size(); ++i)
    EXPECT_EQ(again->sightings[i].px, scene.sightings[i].px);
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    EXPECT_TRUE(std::ranges::equal(params(again->cameras[v].lens), params(scene.cameras[v].lens)));
    EXPECT_LT(box_minus(again->views[v].T_cam_world, scene.views[v].T_cam_world).norm(), 1e-14);
  }
  // A camera with its principal point elsewhere, and two views of one camera.
  Reconstruction shared = scene;
  shared.views[1].camera = 0;
  params(shared.cameras[0].lens)[2] = 320;
  params(shared.cameras[0].lens)[3] = 240;
  for (Sighting& s : shared.sightings) s.px = *predict(shared, s);
  const auto moved = parse_bal(format_bal(shared).value()).value();
  for (const Sighting& s : moved.sightings) EXPECT_LT((*predict(moved, s) - s.px).norm(), 1e-11);

  Reconstruction bad = scene;
  params(bad.cameras[2].lens)[1] += 1;
  EXPECT_THAT(format_bal(bad).error().text(),
              HasSubstr("camera camera3: BAL problems have one focal length"));
  bad = scene;
  params(bad.cameras[2].lens)[6] = 1e-3;
  EXPECT_THAT(format_bal(bad).error().text(), HasSubstr("lens opencv4 of this camera has more"));
}

TEST(Bal, FaultsAreNamedWithTheirLine) {
  const std::string text = bal_problem().text;
  const auto refuse = [](const std::string& bad, const std::string& words) {
    const auto scene = parse_bal(bad);
    ASSERT_FALSE(scene) << words;
    EXPECT_EQ(scene.error().code, ErrorCode::kParse);
    EXPECT_THAT(scene.error().text(), HasSubstr(words));
  };
  const auto with_first_line = [&](const std::string& line) { return line + text.substr(text.find('\n')); };
  refuse("", "line 1: a number of cameras");
  refuse(with_first_line("4 9 1999999999"), "do not fit into a file of");
  refuse(with_first_line("4 9 99999999999"), "line 1: a number of observations");
  refuse(with_first_line("4 9 -1"), "not '-1'");
  refuse(with_first_line("3 9 36"), "line 5: a camera from 0 to 2 is needed, not '3'");
  refuse(with_first_line("4 8 36"), "line 34: a point from 0 to 7 is needed, not '8'");
  refuse(with_first_line("0 0 0"), "there is no camera in it");
  refuse(with_first_line("4 9 35"), "line 42: fx of lens opencv4 is -0.02");  // one word early, all are
  refuse(text + "5\n", "more than the first line says: '5'");
  std::string bad = text;
  bad.replace(bad.find("     "), 7, " nan ");
  refuse(bad, "line 2: a finite number is needed");
  for (std::size_t n = 0; n + 1 < text.size(); ++n) EXPECT_FALSE(parse_bal(text.substr(0, n))) << n;
  for (std::size_t i = 0; i < text.size(); i += 3) {
    for (char c : {'\0', '\xff', '-', '9', '\n', ' '}) {
      std::string changed = text;
      changed[i] = c;
      const auto scene = parse_bal(changed);
      if (scene) EXPECT_TRUE(validate(*scene)) << i;
    }
  }
  EXPECT_FALSE(looks_like_bal("# Camera list\n1 PINHOLE 640 480 1 1 1 1\n"));
}

}  // namespace
}  // namespace plumbline::test

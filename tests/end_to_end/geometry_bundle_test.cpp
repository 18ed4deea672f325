// SPDX-License-Identifier: Apache-2.0
// plumbline geometry bundle, from the files of other software to files of other software.
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "plumbline/core/random.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/io/reconstruction_io.hpp"
#include "support/support.hpp"

namespace plumbline::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

Reconstruction make_truth(const std::string& lens) {
  Rng rng(2);
  Reconstruction scene;
  Lens made = make_lens(lens, {640, 480}, 500).value();
  params(made)[2] = params(made)[3] = 0;  // BAL has its origin there
  params(made)[4] = -0.05;
  for (int v = 0; v < 6; ++v) {
    if (v == 0 || lens == "opencv4")
      scene.cameras.push_back({"camera" + std::to_string(v + 1), {640, 480}, made});
    const Mat3 R = so3_exp(Vec3(rng.normal(0.1), 0.25 * v - 0.6, rng.normal(0.1)));
    scene.views.push_back({static_cast<int>(scene.cameras.size()) - 1, "img" + std::to_string(v) + ".jpg",
                           SE3(R, Vec3(0.1, -0.1, 5)), v + 1});
  }
  for (int p = 0; p < 30; ++p) {
    scene.p_world.emplace_back(rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1));
    scene.tags.push_back({10 + 2 * p, {}});
    for (int v = 0; v < 6; ++v) scene.sightings.push_back({v, p, *predict(scene, {v, p, {}, 1}), 1});
  }
  return scene;
}

Reconstruction perturbed(Reconstruction scene) {
  Rng rng(3);
  for (std::size_t v = 1; v < scene.views.size(); ++v) {
    Vec6 d;
    for (double& x : d) x = rng.normal(0.005);
    scene.views[v].T_cam_world = box_plus(scene.views[v].T_cam_world, d);
  }
  for (Vec3& p : scene.p_world) p += Vec3(rng.normal(0.01), rng.normal(0.01), rng.normal(0.01));
  return scene;
}

void write_colmap(const std::filesystem::path& folder, const Reconstruction& scene) {
  std::filesystem::create_directories(folder);
  for (const NamedBytes& file : format_colmap_model(scene).value())
    write_text(folder / file.name, file.bytes);
}

Reconstruction read_colmap(const std::filesystem::path& folder) {
  std::vector<NamedBytes> files;
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"})
    files.push_back({name, read_text(folder / name)});
  return parse_colmap_model(files).value();
}

double worst(const Reconstruction& a, const Reconstruction& b) {
  double d = 0;
  for (std::size_t p = 0; p < a.p_world.size(); ++p) d = std::max(d, (a.p_world[p] - b.p_world[p]).norm());
  return d;
}

TEST(GeometryBundle, AColmapModelWithScaleBars) {
  const TempDir dir;
  const Reconstruction truth = make_truth("kb4");
  write_colmap(dir / "in", perturbed(truth));
  const double length = (truth.p_world[0] - truth.p_world[5]).norm();
  const std::string bar = "--scale-bar 10,20," + std::to_string(length);  // points 0 and 5 by their ids
  const std::string files = (dir / "in").string() + " -o " + (dir / "out").string();
  const auto run =
      plumbline("geometry bundle --json " + bar + " --structure " + (dir / "j.svg").string() + " " + files);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const json result = json::parse(run.out);
  EXPECT_EQ(result["used"], 180);
  EXPECT_LT(result["rms_px"].get<double>(), 1e-6);
  EXPECT_GT(result["rms_px_before"].get<double>(), 1);
  EXPECT_EQ(result["scale_bars"][0]["points"][0], "point 0 (id 10)");
  EXPECT_TRUE(result["converged"].get<bool>());
  const Reconstruction adjusted = read_colmap(dir / "out");
  EXPECT_LT(worst(adjusted, truth), 1e-5);  // the bar was given with six digits
  EXPECT_EQ(adjusted.tags[3].id, 16);
  EXPECT_THAT(read_text(dir / "j.svg"), HasSubstr("30 points"));

  // Not over an earlier result, but with --force; and the same bytes.
  const std::string first = read_text(dir / "out" / "images.txt");
  const auto again = plumbline("geometry bundle " + bar + " " + files);
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("this exists already"));
  EXPECT_EQ(plumbline("geometry bundle --force " + bar + " " + files).exit_code, 0);
  EXPECT_EQ(read_text(dir / "out" / "images.txt"), first);
  // A picture as PNG, and a gate that cannot be met with everything held wrong.
  const auto png =
      plumbline("geometry bundle --fix views --max-rms 0.001 --structure " + (dir / "j.png").string() + " " +
                (dir / "in").string() + " -o " + (dir / "held").string());
  EXPECT_EQ(png.exit_code, 3) << png.err;
  EXPECT_THAT(png.out, HasSubstr("quality gate missed"));
  EXPECT_EQ(read_text(dir / "j.png").substr(1, 3), "PNG");
}

TEST(GeometryBundle, ABalProblem) {
  const TempDir dir;
  const Reconstruction truth = make_truth("opencv4");
  Reconstruction start = perturbed(truth);
  for (Camera& camera : start.cameras) params(camera.lens)[0] = params(camera.lens)[1] = 505;
  write_text(dir / "problem.txt", format_bal(start).value());
  const std::string files = (dir / "problem.txt").string() + " -o " + (dir / "adjusted.txt").string();
  const auto run = plumbline("geometry bundle --free-intrinsics all --loss huber:2 --json " + files);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_LT(json::parse(run.out)["rms_px"].get<double>(), 1e-6);
  const auto adjusted = parse_bal(read_text(dir / "adjusted.txt"));
  ASSERT_TRUE(adjusted) << adjusted.error().text();
  for (const Camera& camera : adjusted->cameras) {
    EXPECT_NEAR(params(camera.lens)[0], 500, 1e-4);
    EXPECT_EQ(params(camera.lens)[0], params(camera.lens)[1]);
    EXPECT_NEAR(params(camera.lens)[4], -0.05, 1e-6);
  }
  // COLMAP's model cannot be written from it, and that is said before the work.
  const auto colmap =
      plumbline("geometry bundle " + (dir / "problem.txt").string() + " -o " + (dir / "model").string());
  EXPECT_EQ(colmap.exit_code, 1);
  EXPECT_THAT(colmap.err, HasSubstr("size of the images"));
}

TEST(GeometryBundle, BadInputHasItsMessage) {
  const TempDir dir;
  write_colmap(dir / "in", make_truth("kb4"));
  write_text(dir / "text.txt", "hello\n");
  const std::string in = (dir / "in").string(), out = " -o " + (dir / "out").string();
  const auto expect = [&](const std::string& arguments, int exit_code, const std::string& words) {
    const auto run = plumbline("geometry bundle " + arguments);
    EXPECT_EQ(run.exit_code, exit_code) << arguments << "\n" << run.out;
    EXPECT_THAT(run.err, HasSubstr(words)) << arguments;
    EXPECT_FALSE(std::filesystem::exists(dir / "out"));
  };
  expect((dir / "nothing").string() + out, 1, "nothing");
  expect((dir / "text.txt").string() + out, 1, "not a BAL problem");
  expect(in + out + " --fix point=10", 1, "free in 4 of 7 degrees of freedom");
  expect(in + out + " --fix point=10", 1, "kDegenerate");
  expect(in + out + " --fix point=11", 2, "there is no point 11");
  expect(in + out + " --fix view=img9.jpg", 2, "there is no view img9.jpg");
  expect(in + out + " --fix everything", 2, "view=IMAGE, point=ID");
  expect(in + out + " --scale-bar 10,12", 2, "two points, a length");
  expect(in + out + " --scale-bar 10,12,nan", 2, "two points, a length");
  expect(in + out + " --loss l1", 2, "squared, huber:SIGMAS");
  expect(in + out + " --free-intrinsics f", 1, "no lens has a parameter of this name");
  expect(in + out + " --structure j.gif", 2, ".svg or .png");
  expect(in + out + " --structure " + (dir / "nowhere" / "j.svg").string(), 1, "does not exist");
  expect(in + out + " --max-iterations 1 --free-intrinsics all", 1, "kNotConverged");
  expect(in + " -o /dev/full/x.txt", 1, "");
  expect(in, 2, "--output is required");
  std::filesystem::remove(dir / "in" / "points3D.txt");
  expect(in + out, 1, "there is no points3D.txt");
}

}  // namespace
}  // namespace plumbline::test

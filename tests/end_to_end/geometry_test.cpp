// SPDX-License-Identifier: Apache-2.0
// Every verb of `plumbline geometry` on what OpenCV projected: values against the truth, and each bad input
// with its message and exit code.
#include "end_to_end/geometry_files.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using test::Json;
using test::mat3_of;
using test::vec3_of;
using test::World;
using ::testing::HasSubstr;

// Doubles in files of 17 digits through OpenCV's projection, whose lenses we invert to 1e-10 px: some 1e-12
// relative in each pixel, and a condition of the problems of up to a thousand.
constexpr double kExact = 1e-8;

class Geometry : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& text) {
    test::write_text(dir / name, text);
    return (dir / name).string();
  }

  // A verb with --json that must succeed.
  Json answer(const std::string& arguments) {
    const test::Run run = test::plumbline("geometry " + arguments + " --json");
    EXPECT_EQ(run.exit_code, 0) << arguments << "\n" << run.err;
    return run.exit_code == 0 ? Json::parse(run.out) : Json();
  }

  // A verb that must fail with that text and that code, and leave no output.
  void expect_failed(const std::string& arguments, const std::string& says, int exit_code = 1) {
    const std::string out = (dir / "out.yaml").string();
    const test::Run run = test::plumbline("geometry " + arguments + " -o " + out);
    EXPECT_EQ(run.exit_code, exit_code) << arguments << "\n" << run.out << run.err;
    EXPECT_THAT(run.err, HasSubstr(says)) << arguments;
    if (exit_code == 1) EXPECT_THAT(run.err, testing::StartsWith("plumbline geometry "));
    if (exit_code == 1) EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
    EXPECT_TRUE(run.out.empty()) << run.out;
    EXPECT_FALSE(fs::exists(out)) << arguments;
  }

  test::TempDir dir;
};

TEST_F(Geometry, Transform) {
  // A quarter turn about z after a step along x, against OpenCV's Rodrigues.
  const cv::Vec3d rvec(0.3, -0.2, 0.9);
  const Mat3 R = World::rotation(rvec);
  const Json one = answer("transform --rvec-rad 0.3,-0.2,0.9 --t 1,2,3");
  EXPECT_LT((mat3_of(one["R"]) - R).norm(), 1e-14);
  EXPECT_EQ(vec3_of(one["t"]), Vec3(1, 2, 3));
  EXPECT_LT((vec3_of(one["C"]) + R.transpose() * Vec3(1, 2, 3)).norm(), 1e-14);
  EXPECT_LT((vec3_of(one["rvec_rad"]) - Vec3(0.3, -0.2, 0.9)).norm(), 1e-14);

  const Json back = answer("transform --rvec-rad 0.3,-0.2,0.9 --t 1,2,3 --inverse");
  EXPECT_LT((mat3_of(back["R"]) - R.transpose()).norm(), 1e-14);
  EXPECT_LT((vec3_of(back["t"]) - vec3_of(one["C"])).norm(), 1e-14);

  // A chain keeps the order of the command line: R then the quarter turn.
  const Json chain =
      answer("transform --rvec-rad 0.3,-0.2,0.9 --t 1,2,3 --axis-angle-deg 0,0,2,90 --t 4,5,6");
  const Mat3 turn = (Mat3() << 0, -1, 0, 1, 0, 0, 0, 0, 1).finished();
  EXPECT_LT((mat3_of(chain["R"]) - R * turn).norm(), 1e-14);
  EXPECT_LT((vec3_of(chain["t"]) - (R * Vec3(4, 5, 6) + Vec3(1, 2, 3))).norm(), 1e-13);

  // Written, read back as a file, undone by its inverse.
  const std::string file = (dir / "T.yaml").string();
  answer("transform --rvec-deg 10,20,-30 --t -1,0.5,2 -o " + file);
  const Json none = answer("transform " + file + " " + file + " --inverse");
  EXPECT_LT((mat3_of(none["R"]) - Mat3::Identity()).norm(), 1e-14);
  EXPECT_LT(vec3_of(none["t"]).norm(), 1e-14);

  const Json moved =
      answer("transform --quaternion-wxyz 0.70710678118654757,0,0,0.70710678118654757 --t 0,0,5 --points " +
             write("p.csv", "X Y Z\n1 0 0\n0 2 0\n"));
  EXPECT_LT((vec3_of(moved["points"][0]) - Vec3(0, 1, 5)).norm(), 1e-14);
  EXPECT_LT((vec3_of(moved["points"][1]) - Vec3(-2, 0, 5)).norm(), 1e-14);
}

TEST_F(Geometry, TransformOfEulerAngles) {
  // R = R_y(20) R_x(-10) R_z(35), each by OpenCV's Rodrigues.
  const double deg = std::numbers::pi / 180;
  const Mat3 R = World::rotation({0, 20 * deg, 0}) * World::rotation({-10 * deg, 0, 0}) *
                 World::rotation({0, 0, 35 * deg});
  const Json yxz = answer("transform --euler-deg YXZ:20,-10,35 --euler-order YXZ");
  EXPECT_LT((mat3_of(yxz["R"]) - R).norm(), 1e-14);
  EXPECT_LT((vec3_of(yxz["euler_deg"]) - Vec3(20, -10, 35)).norm(), 1e-12);
  EXPECT_EQ(yxz["euler_order"], "YXZ");
  EXPECT_FALSE(yxz["gimbal_lock"]);
  const Json same = answer("transform --euler-rad YXZ:0.3,0.2,0.1 --inverse --euler-rad YXZ:0.3,0.2,0.1");
  EXPECT_LT((mat3_of(same["R"]) - Mat3::Identity()).norm(), 1e-14);
  const Json lock = answer("transform --euler-deg ZYX:10,90,20");
  EXPECT_TRUE(lock["gimbal_lock"]);
  EXPECT_LT((vec3_of(lock["euler_deg"]) - Vec3(-10, 90, 0)).norm(), 1e-6);
  expect_failed("transform --euler-deg ABC:1,2,3", "ABC", 2);
  expect_failed("transform --euler-deg 1,2,3", "ORDER:a,b,c is needed", 2);
  expect_failed("transform --t 1,2,3 --euler-order YY", "YY", 2);
}

TEST_F(Geometry, TransformRefuses) {
  expect_failed("transform", "give at least one transform", 2);
  expect_failed("transform --inverse", "there is none", 2);
  expect_failed("transform --rvec-deg 1,2", "3 numbers are needed, separated by commas; there are 2", 2);
  expect_failed("transform --rvec-deg 1,2,nan", "'nan' is not a finite number", 2);
  expect_failed("transform --axis-angle-deg 0,0,0,3", "the axis has no length", 2);
  expect_failed("transform --matrix 1,0,0,0,1,0,0,0,2", "not a rotation: |R'R - I| = 3");
  expect_failed("transform --quaternion-wxyz 1,1,0,0", "length 1, not 1.41421");
  expect_failed("transform " + (dir / "no.yaml").string(), "no.yaml");
  expect_failed("transform " + write("bad.yaml", "t: [1, 2]\n"), "bad.yaml: t, line 1: 3 numbers are needed");
  expect_failed("nothing", "there is no verb 'nothing'", 2);
}

TEST_F(Geometry, AnAnswerIsNeverReplacedUnasked) {
  const std::string file = write("T.yaml", "mine\n");
  const test::Run run = test::plumbline("geometry transform --t 1,2,3 -o " + file);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.err, HasSubstr("--force"));
  EXPECT_EQ(test::read_text(file), "mine\n");
  EXPECT_EQ(test::plumbline("geometry transform --t 1,2,3 --force -o " + file).exit_code, 0);
  EXPECT_THAT(test::read_text(file), HasSubstr("t: [1, 2, 3]\n"));
  EXPECT_EQ(test::plumbline("geometry transform --t 1,2,3 -o /dev/full").exit_code, 1);
  EXPECT_EQ(test::run(PLUMBLINE_BINARY " geometry transform --t 1,2,3 > /dev/full").exit_code, 1);
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
// The verbs of `plumbline geometry` on views that OpenCV projected: values against the truth, and what each
// refuses.
#include "end_to_end/geometry_files.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline {
namespace {
namespace fs = std::filesystem;
using test::Json;
using test::mat3_of;
using test::numbers_of;
using test::vec3_of;
using test::World;
using ::testing::HasSubstr;

// 17 digits in the files; lenses are inverted to 1e-10 px of some 500, and the problems' conditions are below
// 1e3.
constexpr double kExact = 1e-8;

class GeometryViews : public ::testing::Test {
 protected:
  void SetUp() override {
    camera = write("cam.yaml", world.camera_yaml());
    sights = write("sights.csv", world.sights_csv());
    matches = write("matches.csv", world.matches_csv());
  }
  std::string write(const std::string& name, const std::string& text) {
    test::write_text(dir / name, text);
    return (dir / name).string();
  }
  Json answer(const std::string& arguments) {
    const test::Run run = test::plumbline("geometry " + arguments + " --json");
    EXPECT_EQ(run.exit_code, 0) << arguments << "\n" << run.err;
    EXPECT_EQ(run.err, "");
    return run.exit_code == 0 ? Json::parse(run.out) : Json();
  }
  void expect_failed(const std::string& arguments, const std::string& says, int exit_code = 1) {
    const std::string out = (dir / "out.yaml").string();
    const test::Run run = test::plumbline("geometry " + arguments + " -o " + out);
    EXPECT_EQ(run.exit_code, exit_code) << arguments << "\n" << run.out << run.err;
    EXPECT_THAT(run.err, HasSubstr(says)) << arguments;
    if (exit_code == 1) EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
    EXPECT_TRUE(run.out.empty()) << run.out;
    EXPECT_FALSE(fs::exists(out)) << arguments;
  }
  // The rows of a table with every tenth one wrong.
  static std::string spoiled(const std::string& csv, int column) {
    std::string out;
    int row = -1;
    for (std::size_t at = 0; at < csv.size(); ++row) {
      const auto end = csv.find('\n', at);
      std::string line = csv.substr(at, end - at);
      at = end + 1;
      if (row >= 0 && row % 10 == 3) {
        std::size_t cell = 0;
        for (int c = 0; c < column; ++c) cell = line.find(',', cell) + 1;
        line = line.substr(0, cell) + fmt::format("{}", 100 + 37 * row % 400) +
               (line.find(',', cell) == std::string::npos ? "" : line.substr(line.find(',', cell)));
      }
      out += line + "\n";
    }
    return out;
  }

  World world;
  test::TempDir dir;
  std::string camera, sights, matches;
};

TEST_F(GeometryViews, PoseIsThatOfTheWorld) {
  const std::string file = (dir / "pose.yaml").string();
  const Json pose = answer("pose --points " + sights + " --camera " + camera + " -o " + file);
  EXPECT_LT((mat3_of(pose["R"]) - world.R1()).norm(), kExact);
  EXPECT_LT((vec3_of(pose["t"]) - world.t1()).norm(), kExact);
  EXPECT_LT((vec3_of(pose["C"]) + world.R1().transpose() * world.t1()).norm(), kExact);
  EXPECT_LT((mat3_of(pose["K"]) - test::to_eigen(world.K)).norm(), 1e-12);
  const VecX P = numbers_of(pose["P"]);
  ASSERT_EQ(P.size(), 12);
  EXPECT_NEAR(P[3], (test::to_eigen(world.K) * world.t1())[0], 1e-5);
  EXPECT_EQ(pose["inliers"], 40);
  // The answer's file is a transform again.
  const Json again = answer("transform " + file);
  EXPECT_LT((mat3_of(again["R"]) - mat3_of(pose["R"])).norm(), 1e-14);
}

TEST_F(GeometryViews, PoseSaysHowSureItIs) {
  const World noisy(false, true, 0.5);
  const std::string file = write("noisy.csv", noisy.sights_csv());
  const Json pose = answer("pose --points " + file + " --camera " + camera);
  EXPECT_NEAR(pose["sigma_px"], 0.5, 0.15);  // 74 degrees of freedom: 8 % is one sigma
  const VecX sigma = numbers_of(pose["sigma"]), covariance = numbers_of(pose["covariance"]);
  ASSERT_EQ(sigma.size(), 6);
  ASSERT_EQ(covariance.size(), 36);
  EXPECT_NEAR(sigma[1] * sigma[1], covariance[7], 1e-15);
  const Vec3 turn = so3_log(mat3_of(pose["R"]) * noisy.R1().transpose());
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(std::abs(turn[i]), 4 * sigma[i]);
    EXPECT_LT(std::abs((vec3_of(pose["t"]) - noisy.t1())[i]), 4 * sigma[3 + i]);
  }
  // Covariances go with the square of the noise.
  const Json told = answer("pose --sigma 2 --points " + file + " --camera " + camera);
  EXPECT_NEAR(numbers_of(told["covariance"])[0] / covariance[0], std::pow(2 / double(pose["sigma_px"]), 2),
              1e-6);
}

TEST_F(GeometryViews, PoseWithOutliers) {
  const std::string file = write("spoiled.csv", spoiled(world.sights_csv(), 3));
  const Json pose = answer("pose --ransac --inlier-px 1 --points " + file + " --camera " + camera);
  EXPECT_EQ(pose["outliers"], Json({3, 13, 23, 33}));
  EXPECT_LT((mat3_of(pose["R"]) - world.R1()).norm(), kExact);
  const test::Run one =
      test::plumbline("geometry pose --threads 1 --ransac --json --points " + file + " --camera " + camera);
  const test::Run eight =
      test::plumbline("geometry pose --threads 8 --ransac --json --points " + file + " --camera " + camera);
  EXPECT_EQ(one.out, eight.out);
}

TEST_F(GeometryViews, PoseOfABoard) {
  const World flat(true);
  const Json pose = answer("pose --points " + write("flat.csv", flat.sights_csv()) + " --camera " + camera);
  EXPECT_LT((mat3_of(pose["R"]) - flat.R1()).norm(), kExact);
  EXPECT_LT((vec3_of(pose["t"]) - flat.t1()).norm(), kExact);
}

TEST_F(GeometryViews, PoseRefuses) {
  expect_failed("pose --points " + matches + " --camera " + camera,
                "the column 'X' is missing; there are u1, v1, u2, v2");
  expect_failed("pose --points " + sights + " --camera " + (dir / "no.yaml").string(), "no.yaml");
  expect_failed("pose --points " + (dir / "no.csv").string() + " --camera " + camera, "no.csv");
  expect_failed("pose --points " + sights, "--camera", 2);
  expect_failed("pose --points " + write("nan.csv", "X,Y,Z,u,v\n1,2,3,nan,5\n") + " --camera " + camera,
                "nan.csv: line 2: u is 'nan'");
  expect_failed("pose --points " +
                    write("line.csv",
                          "X,Y,Z,u,v\n0,0,2,330,235\n.1,0,2,360,235\n.2,0,2,390,235\n.3,0,2,"
                          "420,235\n.4,0,2,450,235\n") +
                    " --camera " + camera,
                "kDegenerate");
}

TEST_F(GeometryViews, PixelsOutsideTheLensAreReported) {
  // A kb4 lens whose image of half a turn ends at 565 px from the centre: the last pixel has no ray.
  const std::string fisheye = write(
      "fisheye.yaml",
      "cam0:\n  camera_model: pinhole\n  intrinsics: [180, 180, 400, 300]\n  distortion_model: equidistant\n"
      "  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [800, 600]\n  rostopic: /a/image_raw\n");
  std::string csv = "X,Y,Z,u,v\n";
  std::vector<cv::Point3d> points;
  for (int i = 0; i < 8; ++i) points.emplace_back(std::cos(2.0 * i), std::sin(2.0 * i), 0.5 * (i % 3));
  std::vector<cv::Point2d> px;
  cv::fisheye::projectPoints(points, px, cv::Affine3d(cv::Vec3d(0.1, 0.2, 0.3), cv::Vec3d(0.1, 0.2, 2)),
                             cv::Matx33d(180, 0, 400, 0, 180, 300, 0, 0, 1), cv::Vec4d());
  for (std::size_t i = 0; i < points.size(); ++i)
    csv += fmt::format("{:.17g},{:.17g},{:.17g},{:.17g},{:.17g}\n", points[i].x, points[i].y, points[i].z,
                       px[i].x, px[i].y);
  csv += "5,5,5,1000,900\n";
  const std::string arguments = "pose --points " + write("wide.csv", csv) + " --camera " + fisheye;
  const Json pose = answer(arguments);
  EXPECT_EQ(pose["outside_lens"], Json({8}));
  EXPECT_LT((so3_log(mat3_of(pose["R"])) - Vec3(0.1, 0.2, 0.3)).norm(), kExact);
  EXPECT_THAT(test::plumbline("geometry " + arguments).out,
              HasSubstr("1 of 9 rows left out, because a pixel has no ray "
                        "in its lens: line 10"));
}

TEST_F(GeometryViews, DecomposeFindsKAndThePose) {
  const World pinhole(false, false);
  const Json parts = answer("decompose --points " + write("p.csv", pinhole.sights_csv()));
  EXPECT_LT((mat3_of(parts["K"]) - test::to_eigen(pinhole.K)).norm(), 1e-5);  // 600 px times kExact
  EXPECT_LT((mat3_of(parts["R"]) - pinhole.R1()).norm(), kExact);
  EXPECT_LT((vec3_of(parts["t"]) - pinhole.t1()).norm(), kExact);
  EXPECT_LT((vec3_of(parts["C"]) + pinhole.R1().transpose() * pinhole.t1()).norm(), kExact);
  EXPECT_LT(double(parts["roads_differ_by"]), 1e-10);

  // P itself, of any scale and sign, against cv::decomposeProjectionMatrix.
  const VecX P = numbers_of(parts["P"]);
  std::string text;
  cv::Matx34d P_cv;
  for (int i = 0; i < 12; ++i) {
    text += fmt::format("{}{:.17g}", i ? "," : "", -3 * P[i]);
    P_cv(i / 4, i % 4) = P[i];
  }
  const Json same = answer("decompose --matrix=" + text);
  cv::Matx33d K, R;
  cv::Vec4d C;
  cv::decomposeProjectionMatrix(P_cv, K, R, C);
  EXPECT_LT((mat3_of(same["K"]) - test::to_eigen(K) / K(2, 2)).norm(), 1e-8);
  EXPECT_LT((mat3_of(same["R"]) - test::to_eigen(R)).norm(), 1e-10);
  EXPECT_LT((vec3_of(same["C"]) - Vec3(C[0], C[1], C[2]) / C[3]).norm(), 1e-9);
}

TEST_F(GeometryViews, DecomposeRefuses) {
  expect_failed("decompose", "give either --points or --matrix", 2);
  expect_failed("decompose --matrix 1,2,3", "12 numbers are needed", 2);
  expect_failed("decompose --matrix 1,0,0,0,0,1,0,0,0,0,0,1", "kDegenerate");
  expect_failed("decompose --points " + write("flat.csv", World(true).sights_csv()), "kDegenerate");
  expect_failed("decompose --points " + write("few.csv", "X,Y,Z,u,v\n1,2,3,4,5\n"),
                "1 points; a camera matrix needs");
}

TEST_F(GeometryViews, FundamentalOfThePinholePair) {
  const World pinhole(false, false);
  const std::string file = write("p.csv", pinhole.matches_csv());
  const Json f = answer("fundamental --points " + file);
  const Mat3 K = test::to_eigen(pinhole.K);
  Mat3 truth = K.inverse().transpose() * skew(pinhole.t_2_1()) * pinhole.R_2_1() * K.inverse();
  truth /= truth.norm();
  const Mat3 F = mat3_of(f["F"]);
  EXPECT_NEAR(F.norm(), 1, 1e-12);
  EXPECT_LT(std::min((F - truth).norm(), (F + truth).norm()), kExact);
  EXPECT_LT((F * vec3_of(f["e1"])).norm(), 1e-12);
  EXPECT_LT((F.transpose() * vec3_of(f["e2"])).norm(), 1e-12);
  // e1 is the image of the second camera's centre.
  const Vec3 e1 = K * (-pinhole.R_2_1().transpose() * pinhole.t_2_1());
  EXPECT_LT(vec3_of(f["e1"]).cross(e1.normalized()).norm(), 1e-7);
  EXPECT_EQ(f["inliers"], 40);

  const Json robust = answer("fundamental --ransac --inlier-px 0.5 --points " +
                             write("bad.csv", spoiled(pinhole.matches_csv(), 3)));
  EXPECT_EQ(robust["outliers"], Json({3, 13, 23, 33}));
  EXPECT_EQ(robust["inliers"], 36);
  EXPECT_LT(std::min((mat3_of(robust["F"]) - truth).norm(), (mat3_of(robust["F"]) + truth).norm()), kExact);
}

TEST_F(GeometryViews, FundamentalRefuses) {
  expect_failed("fundamental --points " + write("flat.csv", World(true, false).matches_csv()), "kDegenerate");
  expect_failed("fundamental --points " + write("few.csv", "u1,v1,u2,v2\n1,2,3,4\n"),
                "1 rows; a fundamental matrix needs");
  expect_failed("fundamental --points " + sights, "the column 'u1' is missing");
  expect_failed("fundamental --points " + matches + " --ransac --inlier-px 0",
                "0 is not a finite number above 0", 2);
  // A camera that only turned.
  World turned(false, false);
  turned.tvec_2 = {0, 0, 0};
  cv::Matx33d R;
  cv::Rodrigues(turned.rvec_2, R);
  const Vec3 t = test::to_eigen(R) * turned.R1().transpose() * turned.t1();
  turned.tvec_2 = {t.x(), t.y(), t.z()};
  cv::projectPoints(turned.points, turned.rvec_2, turned.tvec_2, turned.K, turned.distortion, turned.px2);
  expect_failed("fundamental --points " + write("turn.csv", turned.matches_csv()), "kDegenerate");
}

TEST_F(GeometryViews, EssentialIsTheMotion) {
  for (const std::string more : {"", " --ransac --inlier-px 0.5", " --linear"}) {
    const Json e = answer("essential --points " + matches + " --camera " + camera + more);
    EXPECT_LT((mat3_of(e["R"]) - world.R_2_1()).norm(), 10 * kExact) << more;
    EXPECT_LT((vec3_of(e["t"]) - world.t_2_1().normalized()).norm(), 10 * kExact) << more;
    const Mat3 E = skew(vec3_of(e["t"])) * mat3_of(e["R"]);
    EXPECT_LT((mat3_of(e["E"]) - E).norm(), 1e-12);
  }
  // Two cameras that differ, by two files, in the order of the views.
  World other = world;
  other.K(0, 0) = other.K(1, 1) = 450;
  other.distortion = cv::Mat::zeros(1, 5, CV_64F);
  cv::projectPoints(other.points, other.rvec_2, other.tvec_2, other.K, other.distortion, other.px2);
  const std::string second = write("cam2.yaml", other.camera_yaml("second"));
  const std::string rows = write("two.csv", other.matches_csv());
  for (const std::string more : {"", " --ransac --inlier-px 0.5"}) {
    const Json e =
        answer("essential --points " + rows + " --camera " + camera + " --camera " + second + more);
    EXPECT_LT((mat3_of(e["R"]) - world.R_2_1()).norm(), 10 * kExact);
    EXPECT_LT((vec3_of(e["t"]) - world.t_2_1().normalized()).norm(), 10 * kExact);
  }
  expect_failed("essential --points " + matches, "--camera", 2);
  expect_failed("essential --points " + write("few.csv", "u1,v1,u2,v2\n1,2,3,4\n") + " --camera " + camera,
                "kDegenerate");
}

TEST_F(GeometryViews, HomographyAndWhatItSaysOfTheMotion) {
  const World flat(true);
  const std::string file = write("flat.csv", flat.matches_csv());
  const Json h = answer("homography --points " + file + " --camera " + camera);
  // The plane Z = 0 of the world, seen from the first camera.
  const Vec3 n = flat.R1().col(2);
  const double d = n.dot(flat.t1());
  const Mat3 K = test::to_eigen(flat.K);
  Mat3 truth = K * (flat.R_2_1() + flat.t_2_1() * n.transpose() / d) * K.inverse();
  const Mat3 H = mat3_of(h["H"]);
  EXPECT_LT((H / H(2, 2) - truth / truth(2, 2)).norm() / truth.norm(), kExact);
  bool found = false;
  for (const Json& m : h["motions"]) {
    found = found || ((mat3_of(m["R"]) - flat.R_2_1()).norm() < 1e-6 &&
                      (vec3_of(m["t_over_d"]) - flat.t_2_1() / std::abs(d)).norm() < 1e-6);
  }
  EXPECT_TRUE(found) << h["motions"];
  EXPECT_LE(h["motions"].size(), 2u);
  EXPECT_FALSE(h["rotation_only"]);

  const World pinhole(true, false);
  const Json plain = answer("homography --ransac --inlier-px 1 --points " +
                            write("p.csv", spoiled(pinhole.matches_csv(), 2)));
  EXPECT_EQ(plain["outliers"], Json({3, 13, 23, 33}));
  EXPECT_FALSE(plain.contains("motions"));
  expect_failed("homography --points " + write("few.csv", "u1,v1,u2,v2\n1,2,3,4\n"),
                "1 rows; a homography needs at least 4");
  expect_failed("homography --points " +
                    write("line.csv", "u1,v1,u2,v2\n1,1,1,2\n2,2,2,4\n3,3,3,6\n4,4,4,8\n5,5,5,10\n"),
                "kDegenerate");
}

// A narrow view amplifies the noise of H by far more than sigma / f; the turn is told all the same, and a
// camera that moved by a twentieth of the plane's distance is not called one. The F-test errs once in a
// thousand.
TEST_F(GeometryViews, HomographyTellsANoisyTurnFromAPlane) {
  const std::string pinhole = write("pinhole.yaml", World(false, false).camera_yaml());
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> normal(0, 0.3);
  const cv::Matx33d K = world.K;
  for (int trial = 0; trial < 12; ++trial) {
    const bool turns = trial % 2 == 0;
    std::vector<cv::Point3d> points;
    for (int i = 0; i < 40; ++i) {
      const double x = uniform(random), y = uniform(random), z = uniform(random);
      points.emplace_back(x, y, turns ? 4.5 + 1.5 * z : 4.5 + 0.3 * x);
    }
    const cv::Vec3d turn(0.1 * uniform(random), 0.1 * uniform(random), 0.1 * uniform(random));
    std::vector<cv::Point2d> px1, px2;
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, cv::noArray(), px1);
    cv::projectPoints(points, turn, turns ? cv::Vec3d() : cv::Vec3d(0.2, 0.05, 0.1), K, cv::noArray(), px2);
    std::string csv = "u1,v1,u2,v2\n";
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double e[] = {normal(random), normal(random), normal(random), normal(random)};
      csv += fmt::format("{},{},{},{}\n", px1[i].x + e[0], px1[i].y + e[1], px2[i].x + e[2], px2[i].y + e[3]);
    }
    const std::string file = write(fmt::format("turn{}.csv", trial), csv);
    for (const char* how : {"", " --linear"}) {
      const Json h = answer("homography --points " + file + " --camera " + pinhole + how);
      EXPECT_EQ(h["rotation_only"], turns) << trial << how;
    }
  }
}

TEST_F(GeometryViews, TriangulateFindsThePoints) {
  const std::string poses = " --pose " + write("1.txt", World::pose_text(world.R1(), world.t1())) +
                            " --pose " + write("2.txt", World::pose_text(world.R2(), world.t2()));
  const Json all = answer("triangulate --sigma 0.5 --points " + matches + " --camera " + camera + poses);
  ASSERT_EQ(all["points"].size(), 40u);
  for (int i = 0; i < 40; ++i) {
    const cv::Point3d& p = world.points[i];
    EXPECT_LT((vec3_of(all["points"][i]) - Vec3(p.x, p.y, p.z)).norm(), kExact) << i;
    EXPECT_EQ(numbers_of(all["covariance"][i]).size(), 9);
    // Between the lines of sight, from the truth.
    const Vec3 P(p.x, p.y, p.z), a = P + world.R1().transpose() * world.t1(),
                                 b = P + world.R2().transpose() * world.t2();
    EXPECT_NEAR(all["ray_angle_deg"][i],
                std::acos(a.normalized().dot(b.normalized())) * 180 / std::numbers::pi, 1e-5);
  }

  // A rig's file gives the poses itself: relative to its first camera.
  const std::string rig = write(
      "rig.yaml",
      fmt::format(
          "cam0:\n  camera_model: pinhole\n  intrinsics: [600, 610, 330, 235]\n  distortion_model: radtan\n"
          "  distortion_coeffs: [-0.2, 0.05, 0.001, -0.001]\n  resolution: [640, 480]\n  rostopic: "
          "/a/image_raw\n"
          "cam1:\n  camera_model: pinhole\n  intrinsics: [600, 610, 330, 235]\n  distortion_model: radtan\n"
          "  distortion_coeffs: [-0.2, 0.05, 0.001, -0.001]\n  resolution: [640, 480]\n  rostopic: "
          "/b/image_raw\n"
          "  T_cn_cnm1:\n{}",
          [&] {
            std::string rows;
            for (int r = 0; r < 3; ++r)
              rows += fmt::format("  - [{:.17g}, {:.17g}, {:.17g}, {:.17g}]\n", world.R_2_1()(r, 0),
                                  world.R_2_1()(r, 1), world.R_2_1()(r, 2), world.t_2_1()[r]);
            return rows + "  - [0, 0, 0, 1]\n";
          }()));
  const Json by_rig = answer("triangulate --points " + matches + " --camera " + rig);
  for (int i = 0; i < 40; ++i) {
    const cv::Point3d& p = world.points[i];
    EXPECT_LT((vec3_of(by_rig["points"][i]) - (world.R1() * Vec3(p.x, p.y, p.z) + world.t1())).norm(), kExact)
        << i;
  }
}

TEST_F(GeometryViews, TriangulateSaysWhichPointsHaveNoAnswer) {
  const std::string cameras = " --camera " + camera + " --pose " +
                              write("1.txt", World::pose_text(world.R1(), world.t1())) + " --pose " +
                              write("2.txt", World::pose_text(world.R2(), world.t2()));
  // Of three points the second was seen once.
  std::string csv = "u1,v1,u2,v2\n";
  for (int i = 0; i < 3; ++i)
    csv += i == 1
               ? std::string("100,100,-,-\n")
               : fmt::format("{},{},{},{}\n", world.px1[i].x, world.px1[i].y, world.px2[i].x, world.px2[i].y);
  const Json some = answer("triangulate --points " + write("some.csv", csv) + cameras);
  EXPECT_EQ(some["n_points"], 2);
  EXPECT_TRUE(some["points"][1].is_null());
  EXPECT_THAT(std::string(some["reasons"][1]), HasSubstr("kDegenerate"));
  EXPECT_TRUE(some["reasons"][0].is_null());
  expect_failed("triangulate --points " + write("none.csv", "u1,v1,u2,v2\n1,2,-,-\n") + cameras,
                "none.csv: line 2");
  expect_failed("triangulate --points " + matches + " --camera " + camera,
                "one camera, and two views are needed");
  expect_failed("triangulate --points " + matches + " --camera " + camera + " --camera " +
                    write("b.yaml", world.camera_yaml("b")),
                "the files do not say where the cameras stand");
  expect_failed("triangulate --points " + sights + cameras, "the column 'u1' is missing");
}

TEST_F(GeometryViews, RectifyMatchesTheRows) {
  World side(false, false);
  side.tvec_2 = {-0.7, 0.1, 2.0};
  cv::projectPoints(side.points, side.rvec_2, side.tvec_2, side.K, side.distortion, side.px2);
  const Json r = answer("rectify --size 640x480 --points " + write("p.csv", side.matches_csv()));
  const Mat3 H1 = mat3_of(r["H1"]), H2 = mat3_of(r["H2"]);
  for (std::size_t i = 0; i < side.points.size(); ++i) {
    const Vec3 a = H1 * Vec3(side.px1[i].x, side.px1[i].y, 1), b = H2 * Vec3(side.px2[i].x, side.px2[i].y, 1);
    EXPECT_NEAR(a.y() / a.z(), b.y() / b.z(), 1e-6) << i;
  }
  EXPECT_LT(double(r["row_rms_px"]), 1e-6);
  EXPECT_FALSE(r["vertical"]);
  expect_failed("rectify --points " + matches, "--size", 2);
  expect_failed("rectify --size 640 --points " + matches, "WIDTHxHEIGHT", 2);
  // The camera moved towards what it sees.
  World forward(false, false);
  forward.rvec_2 = forward.rvec_1;
  forward.tvec_2 = forward.tvec_1 - cv::Vec3d(0, 0, 0.5);
  cv::projectPoints(forward.points, forward.rvec_2, forward.tvec_2, forward.K, forward.distortion,
                    forward.px2);
  expect_failed("rectify --size 640x480 --points " + write("f.csv", forward.matches_csv()),
                "the epipole of image 1 lies inside it");
}

}  // namespace
}  // namespace plumbline

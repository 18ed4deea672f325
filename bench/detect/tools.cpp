// SPDX-License-Identifier: Apache-2.0
#include "detect/tools.hpp"

#include <apriltag/apriltag.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h11.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "plumbline/detect/detect.hpp"

namespace plumbline::bench {
namespace {

void append(const std::vector<cv::Point2f>& points, Answer& out) {
  for (const cv::Point2f& p : points)
    out.corners.push_back({static_cast<int>(out.corners.size()), Vec2(p.x, p.y), 0});
}

Answer by_plumbline(const cv::Mat& grey, const Target& target) {
  const auto found = detect_target(grey, target);
  return found ? Answer{found->corners} : Answer{};
}

Answer by_classic(const cv::Mat& grey, cv::Size size) {
  std::vector<cv::Point2f> points;
  Answer out;
  if (!cv::findChessboardCorners(grey, size, points)) return out;
  // Half the shortest side of a square would be best for it, but nobody who calls it knows that: 11x11 px is
  // what OpenCV's own sample takes, 5x5 where squares are small.
  double shortest = 1e9;
  for (int i = 1; i < size.width; ++i)
    shortest = std::min(shortest, cv::norm(points[static_cast<std::size_t>(i)] - points[i - 1]));
  const int half = shortest > 24 ? 11 : shortest > 12 ? 5 : 3;
  cv::cornerSubPix(grey, points, {half, half}, {-1, -1}, cv::TermCriteria(3, 30, 0.01));
  append(points, out);
  return out;
}

Answer by_sb(const cv::Mat& grey, cv::Size size, int flags) {
  std::vector<cv::Point2f> points;
  Answer out;
  if (cv::findChessboardCornersSB(grey, size, points, flags)) append(points, out);
  return out;
}

double children_cpu_ms() {
  rusage use{};
  getrusage(RUSAGE_CHILDREN, &use);
  const auto ms = [](const timeval& t) {
    return 1e3 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_usec);
  };
  return ms(use.ru_utime) + ms(use.ru_stime);
}

Answer by_mrgingham(const cv::Mat& grey, int n) {
  const auto file =
      std::filesystem::temp_directory_path() / ("detect_bench_" + std::to_string(getpid()) + ".pgm");
  cv::imwrite(file.string(), grey);
  Answer out;
  const double before = children_cpu_ms();
  const std::string command = "mrgingham --gridn " + std::to_string(n) + " " + file.string() + " 2>/dev/null";
  if (FILE* pipe = popen(command.c_str(), "r")) {
    char line[512];
    while (std::fgets(line, sizeof line, pipe) != nullptr) {
      std::istringstream fields(line);
      std::string name;
      double x = 0, y = 0;
      if (line[0] != '#' && fields >> name >> x >> y)
        out.corners.push_back({static_cast<int>(out.corners.size()), Vec2(x, y), 0});
    }
    pclose(pipe);
  }
  out.child_ms = children_cpu_ms() - before;
  std::filesystem::remove(file);
  return out;
}

int aruco_dictionary(const std::string& name) {
  using namespace cv::aruco;
  if (name == "5X5_100") return DICT_5X5_100;
  if (name == "5X5_1000") return DICT_5X5_1000;
  if (name == "4X4_100") return DICT_4X4_100;
  if (name == "4X4_1000") return DICT_4X4_1000;
  return DICT_4X4_50;
}

Answer by_charuco(const cv::Mat& grey, const Charuco& board) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(aruco_dictionary(board.dictionary));
  const auto layout =
      cv::aruco::CharucoBoard::create(board.columns, board.rows, static_cast<float>(board.square_m),
                                      static_cast<float>(board.marker_m), dictionary);
  std::vector<std::vector<cv::Point2f>> markers;
  std::vector<int> ids, points;
  std::vector<cv::Point2f> px;
  cv::aruco::detectMarkers(grey, dictionary, markers, ids);
  if (!ids.empty()) cv::aruco::interpolateCornersCharuco(markers, ids, grey, layout, px, points);
  Answer out;
  for (std::size_t i = 0; i < px.size(); ++i) out.corners.push_back({points[i], Vec2(px[i].x, px[i].y), 0});
  return out;
}

Answer by_aruco_grid(const cv::Mat& grey, const AprilGrid& board) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(
      board.family == "25h9" ? cv::aruco::DICT_APRILTAG_25h9 : cv::aruco::DICT_APRILTAG_36h11);
  const auto parameters = cv::aruco::DetectorParameters::create();
  parameters->markerBorderBits = board.border;
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
  std::vector<std::vector<cv::Point2f>> markers;
  std::vector<int> ids;
  cv::aruco::detectMarkers(grey, dictionary, markers, ids, parameters);
  Answer out;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    // Clockwise from the bottom right of a Kalibr tag; Kalibr counts BL, BR, TR, TL.
    for (const auto& [corner, from] : {std::pair{0, 1}, {1, 0}, {2, 3}, {3, 2}}) {
      const cv::Point2f p = markers[i][static_cast<std::size_t>(from)];
      out.corners.push_back({(ids[i] - board.first_id) * 4 + corner, Vec2(p.x, p.y), 0});
    }
  }
  return out;
}

Answer by_apriltag(const cv::Mat& grey, const AprilGrid& board) {
  const std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family(
      board.family == "25h9" ? tag25h9_create() : tag36h11_create(),
      board.family == "25h9" ? tag25h9_destroy : tag36h11_destroy);
  const std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector(
      apriltag_detector_create(), apriltag_detector_destroy);
  apriltag_detector_add_family(detector.get(), family.get());
  detector->quad_decimate = 1;
  image_u8_t image{grey.cols, grey.rows, static_cast<int32_t>(grey.step), grey.data};
  zarray_t* found = apriltag_detector_detect(detector.get(), &image);
  Answer out;
  for (int i = 0; i < zarray_size(found); ++i) {
    apriltag_detection_t* tag = nullptr;
    zarray_get(found, i, static_cast<void*>(&tag));
    for (int k = 0; k < 4; ++k)
      out.corners.push_back({(tag->id - board.first_id) * 4 + k, Vec2(tag->p[k][0], tag->p[k][1]), 0});
  }
  apriltag_detections_destroy(found);
  return out;
}

Answer by_circles(const cv::Mat& grey, const Circles& board) {
  std::vector<cv::Point2f> points;
  Answer out;
  const int flags = board.asymmetric ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
  if (cv::findCirclesGrid(grey, {board.columns, board.rows}, points, flags)) append(points, out);
  return out;
}

/// OpenCV asserts on some images; that counts as not found.
std::function<Answer(const cv::Mat&)> guarded(std::function<Answer(const cv::Mat&)> run) {
  return [run = std::move(run)](const cv::Mat& grey) {
    try {
      return run(grey);
    } catch (const cv::Exception&) {
      return Answer{};
    }
  };
}

}  // namespace

bool has_mrgingham() {
  static const bool is_there = std::system("command -v mrgingham >/dev/null 2>&1") == 0;
  return is_there;
}

std::vector<Tool> tools_for(const Target& target, bool with_peers) {
  std::vector<Tool> out{{"Plumbline", [target](const cv::Mat& g) { return by_plumbline(g, target); }}};
  if (!with_peers) return out;
  const auto add = [&](const char* name, std::function<Answer(const cv::Mat&)> run) {
    out.push_back({name, guarded(std::move(run))});
  };
  if (const auto* board = std::get_if<Chessboard>(&target.spec)) {
    const cv::Size size(board->columns, board->rows);
    add("findChessboardCorners", [=](const cv::Mat& g) { return by_classic(g, size); });
    add("SB", [=](const cv::Mat& g) { return by_sb(g, size, 0); });
    add("SB exhaustive",
        [=](const cv::Mat& g) { return by_sb(g, size, cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY); });
    if (size.width == size.height && has_mrgingham())
      add("mrgingham", [=](const cv::Mat& g) { return by_mrgingham(g, size.width); });
  } else if (const auto* charuco = std::get_if<Charuco>(&target.spec)) {
    add("OpenCV ChArUco", [b = *charuco](const cv::Mat& g) { return by_charuco(g, b); });
  } else if (const auto* grid = std::get_if<AprilGrid>(&target.spec)) {
    add("OpenCV ArUco", [b = *grid](const cv::Mat& g) { return by_aruco_grid(g, b); });
    add("AprilTag", [b = *grid](const cv::Mat& g) { return by_apriltag(g, b); });
  } else if (const auto* circles = std::get_if<Circles>(&target.spec)) {
    add("findCirclesGrid", [b = *circles](const cv::Mat& g) { return by_circles(g, b); });
  }
  return out;
}

}  // namespace plumbline::bench

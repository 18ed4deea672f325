// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/print.hpp"

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <regex>

#include "plumbline/synth/board.hpp"
#include "support/support.hpp"

namespace plumbline {
namespace {

const TargetSpec kBoards[] = {Chessboard{9, 6, 0.025}, Charuco{5, 7, 0.03, 0.022, "4X4_50", 0},
                              AprilGrid{4, 5, 0.03, 0.3}, Circles{7, 9, 0.02},
                              Circles{4, 11, 0.018, 0, true}};

Print print(const TargetSpec& spec, PrintFormat format, const std::string& page = "auto", int dpi = 300) {
  auto printed = print_target(*make_target(spec), {format, page, dpi});
  EXPECT_TRUE(printed) << printed.error().text();
  return *std::move(printed);
}

cv::Mat decode(const std::string& bytes) {
  return cv::imdecode(std::vector<unsigned char>(bytes.begin(), bytes.end()), cv::IMREAD_UNCHANGED);
}

// All numbers of the first path of an SVG that is filled black, in points, as pairs.
std::vector<Vec2> path_points(const std::string& svg) {
  const std::size_t style = svg.find("fill:rgb(0%,0%,0%)"), from = svg.find("d=\"", style) + 3;
  const std::string path = svg.substr(from, svg.find('"', from) - from);
  std::vector<double> numbers;
  const std::regex number("-?[0-9.]+");
  for (auto it = std::sregex_iterator(path.begin(), path.end(), number); it != std::sregex_iterator(); ++it) {
    numbers.push_back(std::stod(it->str()));
  }
  std::vector<Vec2> points;
  for (std::size_t i = 0; i + 1 < numbers.size(); i += 2) points.emplace_back(numbers[i], numbers[i + 1]);
  return points;
}

// Where a board's point must be on the page [mm]: the pattern stands in the middle.
Vec2 on_page_mm(const BoardDrawing& d, const Vec2& page_mm, const Vec2& p) {
  const Vec2 q = 1e3 * (p - 0.5 * (d.low + d.high));
  return 0.5 * page_mm + Vec2(q.x(), d.y_up ? -q.y() : q.y());
}

// Each corner of each box is a vertex of the path to 1/256 pt, and the page has its true size.
TEST(Print, SvgIsAtTrueScale) {
  for (const TargetSpec& spec : kBoards) {
    const Print printed = print(spec, PrintFormat::kSvg);
    const BoardDrawing d = draw_target(*make_target(spec))->at(0);
    const double pt = 25.4 / 72;
    std::smatch size;
    ASSERT_TRUE(
        std::regex_search(printed.bytes, size, std::regex("width=\"([0-9.]+)pt\" height=\"([0-9.]+)pt\"")));
    EXPECT_NEAR(std::stod(size[1]) * pt, printed.page_mm.x(), 1e-4);
    EXPECT_NEAR(std::stod(size[2]) * pt, printed.page_mm.y(), 1e-4);
    const auto vertices = path_points(printed.bytes);
    for (const Box& box : d.boxes) {
      for (const Vec2& corner : {box.low, box.high}) {
        const Vec2 expected = on_page_mm(d, printed.page_mm, corner);
        double nearest = 1e9;
        for (const Vec2& v : vertices) nearest = std::min(nearest, (pt * v - expected).cwiseAbs().maxCoeff());
        EXPECT_LT(nearest, 0.5 * pt / 256 + 1e-6);
      }
    }
  }
}

// The pixels of the PNG against the drawing: dark area and centroid of every shape's surroundings, at the
// PNG's own dpi.
TEST(Print, PngIsAtTrueScaleAndSaysItsResolution) {
  for (const TargetSpec& spec : kBoards) {
    const Print printed = print(spec, PrintFormat::kPng, "auto", 200);
    const cv::Mat image = decode(printed.bytes);
    ASSERT_EQ(image.type(), CV_8UC1);
    const double px_per_mm = 200 / 25.4;
    EXPECT_EQ(image.cols, std::lround(printed.page_mm.x() * px_per_mm));
    const std::size_t chunk = printed.bytes.find("pHYs");
    ASSERT_NE(chunk, std::string::npos);
    const auto byte = [&](int i) { return static_cast<unsigned char>(printed.bytes[chunk + 4 + i]); };
    EXPECT_EQ((byte(2) << 8) + byte(3), 7874);  // 200 dpi in pixels per metre
    EXPECT_EQ(byte(8), 1);

    const BoardDrawing d = draw_target(*make_target(spec))->at(0);
    int n_wrong = 0, n_seen = 0;
    const double step = d.size().x() / 397;
    for (double y = d.low.y(); y < d.high.y(); y += step) {
      for (double x = d.low.x(); x < d.high.x(); x += step) {
        // Away from edges by more than a pixel's diagonal.
        const double e = 1.5e-3 / px_per_mm;
        const bool black = is_black(d, {x, y});
        if (is_black(d, {x - e, y - e}) != black || is_black(d, {x + e, y + e}) != black ||
            is_black(d, {x - e, y + e}) != black || is_black(d, {x + e, y - e}) != black) {
          continue;
        }
        const Vec2 px = px_per_mm * on_page_mm(d, printed.page_mm, {x, y}) - Vec2::Constant(0.5);
        const int grey = image.at<unsigned char>(static_cast<int>(std::lround(px.y())),
                                                 static_cast<int>(std::lround(px.x())));
        n_wrong += grey != (black ? 0 : 255);
        ++n_seen;
      }
    }
    EXPECT_GT(n_seen, 50000);
    EXPECT_EQ(n_wrong, 0) << target_type(spec);
  }
}

// Edges of the PNG are grey by their share of the pixel: the column across the first edge of a chessboard.
TEST(Print, PngEdgesAreAreas) {
  const Chessboard spec{9, 6, 0.025};
  const Print printed = print(spec, PrintFormat::kPng, "A4", 150);
  const cv::Mat image = decode(printed.bytes);
  const double px_per_mm = 150 / 25.4;
  const double edge =
      px_per_mm * (0.5 * printed.page_mm.x() - 125);  // left edge of the pattern, corner convention
  const int column = static_cast<int>(edge),
            row = static_cast<int>(px_per_mm * (0.5 * printed.page_mm.y() - 87.5 + 12.5));
  const double white_share = edge - column;
  EXPECT_NEAR(image.at<unsigned char>(row, column), 255 * white_share, 2);
  EXPECT_EQ(image.at<unsigned char>(row, column - 1), 255);
  EXPECT_EQ(image.at<unsigned char>(row, column + 1), 0);
}

// poppler draws the PDF; what it draws must be our PNG. MediaBox is in points.
TEST(Print, PdfIsTheSamePicture) {
  const test::TempDir dir;
  for (const TargetSpec& spec : kBoards) {
    const Print pdf = print(spec, PrintFormat::kPdf), png = print(spec, PrintFormat::kPng, "auto", 100);
    std::smatch box;
    ASSERT_TRUE(std::regex_search(pdf.bytes, box, std::regex("/MediaBox \\[ 0 0 ([0-9.]+) ([0-9.]+) \\]")));
    EXPECT_NEAR(std::stod(box[1]) * 25.4 / 72, pdf.page_mm.x(), 1e-4);
    EXPECT_NEAR(std::stod(box[2]) * 25.4 / 72, pdf.page_mm.y(), 1e-4);
    if (test::run("command -v pdftocairo").exit_code != 0)
      GTEST_SKIP() << "pdftocairo (Debian: poppler-utils) is not here";
    test::write_text(dir / "board.pdf", pdf.bytes);
    const auto ran = test::run("pdftocairo -png -gray -r 100 -singlefile '" + (dir / "board.pdf").string() +
                               "' '" + (dir / "seen").string() + "'");
    ASSERT_EQ(ran.exit_code, 0) << ran.err;
    const cv::Mat seen = cv::imread((dir / "seen.png").string(), cv::IMREAD_GRAYSCALE),
                  ours = decode(png.bytes);
    ASSERT_LE(std::abs(seen.cols - ours.cols), 1);
    // Without the lower border, whose thin lines poppler draws thicker.
    const cv::Rect common(0, 0, std::min(seen.cols, ours.cols), static_cast<int>(0.93 * ours.rows));
    cv::Mat difference;
    cv::absdiff(seen(common), ours(common), difference);
    EXPECT_LT(cv::mean(difference)[0], 1.5) << target_type(spec);  // pdftocairo rounds edges to whole pixels
  }
}

TEST(Print, SameBoardSameBytes) {
  for (const auto format : {PrintFormat::kPdf, PrintFormat::kSvg, PrintFormat::kPng}) {
    for (const TargetSpec& spec : kBoards) EXPECT_EQ(print(spec, format).bytes, print(spec, format).bytes);
  }
  // The only date is the fixed one.
  const std::string pdf = print(kBoards[0], PrintFormat::kPdf).bytes;
  EXPECT_NE(pdf.find("/CreationDate (20000101000000Z)"), std::string::npos);
  EXPECT_EQ(pdf.find("/ModDate"), std::string::npos);
}

TEST(Print, ThePageIsChosenOrRefusedWithTheNextOneThatFits) {
  EXPECT_EQ(print(Chessboard{9, 6, 0.025}, PrintFormat::kPdf).page, "A4 landscape");
  EXPECT_EQ(print(Charuco{8, 11, 0.03, 0.022, "4X4_50"}, PrintFormat::kPdf).page, "A3");
  EXPECT_EQ(print(AprilGrid{6, 6, 0.088, 0.3}, PrintFormat::kPdf).page, "A0");
  EXPECT_EQ(print(Chessboard{9, 6, 0.025}, PrintFormat::kPdf, "letter").page, "letter landscape");
  EXPECT_EQ(print(Chessboard{9, 6, 0.025}, PrintFormat::kPdf, "300x300mm").page, "300x300mm");

  const Target big = *make_target(Charuco{8, 11, 0.03, 0.022, "4X4_50"});
  auto refused = print_target(big, {PrintFormat::kPdf, "A4"});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kInvalidData);
  EXPECT_NE(refused.error().message.find("250.0 x 340.0 mm"), std::string::npos) << refused.error().message;
  EXPECT_NE(refused.error().message.find("--page A3"), std::string::npos) << refused.error().message;
  refused = print_target(*make_target(AprilGrid{6, 6, 0.2, 0.3}));
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("1630x1630mm"), std::string::npos) << refused.error().message;
  for (const char* page : {"A9", "", "0x0mm", "axbmm", "300x", "nanxnanmm", "1e9x1e9mm"}) {
    const auto unknown = print_target(big, {PrintFormat::kPdf, page});
    ASSERT_FALSE(unknown) << page;
    EXPECT_EQ(unknown.error().code, ErrorCode::kInvalidData);
  }
}

TEST(Print, ARigIsOnePagePerPart) {
  const Charuco panel{5, 5, 0.03, 0.022, "4X4_50", 0};
  Charuco second = panel;
  second.first_id = 12;
  const TargetSpec rig = BoardRig{{{panel, SE3()}, {second, SE3(Mat3::Identity(), {0, 0, 1})}}};
  const Print pdf = print(rig, PrintFormat::kPdf), png = print(rig, PrintFormat::kPng, "auto", 72);
  EXPECT_EQ(pdf.n_pages, 2);
  EXPECT_NE(pdf.bytes.find("/Count 2"), std::string::npos);
  EXPECT_EQ(pdf.page, "A4");
  EXPECT_EQ(decode(png.bytes).cols, 2 * std::lround(210 * 72 / 25.4));
}

TEST(Print, WhatCannotBePrintedSaysSo) {
  const auto points = print_target(*make_target(Points3d{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}));
  ASSERT_FALSE(points);
  EXPECT_EQ(points.error().code, ErrorCode::kUnsupported);
  const auto huge = print_target(*make_target(AprilGrid{6, 6, 0.088, 0.3}), {PrintFormat::kPng, "A0", 1200});
  ASSERT_FALSE(huge);
  EXPECT_EQ(huge.error().code, ErrorCode::kUnsupported);
  EXPECT_EQ(print_format_of("a/b.pdf").value(), PrintFormat::kPdf);
  ASSERT_FALSE(print_format_of("board.bmp"));
}

}  // namespace
}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/synth/render.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "coverage.hpp"
#include "plumbline/core/check.hpp"
#include "plumbline/core/parallel.hpp"
#include "plumbline/core/random.hpp"

namespace plumbline {
namespace {

constexpr int kBandRows = 16;    // rows per task
constexpr int kSubsamples = 16;  // per axis, where areas cannot be exact

// A board in the camera frame. Its plane is z = 0 of the board frame.
struct Board {
  const BoardDrawing* drawing;
  detail::ShapeIndex index;
  Mat3 R_board_cam;
  Vec3 centre_board;  // of the camera
  bool front;         // the printed side is seen
  Vec2 sheet_low, sheet_high;

  Board(const BoardDrawing& d, const SE3& T_cam_target) : drawing(&d), index(d) {
    const SE3 T_board_cam = (T_cam_target * d.T_target_board).inverse();
    R_board_cam = T_board_cam.R();
    centre_board = T_board_cam.t();
    front = d.y_up ? centre_board.z() > 0 : centre_board.z() < 0;
    sheet_low = d.sheet_low();
    sheet_high = d.sheet_high();
  }
};

// Where a ray meets a board's plane; depth <= 0: nowhere.
struct Hit {
  Vec2 p = Vec2::Zero();
  double depth = 0;
};

Hit hit(const Board& board, const Vec3& ray_cam) {
  const Vec3 d = board.R_board_cam * ray_cam;
  const double t = -board.centre_board.z() / d.z();
  if (!(t > 0) || !std::isfinite(t)) return {};
  return {board.centre_board.head<2>() + t * d.head<2>(), t};
}

bool on_sheet(const Board& board, const Vec2& p) {
  return (p.array() >= board.sheet_low.array()).all() && (p.array() <= board.sheet_high.array()).all();
}

double ink(const Board& board, const Vec2& p, const RenderOptions& o) {
  if (!board.front) return o.back_grey;
  return board.index.is_black(p) ? o.black_grey : o.white_grey;
}

// One board, all of the pixel in front of the camera: exact areas.
double grey_of_area(const Board& board, const detail::Quad& quad, double background, const RenderOptions& o,
                    std::vector<int>& found) {
  const detail::PixelArea pixel(quad);
  const double sheet = pixel.in_box({board.sheet_low, board.sheet_high});
  const double paper = board.front ? o.white_grey : o.back_grey;
  double grey = background + sheet * (paper - background);
  if (!board.front) return grey;
  board.index.find(pixel.low(), pixel.high(), found);
  const int n_boxes = static_cast<int>(board.drawing->boxes.size());
  double black = 0;
  for (const int i : found) {
    black += i < n_boxes ? pixel.in_box(board.drawing->boxes[i])
                         : pixel.in_disc(board.drawing->discs[i - n_boxes]);
  }
  return grey + std::min(black, 1.0) * (o.black_grey - o.white_grey);
}

// Several boards, or a horizon: the mean of rays, each seeing its nearest sheet.
double grey_of_samples(const std::vector<Board>& boards, const std::array<Vec3, 4>& rays, double background,
                       const RenderOptions& o) {
  double sum = 0;
  for (int i = 0; i < kSubsamples * kSubsamples; ++i) {
    const double u = (i % kSubsamples + 0.5) / kSubsamples, v = (i / kSubsamples + 0.5) / kSubsamples;
    const Vec3 ray = (1 - v) * ((1 - u) * rays[0] + u * rays[1]) + v * (u * rays[2] + (1 - u) * rays[3]);
    double grey = background, nearest = INFINITY;
    for (const Board& board : boards) {
      const Hit h = hit(board, ray);
      if (!(h.depth > 0) || h.depth >= nearest || !on_sheet(board, h.p)) continue;
      nearest = h.depth;
      grey = ink(board, h.p, o);
    }
    sum += grey;
  }
  return sum / (kSubsamples * kSubsamples);
}

// The hits of one row of pixel corners, board after board.
void trace_row(const std::vector<Board>& boards, const CameraRays& rays, int row, std::vector<Hit>& hits) {
  const int n = rays.size.width + 1;
  hits.resize(boards.size() * static_cast<std::size_t>(n));
  const Vec3* ray = rays.rays.data() + static_cast<std::size_t>(row) * n;
  for (std::size_t b = 0; b < boards.size(); ++b) {
    for (int c = 0; c < n; ++c) hits[b * n + c] = hit(boards[b], ray[c]);
  }
}

// A pixel's relation to one board.
enum class Touch { kNone, kWhole, kPartly };

Touch touch(const Board& board, const Hit& a, const Hit& b, const Hit& c, const Hit& d) {
  const int n = (a.depth > 0) + (b.depth > 0) + (c.depth > 0) + (d.depth > 0);
  if (n == 0) return Touch::kNone;
  if (n < 4) return Touch::kPartly;
  const Vec2 low = a.p.cwiseMin(b.p).cwiseMin(c.p).cwiseMin(d.p),
             high = a.p.cwiseMax(b.p).cwiseMax(c.p).cwiseMax(d.p);
  if ((high.array() <= board.sheet_low.array()).any() || (low.array() >= board.sheet_high.array()).any()) {
    return Touch::kNone;
  }
  return Touch::kWhole;
}

void render_row(const std::vector<Board>& boards, const CameraRays& rays, int row,
                const std::vector<Hit>& top, const std::vector<Hit>& bottom, float* out,
                const RenderOptions& o, std::vector<int>& found) {
  const int n = rays.size.width + 1;
  const Vec3* above = rays.rays.data() + static_cast<std::size_t>(row) * n;
  const Vec3* below = above + n;
  for (int c = 0; c < rays.size.width; ++c) {
    const double background = out[c];
    const std::array<Vec3, 4> corner{above[c], above[c + 1], below[c + 1], below[c]};
    if (std::any_of(corner.begin(), corner.end(), [](const Vec3& ray) { return ray.isZero(0); })) continue;
    int n_touched = 0;
    bool exact = true;
    std::size_t touched = 0;
    for (std::size_t b = 0; b < boards.size(); ++b) {
      const std::size_t k = b * n + c;
      const Touch t = touch(boards[b], top[k], top[k + 1], bottom[k + 1], bottom[k]);
      if (t == Touch::kNone) continue;
      exact = exact && t == Touch::kWhole;
      touched = b;
      ++n_touched;
    }
    if (n_touched == 0) continue;
    const std::size_t k = touched * n + c;
    out[c] = static_cast<float>(n_touched == 1 && exact
                                    ? grey_of_area(boards[touched],
                                                   {top[k].p, top[k + 1].p, bottom[k + 1].p, bottom[k].p},
                                                   background, o, found)
                                    : grey_of_samples(boards, corner, background, o));
  }
}

// Smooth blotches: random values on a grid of 24 px, joined by cubic interpolation.
cv::Mat background(ImageSize size, const RenderOptions& o) {
  cv::Mat image(size.height, size.width, CV_32FC1, cv::Scalar(o.background_grey));
  if (!(o.texture_grey > 0)) return image;
  Rng rng(o.seed ^ 0x7465787475726500ULL);
  cv::Mat coarse(size.height / 24 + 2, size.width / 24 + 2, CV_32FC1), fine;
  for (int r = 0; r < coarse.rows; ++r) {
    for (int c = 0; c < coarse.cols; ++c)
      coarse.at<float>(r, c) = static_cast<float>(rng.uniform(-o.texture_grey, o.texture_grey));
  }
  cv::resize(coarse, fine, image.size(), 0, 0, cv::INTER_CUBIC);
  image += fine;
  return image;
}

void darken_corners(cv::Mat& image, const RenderOptions& o) {
  const double cx = 0.5 * (image.cols - 1), cy = 0.5 * (image.rows - 1), rr = cx * cx + cy * cy;
  for (int r = 0; r < image.rows; ++r) {
    float* row = image.ptr<float>(r);
    for (int c = 0; c < image.cols; ++c) {
      row[c] *= static_cast<float>(1 - o.vignetting * ((c - cx) * (c - cx) + (r - cy) * (r - cy)) / rr);
    }
  }
}

}  // namespace

CameraRays camera_rays(const Lens& lens, ImageSize size, int n_threads) {
  PLUMBLINE_CHECK(size.width > 0 && size.height > 0, "camera_rays: the image has no size");
  CameraRays rays{size, {}};
  const int n = size.width + 1;
  rays.rays.assign(static_cast<std::size_t>(n) * (size.height + 1), Vec3::Zero());
  parallel_for(size.height + 1, n_threads, [&](int r) {
    for (int c = 0; c < n; ++c) {
      if (const auto ray = unproject(lens, Vec2(c - 0.5, r - 0.5)))
        rays.rays[static_cast<std::size_t>(r) * n + c] = *ray;
    }
  });
  return rays;
}

cv::Mat render_grey_levels(const std::vector<BoardDrawing>& drawings, const CameraRays& rays,
                           const SE3& T_cam_target, const RenderOptions& options) {
  const int width = rays.size.width, height = rays.size.height;  // no binding: clang 14 cannot capture one
  PLUMBLINE_CHECK(rays.rays.size() == static_cast<std::size_t>(width + 1) * (height + 1),
                  "render: rays do not fit the size");
  std::vector<Board> boards;
  boards.reserve(drawings.size());
  for (const BoardDrawing& drawing : drawings) boards.emplace_back(drawing, T_cam_target);

  cv::Mat image = background(rays.size, options);
  parallel_for((height + kBandRows - 1) / kBandRows, options.n_threads, [&](int band) {
    std::vector<Hit> top, bottom;
    std::vector<int> found;
    trace_row(boards, rays, band * kBandRows, bottom);
    for (int r = band * kBandRows; r < std::min(height, (band + 1) * kBandRows); ++r) {
      std::swap(top, bottom);
      trace_row(boards, rays, r + 1, bottom);
      render_row(boards, rays, r, top, bottom, image.ptr<float>(r), options, found);
    }
  });
  if (options.blur_sigma_px > 0) {
    const int radius = std::max(1, static_cast<int>(std::ceil(4 * options.blur_sigma_px)));
    cv::GaussianBlur(image, image, cv::Size(2 * radius + 1, 2 * radius + 1), options.blur_sigma_px,
                     options.blur_sigma_px, cv::BORDER_REPLICATE);
  }
  if (options.vignetting > 0) darken_corners(image, options);
  return image;
}

cv::Mat render(const std::vector<BoardDrawing>& drawings, const CameraRays& rays, const SE3& T_cam_target,
               const RenderOptions& options) {
  cv::Mat levels = render_grey_levels(drawings, rays, T_cam_target, options);
  if (options.noise_grey > 0) {
    parallel_for(levels.rows, options.n_threads, [&](int r) {
      Rng rng(options.seed * 0x9E3779B97F4A7C15ULL + static_cast<std::uint64_t>(r) * 0xD1B54A32D192ED03ULL +
              1);
      float* row = levels.ptr<float>(r);
      for (int c = 0; c < levels.cols; ++c) row[c] += static_cast<float>(rng.normal(options.noise_grey));
    });
  }
  cv::Mat image;
  levels.convertTo(image, CV_8U);
  return image;
}

}  // namespace plumbline

// SPDX-License-Identifier: Apache-2.0
#include "plumbline/rectify/remap.hpp"

#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "plumbline/core/parallel.hpp"
#include "plumbline/rig/validity.hpp"

// A map is smooth: the lens is evaluated at the nodes of a grid of kTile pixels, and inside a tile the map is
// the bicubic polynomial through its 4 x 4 nodes (Lagrange). Each tile is compared with the lens in its
// middle, where the error is largest; a tile that is off by more than kTolerance_px, or touches the end of
// the lens' domain or of the camera's validity, is evaluated pixel by pixel instead.
namespace plumbline {
namespace {

constexpr int kTile = 16;
constexpr double kTolerance_px = 5e-5;

struct Mapping {
  const Camera& camera;
  Mat3 ray_of_px;
  ImageSize size;

  // NaN where the lens says nothing.
  Vec2 at(double col, double row) const {
    const auto px = project(camera, ray_of_px * Vec3(col, row, 1));
    return px ? *px : Vec2::Constant(std::numeric_limits<double>::quiet_NaN());
  }
  template <class Number>
  bool inside(Number x, Number y) const {
    return x >= Number(-0.5) && y >= Number(-0.5) && x <= Number(camera.size.width - 0.5) &&
           y <= Number(camera.size.height - 0.5);
  }
};

// Node (i, j) stands at pixel (kTile (j - 1), kTile (i - 1)): one ring more than the tiles have corners.
struct Nodes {
  int rows = 0, cols = 0;
  std::vector<double> x, y;
};

Nodes evaluate_nodes(const Mapping& map, int n_threads) {
  Nodes nodes;
  nodes.rows = (map.size.height + kTile - 1) / kTile + 3;
  nodes.cols = (map.size.width + kTile - 1) / kTile + 3;
  nodes.x.resize(static_cast<std::size_t>(nodes.rows) * nodes.cols);
  nodes.y.resize(nodes.x.size());
  parallel_for(nodes.rows, n_threads, [&](int i) {
    for (int j = 0; j < nodes.cols; ++j) {
      const Vec2 px = map.at(kTile * (j - 1), kTile * (i - 1));
      nodes.x[static_cast<std::size_t>(i) * nodes.cols + j] = px.x();
      nodes.y[static_cast<std::size_t>(i) * nodes.cols + j] = px.y();
    }
  });
  return nodes;
}

// Weights of the values at -1, 0, 1, 2 in their cubic at t.
std::array<double, 4> cubic_weights(double t) {
  return {-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2,
          (t + 1) * t * (t - 1) / 6};
}

enum class TileKind : char { kInside, kMixed, kExact };

// How far the tile's polynomial is from the lens at (t, u) of the tile whose top-left node is (i, j) [px];
// NaN where a node or the lens says nothing.
double error_px(const Mapping& map, const Nodes& nodes, int i, int j, double t, double u) {
  const std::array<double, 4> across = cubic_weights(t), down = cubic_weights(u);
  Vec2 sum = Vec2::Zero();
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < 4; ++b) {
      const std::size_t k = static_cast<std::size_t>(i - 1 + a) * nodes.cols + (j - 1 + b);
      sum += down[a] * across[b] * Vec2(nodes.x[k], nodes.y[k]);
    }
  }
  return (map.at(kTile * (j - 1 + t), kTile * (i - 1 + u)) - sum).norm();
}

TileKind classify(const Mapping& map, const Nodes& nodes, int i, int j) {
  // The second place is there for the tiles in whose middle the error happens to change its sign.
  if (!(error_px(map, nodes, i, j, 0.5, 0.5) <= kTolerance_px) ||
      !(error_px(map, nodes, i, j, 0.3, 0.65) <= kTolerance_px)) {
    return TileKind::kExact;
  }
  bool all_inside = true;
  for (int a = -1; a < 3; ++a) {
    for (int b = -1; b < 3; ++b) {
      const std::size_t k = static_cast<std::size_t>(i + a) * nodes.cols + (j + b);
      all_inside = all_inside && map.inside(nodes.x[k], nodes.y[k]);
    }
  }
  return all_inside ? TileKind::kInside : TileKind::kMixed;
}

// out[k] = the cubic through v[0..3] at t = k / kTile. In single precision: within two units in the last
// place.
void fill_cubic(const double* v, float* out, int n) {
  const float c0 = static_cast<float>(v[1]);
  const float c1 = static_cast<float>(-v[0] / 3 - v[1] / 2 + v[2] - v[3] / 6) / kTile;
  const float c2 = static_cast<float>(v[0] / 2 - v[1] + v[2] / 2) / (kTile * kTile);
  const float c3 = static_cast<float>((v[1] - v[2]) / 2 + (v[3] - v[0]) / 6) / (kTile * kTile * kTile);
  const auto cubic = [=](int k) {
    const float t = static_cast<float>(k);
    return c0 + t * (c1 + t * (c2 + t * c3));
  };
  if (n == kTile) {  // a count that the compiler knows
    for (int k = 0; k < kTile; ++k) out[k] = cubic(k);
  } else {
    for (int k = 0; k < n; ++k) out[k] = cubic(k);
  }
}

// Without branches, so that the compiler can take four pixels at a time.
int count_inside(const Mapping& map, const float* x, const float* y, int n) {
  const float right = static_cast<float>(map.camera.size.width - 0.5);
  const float bottom = static_cast<float>(map.camera.size.height - 0.5);
  int inside = 0;
  for (int k = 0; k < n; ++k)
    inside += (x[k] >= -0.5F) & (y[k] >= -0.5F) & (x[k] <= right) & (y[k] <= bottom);
  return inside;
}

// Fills rows [first, last) of the tile row whose top nodes are row i; returns how many pixels look inside the
// image.
int fill_tile_row(const Mapping& map, const Nodes& nodes, int i, cv::Mat& map_x, cv::Mat& map_y) {
  const int n_tiles = nodes.cols - 3, first = kTile * (i - 1),
            last = std::min(first + kTile, map.size.height);
  std::vector<TileKind> kinds(n_tiles);
  for (int tile = 0; tile < n_tiles; ++tile) kinds[tile] = classify(map, nodes, i, tile + 1);
  std::vector<double> line_x(nodes.cols), line_y(nodes.cols);
  int n_inside = 0;
  for (int row = first; row < last; ++row) {
    const std::array<double, 4> w = cubic_weights(static_cast<double>(row - first) / kTile);
    const double* nx = &nodes.x[static_cast<std::size_t>(i - 1) * nodes.cols];
    const double* ny = &nodes.y[static_cast<std::size_t>(i - 1) * nodes.cols];
    const int n = nodes.cols;
    for (int j = 0; j < n; ++j) {
      line_x[j] = w[0] * nx[j] + w[1] * nx[j + n] + w[2] * nx[j + 2 * n] + w[3] * nx[j + 3 * n];
      line_y[j] = w[0] * ny[j] + w[1] * ny[j + n] + w[2] * ny[j + 2 * n] + w[3] * ny[j + 3 * n];
    }
    float *x = map_x.ptr<float>(row), *y = map_y.ptr<float>(row);
    for (int tile = 0; tile < n_tiles; ++tile) {
      const int col = kTile * tile, width = std::min(kTile, map.size.width - col);
      if (kinds[tile] == TileKind::kExact) {
        for (int k = col; k < col + width; ++k) {
          const Vec2 px = map.at(k, row);
          const bool seen = px.x() == px.x();
          x[k] = seen ? static_cast<float>(px.x()) : -1.0F;
          y[k] = seen ? static_cast<float>(px.y()) : -1.0F;
          n_inside += seen && map.inside(px.x(), px.y());
        }
        continue;
      }
      fill_cubic(&line_x[tile], x + col, width);
      fill_cubic(&line_y[tile], y + col, width);
      if (kinds[tile] == TileKind::kInside)
        n_inside += width;
      else {
        n_inside += count_inside(map, x + col, y + col, width);
      }
    }
  }
  return n_inside;
}

}  // namespace

RemapMaps remap_maps(const Camera& camera, const Mat3& R_new_cam, const Mat3& K_new, ImageSize new_size,
                     int n_threads) {
  PLUMBLINE_CHECK(new_size.width > 0 && new_size.height > 0, "the new image has a size");
  RemapMaps maps;
  maps.x.create(new_size.height, new_size.width, CV_32FC1);
  maps.y.create(new_size.height, new_size.width, CV_32FC1);
  const Mapping map{camera, R_new_cam.transpose() * K_new.inverse(), new_size};
  const Nodes nodes = evaluate_nodes(map, n_threads);
  std::vector<int> inside(nodes.rows - 3, 0);
  parallel_for(nodes.rows - 3, n_threads, [&](int tile_row) {
    inside[tile_row] = fill_tile_row(map, nodes, tile_row + 1, maps.x, maps.y);
  });
  double sum = 0;
  for (int n : inside) sum += n;
  maps.valid_fraction = sum / (static_cast<double>(new_size.width) * new_size.height);
  return maps;
}

RemapMaps rectification_maps(const StereoRectification& rectification, const Camera& camera, int which,
                             int n_threads) {
  PLUMBLINE_CHECK(which == 0 || which == 1, "a rectified pair has cameras 0 and 1");
  return remap_maps(camera, rectification.R_rect_cam[which], rectification.P[which].leftCols<3>(),
                    rectification.size, n_threads);
}

cv::Mat remap_image(const cv::Mat& image, const RemapMaps& maps) {
  PLUMBLINE_CHECK(!image.empty() && !maps.x.empty(), "an image and its maps");
  cv::Mat out;
  cv::remap(image, out, maps.x, maps.y, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar::all(0));
  return out;
}

}  // namespace plumbline

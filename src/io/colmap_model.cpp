// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <set>
#include <unordered_map>

#include "io/dataset_yaml.hpp"
#include "io/formats/colmap.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/io/reconstruction_io.hpp"

/// images.txt and points3D.txt beside cameras.txt (formats/colmap.cpp).
namespace plumbline {
namespace {

using io::number_text;
using Words = std::vector<std::string_view>;

constexpr double kUnitQuaternion = 0.01;  ///< files by hand may round; COLMAP normalises too
constexpr double kExactQuaternion =
    1e-15;  ///< nearer than this, normalising again would only change the last digit

Error bad_line(const std::string& file, int line, std::string message) {
  return {ErrorCode::kParse, std::move(message), fmt::format("{}: line {}", file, line)};
}

std::optional<std::int64_t> parse_id(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::string quoted(std::string_view word) { return fmt::format("'{}'", word.substr(0, 40)); }

struct Reader {
  Reconstruction scene;
  std::unordered_map<std::int64_t, int> camera_of, view_of, point_of;  // by id
  std::vector<std::vector<std::int64_t>> key_points;  // per view: the point's id, -1 for none
  std::size_t n_tracked = 0;                          // 2D points with a scene point

  Status read_cameras(const NamedBytes& file);
  Status read_points(const NamedBytes& file);
  Status read_images(const NamedBytes& file);
  Status check_tracks(const NamedBytes& file) const;

 private:
  Status read_point(const std::string& file, int line, const Words& words);
  Status read_image(const std::string& file, int line, const Words& words);
  Status read_key_points(const std::string& file, int line, const Words& words);
};

// Calls row(line, words) for each row that is no remark, until it fails, and compares with what the remark
// "# Number of WHAT: n" says.
template <class Row>
Status read_rows(const NamedBytes& file, std::string_view what, Row&& row, const int& n_read) {
  std::optional<Error> failed;
  std::optional<int> n_said;
  io::for_each_row(file.bytes, [&](int line, const Words& words) {
    if (words.size() >= 5 && words[0] == "#" && words[1] == "Number" && words[3] == what)
      n_said = parse_int(words[4].substr(0, words[4].find(',')));
    if (failed || words[0].front() == '#') return;
    if (Status read = row(line, words); !read) failed = read.error();
  });
  if (failed) return *failed;
  if (n_said.value_or(n_read) == n_read && file.bytes.ends_with('\n')) return {};
  return Error{
      ErrorCode::kParse,
      fmt::format("it has not as many {} as it says ({} read), or its last line does not end; is it cut off?",
                  what.substr(0, what.size() - 1), n_read),
      file.name};
}

Status Reader::read_cameras(const NamedBytes& file) {
  const std::vector<NamedBytes> files{file};
  auto rig = io::kColmapFormat.read(files);
  if (!rig) return rig.error();
  for (Camera& camera : rig->cameras) {
    const auto id = parse_id(std::string_view(camera.name).substr(std::string_view("camera").size()));
    if (!id || *id < 0 || !camera_of.emplace(*id, static_cast<int>(scene.cameras.size())).second)
      return Error{ErrorCode::kParse, "the ids of cameras are different whole numbers",
                   file.name + ": " + camera.name};
    scene.cameras.push_back(std::move(camera));
  }
  return {};
}

Status Reader::read_point(const std::string& file, int line, const Words& words) {
  if (words.size() < 8 || words.size() % 2 != 0)
    return bad_line(file, line, "POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID POINT2D_IDX) are needed");
  const auto id = parse_id(words[0]);
  if (!id || *id < 0 || !point_of.emplace(*id, static_cast<int>(scene.p_world.size())).second)
    return bad_line(file, line, "an id that no other point has is needed, not " + quoted(words[0]));
  Vec3 p;
  PointTag tag{*id, {}};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto value = parse_double(words[1 + i]);
    const auto colour = parse_int(words[4 + i]);
    if (!value) return bad_line(file, line, "a finite coordinate is needed, not " + quoted(words[1 + i]));
    if (!colour || *colour < 0 || *colour > 255)
      return bad_line(file, line, "a colour from 0 to 255 is needed, not " + quoted(words[4 + i]));
    p[static_cast<Eigen::Index>(i)] = *value;
    tag.rgb[i] = static_cast<std::uint8_t>(*colour);
  }
  scene.p_world.push_back(p);
  scene.tags.push_back(tag);
  return {};
}

Status Reader::read_points(const NamedBytes& file) {
  int n_read = 0;
  return read_rows(
      file, "points:",
      [&](int line, const Words& words) {
        ++n_read;
        return read_point(file.name, line, words);
      },
      n_read);
}

Status Reader::read_image(const std::string& file, int line, const Words& words) {
  if (words.size() < 10)
    return bad_line(file, line, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME are needed");
  ReconstructionView view;
  const auto id = parse_id(words[0]), camera_id = parse_id(words[8]);
  if (!id || *id < 0 || !view_of.emplace(*id, static_cast<int>(scene.views.size())).second)
    return bad_line(file, line, "an id that no other image has is needed, not " + quoted(words[0]));
  const auto camera = camera_id ? camera_of.find(*camera_id) : camera_of.end();
  if (camera == camera_of.end())
    return bad_line(file, line, fmt::format("camera {} is not in cameras.txt", quoted(words[8])));
  for (std::size_t i = 0; i < 7; ++i) {
    const auto value = parse_double(words[1 + i]);
    if (!value) return bad_line(file, line, "a finite number is needed, not " + quoted(words[1 + i]));
    view.T_cam_world.qt[i] = *value;
  }
  auto& qt = view.T_cam_world.qt;
  const double norm = std::hypot(std::hypot(qt[0], qt[1]), std::hypot(qt[2], qt[3]));
  if (!(std::abs(norm - 1) < kUnitQuaternion))
    return bad_line(file, line, fmt::format("a unit quaternion is needed, its length is {}", norm));
  if (std::abs(norm - 1) > kExactQuaternion)
    for (std::size_t i = 0; i < 4; ++i) qt[i] /= norm;
  view.id = *id;
  view.camera = camera->second;
  // The name is the rest of the line, blanks and all.
  view.image = std::string(words[9].data(), words.back().data() + words.back().size());
  scene.views.push_back(std::move(view));
  key_points.emplace_back();
  return {};
}

Status Reader::read_key_points(const std::string& file, int line, const Words& words) {
  if (words.size() % 3 != 0) return bad_line(file, line, "POINTS2D[] as (X Y POINT3D_ID) are needed");
  for (std::size_t i = 0; i < words.size(); i += 3) {
    const auto x = parse_double(words[i]), y = parse_double(words[i + 1]);
    const auto id = parse_id(words[i + 2]);
    if (!x || !y)
      return bad_line(
          file, line,
          fmt::format("a pixel is needed, not '{} {}'", words[i].substr(0, 40), words[i + 1].substr(0, 40)));
    if (!id || *id < -1) return bad_line(file, line, "an id or -1 is needed, not " + quoted(words[i + 2]));
    key_points.back().push_back(*id);
    if (*id == -1) continue;
    const auto point = point_of.find(*id);
    if (point == point_of.end())
      return bad_line(file, line, fmt::format("point {} is not in points3D.txt", *id));
    ++n_tracked;
    scene.sightings.push_back({static_cast<int>(scene.views.size()) - 1, point->second,
                               Vec2(*x - io::kColmapPixelShift, *y - io::kColmapPixelShift), 1.0});
  }
  return {};
}

Status Reader::read_images(const NamedBytes& file) {
  // Two lines for each image; the second is blank where an image has no points, and blank lines are not rows.
  int n_read = 0, points_line = 0;
  return read_rows(
      file, "images:",
      [&](int line, const Words& words) {
        if (line == points_line) return read_key_points(file.name, line, words);
        ++n_read;
        points_line = line + 1;
        return read_image(file.name, line, words);
      },
      n_read);
}

// The same matches stand in both files: they must agree, which also finds a file that was cut off.
Status Reader::check_tracks(const NamedBytes& file) const {
  std::optional<Error> failed;
  std::size_t n_seen = 0;
  io::for_each_row(file.bytes, [&](int line, const Words& words) {
    if (failed || words[0].front() == '#') return;
    const auto id = parse_id(words[0]);
    for (std::size_t i = 8; i + 1 < words.size() && !failed; i += 2, ++n_seen) {
      const auto image = parse_id(words[i]), index = parse_id(words[i + 1]);
      const auto view = image ? view_of.find(*image) : view_of.end();
      const auto* points = view == view_of.end() ? nullptr : &key_points[view->second];
      if (!points || !index || *index < 0 || *index >= static_cast<std::int64_t>(points->size()) ||
          (*points)[static_cast<std::size_t>(*index)] != *id) {
        failed = bad_line(file.name, line,
                          fmt::format("image {} has no point {} that is this one's, by images.txt",
                                      quoted(words[i]), quoted(words[i + 1])));
      }
    }
  });
  if (failed) return *failed;
  if (n_seen == n_tracked) return {};
  return Error{
      ErrorCode::kParse,
      fmt::format("its tracks name {} points of images, images.txt has {} with a POINT3D_ID; the files do "
                  "not belong together, or one is cut off",
                  n_seen, n_tracked),
      file.name};
}

const NamedBytes* find_file(std::span<const NamedBytes> files, std::string_view name) {
  for (const NamedBytes& file : files) {
    if (file.name == name || file.name.ends_with("/" + std::string(name))) return &file;
  }
  return nullptr;
}

// Ids as they came, or 1, 2, ... where one is missing or there twice. (0 is one of ours and not of COLMAP's.)
std::vector<std::int64_t> ids_or_numbers(std::vector<std::int64_t> ids) {
  const std::set<std::int64_t> distinct(ids.begin(), ids.end());
  if (distinct.size() == ids.size() && (ids.empty() || *distinct.begin() > 0)) return ids;
  for (std::size_t i = 0; i < ids.size(); ++i) ids[i] = static_cast<std::int64_t>(i) + 1;
  return ids;
}

struct Ids {
  std::vector<std::int64_t> camera, view, point;
};

Ids ids_of(const Reconstruction& scene) {
  Ids ids;
  constexpr std::string_view kPrefix = "camera";
  for (const Camera& camera : scene.cameras) {
    const bool ours = camera.name.starts_with(kPrefix);
    ids.camera.push_back(ours ? parse_id(std::string_view(camera.name).substr(kPrefix.size())).value_or(-1)
                              : -1);
  }
  for (const ReconstructionView& view : scene.views) ids.view.push_back(view.id);
  for (std::size_t p = 0; p < scene.p_world.size(); ++p)
    ids.point.push_back(scene.tags.empty() ? -1 : scene.tags[p].id);
  return {ids_or_numbers(std::move(ids.camera)), ids_or_numbers(std::move(ids.view)),
          ids_or_numbers(std::move(ids.point))};
}

Result<std::string> cameras_text(const Reconstruction& scene, const Ids& ids) {
  std::string out = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  out += fmt::format("# Number of cameras: {}\n", scene.cameras.size());
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    const Camera& camera = scene.cameras[c];
    if (camera.size.width < 1 || camera.size.height < 1) {
      return Error{ErrorCode::kUnsupported,
                   "COLMAP's model needs the size of the images, and this camera has none (BAL problems say "
                   "nothing of it); write a BAL problem instead",
                   "camera " + camera.name};
    }
    const auto line = io::colmap_camera_line(ids.camera[c], camera);
    if (!line) return line.error();
    out += *line;
  }
  return out;
}

// Sightings of each view, and where each sighting stands in its view's list.
struct Lists {
  std::vector<std::vector<std::size_t>> of_view, of_point;
  std::vector<std::size_t> place;
};

Lists lists_of(const Reconstruction& scene) {
  Lists lists{std::vector<std::vector<std::size_t>>(scene.views.size()),
              std::vector<std::vector<std::size_t>>(scene.p_world.size()),
              {}};
  for (std::size_t i = 0; i < scene.sightings.size(); ++i) {
    auto& list = lists.of_view[scene.sightings[i].view];
    lists.place.push_back(list.size());
    list.push_back(i);
    lists.of_point[scene.sightings[i].point].push_back(i);
  }
  return lists;
}

double mean_per(std::size_t all, std::size_t n) {
  return n > 0 ? static_cast<double>(all) / static_cast<double>(n) : 0.0;
}

Result<std::string> images_text(const Reconstruction& scene, const Ids& ids, const Lists& lists) {
  std::string out =
      "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n";
  out += fmt::format("# Number of images: {}, mean observations per image: {}\n", scene.views.size(),
                     number_text(mean_per(scene.sightings.size(), scene.views.size())));
  for (std::size_t v = 0; v < scene.views.size(); ++v) {
    const ReconstructionView& view = scene.views[v];
    if (view.image.find_first_of("\n\r") != std::string::npos || trim(view.image) != view.image) {
      return Error{ErrorCode::kUnsupported,
                   "COLMAP's model cannot hold a name with a line break or blanks at its ends",
                   fmt::format("view {}", v)};
    }
    out += std::to_string(ids.view[v]);
    for (double value : view.T_cam_world.qt) out += " " + number_text(value);
    out += fmt::format(" {} {}\n", ids.camera[view.camera],
                       view.image.empty() ? fmt::format("view{}", v) : view.image);
    const char* separator = "";
    for (std::size_t i : lists.of_view[v]) {
      const Sighting& s = scene.sightings[i];
      out += fmt::format("{}{} {} {}", separator, number_text(s.px.x() + io::kColmapPixelShift),
                         number_text(s.px.y() + io::kColmapPixelShift), ids.point[s.point]);
      separator = " ";
    }
    out += "\n";
  }
  return out;
}

// The mean distance of a point's sightings from its projections, -1 where there is none.
double mean_error_px(const Reconstruction& scene, const std::vector<std::size_t>& sightings) {
  double sum = 0;
  int n = 0;
  for (std::size_t i : sightings) {
    const auto px = predict(scene, scene.sightings[i]);
    if (px) sum += (*px - scene.sightings[i].px).norm(), ++n;
  }
  return n > 0 ? sum / n : -1;
}

std::string points_text(const Reconstruction& scene, const Ids& ids, const Lists& lists) {
  std::string out = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
  out += fmt::format("# Number of points: {}, mean track length: {}\n", scene.p_world.size(),
                     number_text(mean_per(scene.sightings.size(), scene.p_world.size())));
  for (std::size_t p = 0; p < scene.p_world.size(); ++p) {
    const PointTag tag = scene.tags.empty() ? PointTag{} : scene.tags[p];
    out += std::to_string(ids.point[p]);
    for (double value : scene.p_world[p]) out += " " + number_text(value);
    out += fmt::format(" {} {} {} {}", tag.rgb[0], tag.rgb[1], tag.rgb[2],
                       number_text(mean_error_px(scene, lists.of_point[p])));
    for (std::size_t i : lists.of_point[p])
      out += fmt::format(" {} {}", ids.view[scene.sightings[i].view], lists.place[i]);
    out += "\n";
  }
  return out;
}

}  // namespace

Result<Reconstruction> parse_colmap_model(std::span<const NamedBytes> files) {
  Reader reader;
  const NamedBytes* found[3] = {};
  constexpr std::string_view kNames[] = {"cameras.txt", "images.txt", "points3D.txt"};
  for (int i = 0; i < 3; ++i) {
    found[i] = find_file(files, kNames[i]);
    if (!found[i])
      return Error{
          ErrorCode::kInvalidData,
          fmt::format("COLMAP's text model is cameras.txt, images.txt and points3D.txt; there is no {} "
                      "(a binary model becomes text with colmap model_converter --output_type TXT)",
                      kNames[i]),
          "COLMAP model"};
  }
  if (Status s = reader.read_cameras(*found[0]); !s) return s.error();
  if (Status s = reader.read_points(*found[2]); !s) return s.error();
  if (Status s = reader.read_images(*found[1]); !s) return s.error();
  if (Status s = reader.check_tracks(*found[2]); !s) return s.error();
  return std::move(reader.scene);
}

Result<std::vector<NamedBytes>> format_colmap_model(const Reconstruction& scene) {
  const Ids ids = ids_of(scene);
  const Lists lists = lists_of(scene);
  auto cameras = cameras_text(scene, ids);
  if (!cameras) return cameras.error();
  auto images = images_text(scene, ids, lists);
  if (!images) return images.error();
  return std::vector<NamedBytes>{{"cameras.txt", *std::move(cameras)},
                                 {"images.txt", *std::move(images)},
                                 {"points3D.txt", points_text(scene, ids, lists)}};
}

}  // namespace plumbline

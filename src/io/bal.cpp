// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>

#include "io/formats/common.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/geometry/so3.hpp"
#include "plumbline/io/reconstruction_io.hpp"

namespace plumbline {
namespace {

constexpr int kCameraNumbers = 9;  // rotation vector, translation, f, k1, k2

// The half turn about x between a camera that looks down -z with y up and one that looks down z with y down.
Mat3 half_turn() { return Vec3(1, -1, -1).asDiagonal(); }

// Words of a text with the number of their line. After the first fault nothing more is read.
class Words {
 public:
  explicit Words(std::string_view text) : rest_(text) {}

  std::string_view next() {
    while (!rest_.empty() && is_blank(rest_.front())) {
      if (rest_.front() == '\n') ++line_;
      rest_.remove_prefix(1);
    }
    std::size_t n = 0;
    while (n < rest_.size() && !is_blank(rest_[n])) ++n;
    const std::string_view word = rest_.substr(0, n);
    rest_.remove_prefix(n);
    return word;
  }
  double number() {
    if (error_) return 0;
    const std::string_view word = next();
    const auto value = parse_double(word);
    if (!value) fail("a finite number", word);
    return value.value_or(0);
  }
  int whole(int end, const char* what) {
    if (error_) return 0;
    const std::string_view word = next();
    const auto value = parse_int(word);
    if (!value || *value < 0 || *value >= end) fail(fmt::format("{} from 0 to {}", what, end - 1), word);
    return value.value_or(0);
  }
  void fail(const std::string& needed, std::string_view word) {
    fail_with(fmt::format("{} is needed, {}", needed,
                          word.empty() ? "and the file ends" : fmt::format("not '{}'", word.substr(0, 40))));
  }
  void fail_with(std::string message) {
    if (!error_) error_ = Error{ErrorCode::kParse, std::move(message), fmt::format("line {}", line_)};
  }
  const std::optional<Error>& error() const { return error_; }

 private:
  static bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }
  std::string_view rest_;
  int line_ = 1;
  std::optional<Error> error_;
};

struct Counts {
  int cameras = 0, points = 0, sightings = 0;
};

Counts read_counts(Words& words, std::size_t n_bytes) {
  Counts n;
  constexpr int kMost = 2'000'000'000;
  n.cameras = words.whole(kMost, "a number of cameras");
  n.points = words.whole(kMost, "a number of points");
  n.sightings = words.whole(kMost, "a number of observations");
  // Before anything is reserved: each number takes a digit and a blank.
  const double numbers = 4.0 * n.sightings + 1.0 * kCameraNumbers * n.cameras + 3.0 * n.points;
  if (2 * numbers > static_cast<double>(n_bytes)) {
    words.fail_with(
        fmt::format("{} cameras, {} points and {} observations do not fit into a file of {} bytes; is it "
                    "cut off?",
                    n.cameras, n.points, n.sightings, n_bytes));
  } else if (n.cameras == 0) {
    words.fail_with("there is no camera in it");
  }
  return n;
}

void read_camera(Words& words, int index, Reconstruction& scene) {
  std::array<double, kCameraNumbers> b{};
  for (double& value : b) value = words.number();
  if (words.error()) return;
  const std::array<double, 8> k{b[6], b[6], 0, 0, b[7], b[8], 0, 0};
  const auto lens = make_lens(OpenCV4::kName, k);
  if (!lens) return words.fail_with(lens.error().message);
  scene.cameras.push_back({fmt::format("camera{}", index + 1), {}, *lens});
  const Mat3 R = half_turn() * so3_exp({b[0], b[1], b[2]});
  if (!R.allFinite()) return words.fail_with("a rotation vector of a sensible size is needed");
  scene.views.push_back({index, "", SE3(R, half_turn() * Vec3(b[3], b[4], b[5])), -1});
}

Error unsupported(const Camera& camera, const std::string& why) {
  return {ErrorCode::kUnsupported,
          "BAL problems have one focal length, k1 and k2, and " + why +
              "; write COLMAP's model instead, or use opencv4 with fx = fy and no tangential terms",
          "camera " + camera.name};
}

// f, k1, k2.
Result<Vec3> bal_lens(const Camera& camera) {
  const auto k = params(camera.lens);
  const auto d = io::brown_coefficients(camera.lens, 2);
  if (!d) return unsupported(camera, fmt::format("lens {} of this camera has more", lens_name(camera.lens)));
  if (k[0] != k[1]) return unsupported(camera, fmt::format("here fx is {} and fy {}", k[0], k[1]));
  return Vec3(k[0], (*d)[0], (*d)[1]);
}

}  // namespace

Result<Reconstruction> parse_bal(std::string_view text) {
  Words words(text);
  const Counts n = read_counts(words, text.size());
  Reconstruction scene;
  for (int i = 0; i < n.sightings && !words.error(); ++i) {
    Sighting s;
    s.view = words.whole(n.cameras, "a camera");
    s.point = words.whole(n.points, "a point");
    s.px.x() = words.number();
    s.px.y() = -words.number();
    scene.sightings.push_back(s);
  }
  for (int i = 0; i < n.cameras && !words.error(); ++i) read_camera(words, i, scene);
  for (int i = 0; i < n.points && !words.error(); ++i) {
    const double x = words.number(), y = words.number(), z = words.number();
    scene.p_world.emplace_back(x, y, z);
  }
  if (words.error()) return *words.error();
  if (const std::string_view more = words.next(); !more.empty()) {
    words.fail_with(fmt::format("there is more than the first line says: '{}'", more.substr(0, 40)));
    return *words.error();
  }
  if (!text.ends_with('\n'))
    return Error{ErrorCode::kParse, "the last line does not end; the file seems to be cut off", "the end"};
  return scene;
}

Result<std::string> format_bal(const Reconstruction& scene) {
  std::vector<Vec3> lenses;
  for (const Camera& camera : scene.cameras) {
    auto lens = bal_lens(camera);
    if (!lens) return lens.error();
    lenses.push_back(*lens);
  }
  std::string out =
      fmt::format("{} {} {}\n", scene.views.size(), scene.p_world.size(), scene.sightings.size());
  for (const Sighting& s : scene.sightings) {
    const auto k = params(scene.cameras[scene.views[s.view].camera].lens);
    out += fmt::format("{} {} {} {}\n", s.view, s.point, io::number_text(s.px.x() - k[2]),
                       io::number_text(k[3] - s.px.y()));
  }
  const auto add = [&out](const Vec3& v) {
    for (double value : v) out += io::number_text(value) + "\n";
  };
  for (const ReconstructionView& view : scene.views) {
    add(so3_log(half_turn() * view.T_cam_world.R()));
    add(half_turn() * view.T_cam_world.t());
    add(lenses[view.camera]);
  }
  for (const Vec3& p : scene.p_world) add(p);
  return out;
}

bool looks_like_bal(std::string_view bytes) {
  Words words(bytes.substr(0, 4096));
  for (int i = 0; i < 3; ++i) words.whole(2'000'000'000, "a count");
  for (int i = 0; i < 2; ++i) words.whole(2'000'000'000, "an index");
  for (int i = 0; i < 2; ++i) words.number();
  return !words.error();
}

}  // namespace plumbline

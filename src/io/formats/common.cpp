// SPDX-License-Identifier: Apache-2.0
#include "io/formats/common.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "plumbline/core/linalg.hpp"
#include "plumbline/core/text.hpp"

namespace plumbline::io {

Error unsupported_lens(const Format& format, const Camera& camera) {
  const std::string_view lens = lens_name(camera.lens);
  std::vector<std::string> others;
  for (const Format* other : formats()) {
    const auto known = split(other->lenses, ' ');
    if (std::find(known.begin(), known.end(), lens) != known.end()) others.emplace_back(other->name);
  }
  return {ErrorCode::kUnsupported,
          fmt::format("format {} cannot express the lens {} with these values (it knows: {}); calibrate with "
                      "one of those, or "
                      "write one of: {}",
                      format.name, lens, format.lenses, join(others, ", ")),
          "camera " + camera.name};
}

Status check_poses(const Format& format, const Rig& rig) {
  if (poses_known(rig)) return {};
  return Error{ErrorCode::kUnsupported,
               "the poses of the cameras are not known: two of them have the same. Give the files "
               "that hold them too (extrinsics.yml), or convert one camera at a time; ros and "
               "colmap need none",
               fmt::format("format {}", format.name)};
}

std::vector<std::string> file_stems(const Rig& rig) {
  std::vector<std::string> stems;
  std::set<std::string> taken;
  for (const Camera& camera : rig.cameras) {
    std::string stem = camera.name;
    std::replace_if(
        stem.begin(), stem.end(),
        [](unsigned char c) { return c <= ' ' || c == '/' || c == '\\' || c == 0x7f; }, '_');
    if (stem.empty() || stem.front() == '.') stem = "camera" + stem;
    stem.resize(std::min<std::size_t>(stem.size(), 200));
    const std::string base = stem;
    for (int n = 2; !taken.insert(stem).second; ++n) stem = fmt::format("{}_{}", base, n);
    stems.push_back(stem);
  }
  return stems;
}

std::string stem_of(const std::string& file) {
  const std::string stem = std::filesystem::path(file).stem().string();
  return stem.empty() ? "camera" : stem;
}

std::optional<std::vector<double>> brown_coefficients(const Lens& lens) {
  const std::string_view name = lens_name(lens);
  if (name != Pinhole::kName && name.substr(0, 6) != "opencv") return std::nullopt;
  const auto all = params(lens);
  return std::vector<double>(all.begin() + 4, all.end());
}

std::optional<std::vector<double>> brown_coefficients(const Lens& lens, std::size_t n) {
  auto d = brown_coefficients(lens);
  if (!d) return std::nullopt;
  for (std::size_t i = n; i < d->size(); ++i) {
    if ((*d)[i] != 0) return std::nullopt;
  }
  d->resize(n, 0.0);
  return d;
}

Lens lens_of(const Field& field, std::string_view name, const std::vector<double>& k4,
             const std::vector<double>& d) {
  std::vector<double> all = k4;
  all.insert(all.end(), d.begin(), d.end());
  return value_or_throw(make_lens(name, all), field);
}

Lens brown_lens(const Field& field, const std::vector<double>& k4, std::vector<double> d) {
  if (d.size() == 14) {
    if (d[12] != 0 || d[13] != 0) {
      field.fail("the tilted sensor (tau_x, tau_y) is not among our lenses", ErrorCode::kUnsupported);
    }
    d.resize(12);
  }
  if (std::all_of(d.begin(), d.end(), [](double v) { return v == 0; }))
    return lens_of(field, "pinhole", k4, {});
  if (d.size() != 4 && d.size() != 5 && d.size() != 8 && d.size() != 12) {
    field.fail(fmt::format("{} distortion coefficients: 4, 5, 8, 12 or 14 are needed", d.size()));
  }
  return lens_of(field, fmt::format("opencv{}", d.size()), k4, d);
}

std::vector<double> focal_and_centre(const Field& matrix, const std::vector<double>& k) {
  if (k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
    matrix.fail("not a camera matrix [fx 0 cx; 0 fy cy; 0 0 1]");
  if (k[1] != 0)
    matrix.fail(fmt::format("a skew of {} px is not among our lenses", k[1]), ErrorCode::kUnsupported);
  return {k[0], k[4], k[2], k[5]};
}

ImageSize size_of(const Field& width, const Field& height) {
  return {width.integer(1, 1'000'000), height.integer(1, 1'000'000)};
}

SE3 pose_of(const Field& field, const std::vector<double>& R, const std::vector<double>& t) {
  Mat3 M;
  M << R[0], R[1], R[2], R[3], R[4], R[5], R[6], R[7], R[8];
  const double fault = (M.transpose() * M - Mat3::Identity()).norm();
  if (!(fault < 1e-3) || M.determinant() < 0)
    field.fail(fmt::format("not a rotation: |R'R - I| = {:.3g}", fault));
  if (fault > 1e-9) M = nearest_rotation(M);
  return {M, {t[0], t[1], t[2]}};
}

SE3 pose_of(const Field& matrix) {
  const std::vector<double> T = matrix.numbers(16);
  if (T[12] != 0 || T[13] != 0 || T[14] != 0 || T[15] != 1) matrix.fail("the last row must be 0 0 0 1");
  return pose_of(matrix, {T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]}, {T[3], T[7], T[11]});
}

void make_first_the_rig(Rig& rig) {
  if (rig.T_cam_rig.empty() || rig.T_cam_rig.front() == SE3()) return;
  const SE3 T_rig_first = rig.T_cam_rig.front().inverse();
  for (SE3& T : rig.T_cam_rig) T = T * T_rig_first;
  rig.T_cam_rig.front() = SE3();
}

SE3 relative_pose(const Rig& rig, int first, int second) {
  if (rig.T_cam_rig[first] == SE3()) return rig.T_cam_rig[second];
  return rig.T_cam_rig[second] * rig.T_cam_rig[first].inverse();
}

}  // namespace plumbline::io

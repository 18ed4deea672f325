// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <set>

#include "detect/charuco.hpp"
#include "detect/finders.hpp"
#include "detect/orientation.hpp"
#include "detect/single_threaded.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/detect/detect.hpp"
#include "plumbline/image/image.hpp"

namespace plumbline {
namespace {

/// One image of the run, searched for one target.
struct Job {
  int cam = 0;
  std::size_t image = 0;  ///< within its camera
  int target = 0;
  ImageSize size;
  int orientation = 1;  ///< EXIF's
  std::optional<Result<Detection>> found;
};

void search(const Result<Photograph>& photograph, const std::string& name, const Target& target, Job& job) {
  if (!photograph) {
    job.found = Error{photograph.error().code, photograph.error().message, name};
    return;
  }
  job.size = {photograph->pixels.cols, photograph->pixels.rows};
  job.orientation = photograph->orientation;
  job.found = detect_target(photograph->pixels, target);
  if (!*job.found) job.found = Error{job.found->error().code, job.found->error().message, name};
}

/// One layout of a target for all images: those found under the other one are looked at again. Returns the
/// remark that is due.
std::string settle_layout(const std::vector<CameraImages>& cameras, const std::vector<Target>& targets,
                          int target, int n_threads, std::vector<Job>& jobs) {
  int vote = 0;
  for (const Job& job : jobs) {
    if (job.target == target) vote += job.found->value().layout_vote;
  }
  const auto settled =
      detail::with_layout(targets[target], vote < 0 ? Charuco::Layout::kLegacy : Charuco::Layout::kCurrent);
  if (!settled) return "";
  std::vector<Job*> again;
  std::vector<std::filesystem::path> files;
  for (Job& job : jobs) {
    if (job.target != target || (job.found->value().layout_vote < 0) == (vote < 0)) continue;
    again.push_back(&job);
    files.push_back(cameras[static_cast<std::size_t>(job.cam)].files[job.image]);
  }
  for_each_image(files, ReadAs::kGrey8, n_threads, [&](int i, const Result<Photograph>& photograph) {
    Job& job = *again[static_cast<std::size_t>(i)];
    search(photograph, cameras[static_cast<std::size_t>(job.cam)].names[job.image], *settled, job);
  });
  return vote == 0 ? "; no image tells which layout it is" : "";
}

/// The first failure among the images.
Status check_decoded(const std::vector<Job>& jobs) {
  for (const Job& job : jobs) {
    if (!*job.found) return job.found->error();
  }
  return {};
}

Status check_sizes(const std::vector<CameraImages>& cameras, const std::vector<Job>& jobs) {
  std::map<int, const Job*> first;
  for (const Job& job : jobs) {
    const auto [at, is_new] = first.try_emplace(job.cam, &job);
    if (is_new || at->second->size == job.size) continue;
    const CameraImages& camera = cameras[static_cast<std::size_t>(job.cam)];
    const ImageSize size = job.size, other = at->second->size;
    const bool is_turned = size.width == other.height && size.height == other.width;
    return Error{
        ErrorCode::kInvalidData,
        fmt::format("{}x{} pixels, but {} of the same camera has {}x{}: one camera has one size; {}",
                    size.width, size.height, camera.names[at->second->image], other.width, other.height,
                    is_turned ? "another program has turned the pixels of one of them: use the "
                                "files as the camera wrote them, or leave one out"
                              : "leave one of them out"),
        camera.names[job.image]};
  }
  return {};
}

/// The reason that most images of a camera share, for a run in which the camera saw nothing at all.
std::string commonest_reason(const std::vector<Job>& jobs, int cam) {
  std::map<std::string, int> count;
  for (const Job& job : jobs)
    if (job.cam == cam) ++count[job.found->value().reason];
  return std::max_element(count.begin(), count.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

Status check_found(const std::vector<CameraImages>& cameras, const std::vector<Job>& jobs,
                   const std::vector<Target>& targets) {
  std::vector<std::string> names;
  for (const Target& target : targets) names.push_back(target.name);
  for (std::size_t cam = 0; cam < cameras.size(); ++cam) {
    const auto is_here = [&](const Job& job) {
      return job.cam == static_cast<int>(cam) && !job.found->value().corners.empty();
    };
    if (std::any_of(jobs.begin(), jobs.end(), is_here)) continue;
    return Error{ErrorCode::kDegenerate,
                 fmt::format("{} is in none of the {} images ({}). Check the target's kind and counts",
                             join(names, " or "), cameras[cam].files.size(),
                             commonest_reason(jobs, static_cast<int>(cam))),
                 cameras[cam].camera};
  }
  for (std::size_t target = 0; target < targets.size(); ++target) {
    const auto is_here = [&](const Job& job) {
      return job.target == static_cast<int>(target) && !job.found->value().corners.empty();
    };
    if (std::any_of(jobs.begin(), jobs.end(), is_here)) continue;
    return Error{ErrorCode::kDegenerate,
                 "it is in no image of any camera. Check the target's kind and counts, or leave it out",
                 "target " + targets[target].name};
  }
  return {};
}

/// "chessboard: saddle fit": which methods the corners of one target come from,
/// camera by camera where they differ.
std::string remark(const std::vector<CameraImages>& cameras, const std::vector<Job>& jobs,
                   const std::vector<Target>& targets, int target) {
  std::map<std::string, std::map<int, int>> by_method;  // method -> camera -> images
  std::map<int, int> found;
  for (const Job& job : jobs) {
    const Detection& d = job.found->value();
    if (job.target != target || d.corners.empty()) continue;
    ++found[job.cam];
    ++by_method[d.method][job.cam];
  }
  const std::string type =
      targets.size() > 1 ? targets[target].name : std::string(target_type(targets[target].spec));
  if (by_method.size() == 1) return type + ": " + by_method.begin()->first;
  std::vector<std::string> parts;
  for (const auto& [method, counts] : by_method) {
    std::vector<std::string> where;
    for (const auto& [cam, n] : counts) {
      where.push_back(
          fmt::format("{} {} of {}", cameras[static_cast<std::size_t>(cam)].camera, n, found[cam]));
    }
    parts.push_back(fmt::format("{} ({})", method, join(where, ", ")));
  }
  return type + ": " + join(parts, "; ");
}

/// What has to be said of a camera's images: what is known from before, and their orientation tags.
std::vector<std::string> notes_of(const CameraImages& camera, int cam, const std::vector<Job>& jobs) {
  std::vector<std::string> notes = camera.notes;
  std::vector<int> orientations;
  for (const Job& job : jobs) {
    if (job.cam == cam && job.target == 0) orientations.push_back(job.orientation);
  }
  if (auto note = detail::orientation_note(orientations, camera.names)) notes.push_back(*std::move(note));
  for (std::string& note : notes) note = camera.camera + ": " + note;
  return notes;
}

std::vector<std::string> frame_keys(const std::vector<CameraImages>& cameras) {
  std::set<std::string> keys;
  for (const CameraImages& camera : cameras) keys.insert(camera.frames.begin(), camera.frames.end());
  std::vector<std::string> out(keys.begin(), keys.end());
  std::stable_sort(out.begin(), out.end(), natural_less);
  return out;
}

Dataset assemble(const std::vector<CameraImages>& cameras, const std::vector<Job>& jobs,
                 const std::vector<Target>& targets, const std::vector<std::string>& layout_remarks) {
  Dataset data;
  data.targets = targets;
  data.frames = frame_keys(cameras);
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (i > 0) data.detector += "; ";
    data.detector += remark(cameras, jobs, targets, static_cast<int>(i)) + layout_remarks[i];
  }
  std::map<std::string, int> frame_index;
  for (std::size_t i = 0; i < data.frames.size(); ++i) frame_index[data.frames[i]] = static_cast<int>(i);
  for (const CameraImages& camera : cameras) data.cameras.push_back({camera.camera, {}});
  for (const Job& job : jobs) {
    const CameraImages& camera = cameras[static_cast<std::size_t>(job.cam)];
    const Detection& found = job.found->value();
    data.cameras[static_cast<std::size_t>(job.cam)].size = job.size;
    data.views.push_back({job.cam, frame_index[camera.frames[job.image]], camera.names[job.image],
                          found.corners, found.reason, job.target});
  }
  std::stable_sort(data.views.begin(), data.views.end(), [](const View& a, const View& b) {
    if (a.cam != b.cam) return a.cam < b.cam;
    if (a.image == b.image) return a.target < b.target;
    return natural_less(a.image, b.image);
  });
  return data;
}

}  // namespace

Result<Dataset> detect_dataset(const std::vector<CameraImages>& cameras, const Target& target,
                               const DetectOptions& options) {
  return detect_dataset(cameras, std::vector<Target>{target}, options);
}

Result<Dataset> detect_dataset(const std::vector<CameraImages>& cameras, const std::vector<Target>& targets,
                               const DetectOptions& options) {
  PLUMBLINE_CHECK(!targets.empty(), "at least one target is needed");
  if (auto ok = check_distinct(targets); !ok) return ok.error();
  std::vector<Job> jobs;
  std::vector<std::filesystem::path> files;
  for (std::size_t cam = 0; cam < cameras.size(); ++cam) {
    const CameraImages& c = cameras[cam];
    PLUMBLINE_CHECK(c.files.size() == c.names.size() && c.files.size() == c.frames.size(),
                    "a name and a frame for each file");
    PLUMBLINE_CHECK(!c.files.empty(), "a camera needs images");
    files.insert(files.end(), c.files.begin(), c.files.end());
    for (std::size_t i = 0; i < c.files.size(); ++i) {
      for (std::size_t t = 0; t < targets.size(); ++t)
        jobs.push_back({static_cast<int>(cam), i, static_cast<int>(t), {}, 1, std::nullopt});
    }
  }
  PLUMBLINE_CHECK(!jobs.empty(), "at least one camera is needed");
  const int n = static_cast<int>(jobs.size());
  std::mutex lock;
  int done = 0;
  std::vector<std::string> layout_remarks;
  {
    const detail::OpenCvSingleThreaded guard;
    const auto look = [&](int i, const Result<Photograph>& photograph) {
      for (std::size_t t = 0; t < targets.size(); ++t) {
        Job& job = jobs[static_cast<std::size_t>(i) * targets.size() + t];
        search(photograph, cameras[static_cast<std::size_t>(job.cam)].names[job.image], targets[t], job);
        const std::lock_guard hold(lock);
        ++done;
        if (options.progress) options.progress(done, n);
      }
    };
    for_each_image(files, ReadAs::kGrey8, options.n_threads, look);
    if (auto ok = check_decoded(jobs); !ok) return ok.error();
    for (std::size_t t = 0; t < targets.size(); ++t)
      layout_remarks.push_back(settle_layout(cameras, targets, static_cast<int>(t), options.n_threads, jobs));
  }
  if (auto ok = check_decoded(jobs); !ok) return ok.error();
  if (auto ok = check_sizes(cameras, jobs); !ok) return ok.error();
  if (auto ok = check_found(cameras, jobs, targets); !ok) return ok.error();
  if (options.note) {
    for (std::size_t cam = 0; cam < cameras.size(); ++cam) {
      for (const std::string& note : notes_of(cameras[cam], static_cast<int>(cam), jobs)) options.note(note);
    }
  }
  Dataset data = assemble(cameras, jobs, targets, layout_remarks);
  thin_near_duplicates(data, options.thin_px);
  return data;
}

}  // namespace plumbline

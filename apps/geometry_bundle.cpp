// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <opencv2/core.hpp>

#include "geometry.hpp"
#include "geometry_args.hpp"
#include "plumbline/core/text.hpp"
#include "plumbline/image/image.hpp"
#include "plumbline/io/files.hpp"
#include "plumbline/io/reconstruction_io.hpp"
#include "plumbline/refine/bundle.hpp"
#include "plumbline/refine/bundle_structure.hpp"

namespace plumbline::apps {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string model, output, loss = "squared", solver = "auto", structure;
  std::vector<std::string> fix, bars;
  std::vector<std::string> free_intrinsics;
  bool tie_focal = false, sigmas = false;
  double sigma_px = 1, max_rms_px = 0;
  int max_iterations = 200;
};

// A file with an extension is a BAL problem, anything else a folder for COLMAP's three files.
bool output_is_bal(const Options& o) {
  return fs::path(o.output).has_extension() && !fs::is_directory(o.output);
}

Result<Reconstruction> load_model(const std::string& model) {
  if (!fs::is_directory(model)) {
    auto text = read_file(model);
    if (!text) return text.error();
    if (!looks_like_bal(*text)) {
      return Error{
          ErrorCode::kParse,
          "not a BAL problem (three counts, then observations); COLMAP's text model is given by its folder",
          model};
    }
    auto scene = parse_bal(*text);
    if (scene) return scene;
    Error error = scene.error();
    error.where = model + ": " + error.where;
    return error;
  }
  std::vector<NamedBytes> files;
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) {
    if (!fs::exists(fs::path(model) / name)) continue;
    auto text = read_file(fs::path(model) / name);
    if (!text) return text.error();
    files.push_back({name, *std::move(text)});
  }
  auto scene = parse_colmap_model(files);
  if (scene) return scene;
  Error error = scene.error();
  error.where = model + ": " + error.where;
  return error;
}

// A point by the id of its file, or by its index where the file has none.
int find_point(const Reconstruction& scene, const std::string& text, const std::string& option) {
  const auto number = parse_int(text);
  if (number && scene.tags.empty() && *number >= 0 && *number < static_cast<int>(scene.p_world.size()))
    return *number;
  for (std::size_t p = 0; number && p < scene.tags.size(); ++p)
    if (scene.tags[p].id == *number) return static_cast<int>(p);
  usage_error(fmt::format("{}: there is no point {} ({})", option, text,
                          scene.tags.empty() ? fmt::format("points are 0 to {}", scene.p_world.size() - 1)
                                             : "points have the ids of points3D.txt"));
}

// A view by its image's name, or by its index where the file has no names.
int find_view(const Reconstruction& scene, const std::string& text, const std::string& option) {
  for (std::size_t v = 0; v < scene.views.size(); ++v)
    if (!text.empty() && scene.views[v].image == text) return static_cast<int>(v);
  const auto number = parse_int(text);
  if (number && *number >= 0 && *number < static_cast<int>(scene.views.size()) &&
      scene.views[static_cast<std::size_t>(*number)].image.empty())
    return *number;
  usage_error(
      fmt::format("{}: there is no view {} (views go by the names of their images, or by number in a file "
                  "without names)",
                  option, text));
}

void parse_fix(const Options& o, const Reconstruction& scene, BundleOptions& options) {
  for (const std::string& fix : o.fix) {
    const std::size_t equals = fix.find('=');
    const std::string what = fix.substr(0, equals), option = "--fix " + fix;
    const std::string which = equals == std::string::npos ? "" : fix.substr(equals + 1);
    if (what == "view" && !which.empty())
      options.hold_views.push_back(find_view(scene, which, option));
    else if (what == "point" && !which.empty())
      options.hold_points.push_back(find_point(scene, which, option));
    else if (fix == "views")
      for (std::size_t v = 0; v < scene.views.size(); ++v) options.hold_views.push_back(static_cast<int>(v));
    else if (fix == "points")
      for (std::size_t p = 0; p < scene.p_world.size(); ++p)
        options.hold_points.push_back(static_cast<int>(p));
    else
      usage_error(option + ": view=IMAGE, point=ID, views (all of them) or points is needed");
  }
}

void parse_bars(const Options& o, const Reconstruction& scene, BundleOptions& options) {
  for (const std::string& text : o.bars) {
    const std::string option = "--scale-bar " + text;
    const auto pieces = split(text, ',');
    const auto length = pieces.size() >= 3 ? parse_double(pieces[2]) : std::nullopt;
    // Without a sigma: a tenth of a millimetre in a metre, what a good printed or taped length keeps.
    const auto sigma = pieces.size() == 4 ? parse_double(pieces[3])
                       : length           ? std::optional(1e-4 * *length)
                                          : std::nullopt;
    if (pieces.size() < 3 || pieces.size() > 4 || !length || !sigma || !(*length > 0 && *sigma > 0))
      usage_error(option +
                  ": two points, a length and perhaps its sigma are needed: 12,40,0.5 or 12,40,0.5,0.001");
    options.scale_bars.push_back(
        {find_point(scene, pieces[0], option), find_point(scene, pieces[1], option), *length, *sigma});
  }
}

void parse_loss(const std::string& text, BundleOptions& options) {
  const std::size_t colon = text.find(':');
  const std::string name = text.substr(0, colon);
  const auto scale = colon == std::string::npos ? std::optional(1.0) : parse_double(text.substr(colon + 1));
  const bool known = name == "squared" || name == "huber" || name == "cauchy";
  if (!known || !scale || !(*scale > 0) || (name == "squared" && colon != std::string::npos))
    usage_error(fmt::format(
        "--loss {}: squared, huber:SIGMAS or cauchy:SIGMAS is needed, for example huber:1.5", text));
  options.loss = name == "huber" ? Loss::kHuber : name == "cauchy" ? Loss::kCauchy : Loss::kSquared;
  options.loss_scale = *scale;
}

void parse_intrinsics(const Options& o, BundleOptions& options) {
  options.tie_focal = o.tie_focal || output_is_bal(o);
  for (const std::string& name : o.free_intrinsics) {
    if (name == "none" || name.empty()) continue;
    const std::string parameter = name.substr(name.rfind(' ') + 1);
    if (!output_is_bal(o))
      options.free_intrinsics.push_back(name);
    else if (name == "all")
      options.free_intrinsics.insert(options.free_intrinsics.end(), {"fx", "k1", "k2"});
    else if (parameter == "fx" || parameter == "fy" || parameter == "k1" || parameter == "k2")
      options.free_intrinsics.push_back(name);
    else
      usage_error(fmt::format(
          "--free-intrinsics {}: a BAL problem holds fx (= fy), k1 and k2 only; give a folder with "
          "-o for COLMAP's model",
          name));
  }
}

BundleOptions bundle_options(const Options& o, const Reconstruction& scene) {
  BundleOptions options;
  options.max_iterations = o.max_iterations;
  options.solver = o.solver == "dense"       ? BundleSolver::kDenseSchur
                   : o.solver == "sparse"    ? BundleSolver::kSparseSchur
                   : o.solver == "iterative" ? BundleSolver::kIterativeSchur
                                             : BundleSolver::kAuto;
  parse_loss(o.loss, options);
  parse_intrinsics(o, options);
  parse_fix(o, scene, options);
  parse_bars(o, scene, options);
  for (std::size_t v = 0; o.sigmas && v < scene.views.size(); ++v)
    options.covariance_of_views.push_back(static_cast<int>(v));
  return options;
}

// J at the left, J'J at the right, in the colours of the SVG.
cv::Mat picture_of(const BundleStructure& structure) {
  const cv::Vec3b colours[] = {{255, 255, 255}, {2, 95, 217}, {168, 95, 31}, {92, 157, 42}, {152, 143, 138}};
  const StructureImage parts[] = {draw_jacobian(structure), draw_normal_matrix(structure)};
  constexpr int kMargin = 10;
  cv::Mat picture(std::max(parts[0].height, parts[1].height) + 2 * kMargin,
                  parts[0].width + parts[1].width + 3 * kMargin, CV_8UC3, cv::Scalar(225, 225, 225));
  int left = kMargin;
  for (const StructureImage& part : parts) {
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x)
        picture.at<cv::Vec3b>(kMargin + y, left + x) =
            colours[part.pixels[static_cast<std::size_t>(y) * part.width + x]];
    }
    left += part.width + kMargin;
  }
  return picture;
}

Status write_structure(const std::string& file, const BundleStructure& structure, bool force) {
  if (fs::path(file).extension() == ".png") return write_png(file, picture_of(structure));
  return write_file(file, format_structure_svg(structure), force);
}

Status write_model(const Options& o, const Common& common, const Reconstruction& scene,
                   std::vector<std::string>& written) {
  if (output_is_bal(o)) {
    auto text = format_bal(scene);
    if (!text) return text.error();
    written.push_back(o.output);
    return write_file(o.output, *text, common.force);
  }
  auto files = format_colmap_model(scene);
  if (!files) return files.error();
  for (const NamedBytes& file : *files) written.push_back((fs::path(o.output) / file.name).string());
  return write_folder(o.output, common.force, [&](const fs::path& folder) -> Status {
    for (const NamedBytes& file : *files) {
      if (Status s = write_file(folder / file.name, file.bytes, true); !s) return s;
    }
    return {};
  });
}

// What the output's format cannot hold is said before the work and not after it.
Status check_expressible(const Options& o, const Reconstruction& scene) {
  Reconstruction frame;
  frame.cameras = scene.cameras;
  frame.views = scene.views;
  const auto fault = [](const auto& written) { return written ? Status() : Status(written.error()); };
  return output_is_bal(o) ? fault(format_bal(frame)) : fault(format_colmap_model(frame));
}

int count(const Bundle& bundle, SightingFit::Use use) {
  return static_cast<int>(std::count_if(bundle.fits.begin(), bundle.fits.end(),
                                        [&](const SightingFit& f) { return f.use == use; }));
}

std::string name_of(const Reconstruction& scene, const LeftOut& out) {
  return out.what == LeftOut::What::kView ? view_name(scene, out.index) : point_name(scene, out.index);
}

Json json_of_cameras(const Reconstruction& scene) {
  Json cameras = Json::array();
  for (const Camera& camera : scene.cameras) {
    Json lens = Json::object();
    for (std::size_t i = 0; i < params(camera.lens).size(); ++i)
      lens[std::string(param_names(camera.lens)[i])] = params(camera.lens)[i];
    cameras.push_back({{"name", camera.name}, {"lens", lens_name(camera.lens)}, {"params", lens}});
  }
  return cameras;
}

Json json_of_bundle(const Bundle& b, const BundleOptions& options) {
  Json json{{"views", b.scene.views.size()},
            {"points", b.scene.p_world.size()},
            {"sightings", b.scene.sightings.size()},
            {"used", b.n_used},
            {"no_projection", count(b, SightingFit::Use::kNoProjection)},
            {"left_out", Json::array()},
            {"free_parameters", b.n_free_parameters},
            {"gauge", b.gauge},
            {"rms_px_before", b.rms_px_before},
            {"rms_px", b.rms_px},
            {"variance_factor", b.variance_factor},
            {"iterations", b.iterations},
            {"converged", b.converged},
            {"termination", b.termination},
            {"scale_bars", Json::array()},
            {"cameras", json_of_cameras(b.scene)}};
  for (const LeftOut& out : b.left_out)
    json["left_out"].push_back({{"what", name_of(b.scene, out)}, {"reason", out.reason}});
  for (std::size_t i = 0; i < b.bar_residual_m.size(); ++i) {
    const ScaleBar& bar = options.scale_bars[i];
    json["scale_bars"].push_back(
        {{"points", {point_name(b.scene, bar.point_a), point_name(b.scene, bar.point_b)}},
         {"length_m", bar.length_m},
         {"residual_m", b.bar_residual_m[i]}});
  }
  for (std::size_t i = 0; i < options.covariance_of_views.size(); ++i) {
    const VecX sigma = b.view_covariance.diagonal().segment(6 * static_cast<Eigen::Index>(i), 6).cwiseSqrt();
    json["view_sigmas"].push_back({{"image", b.scene.views[options.covariance_of_views[i]].image},
                                   {"rotation_rad", json_of_vector(sigma.head(3))},
                                   {"translation", json_of_vector(sigma.tail(3))}});
  }
  return json;
}

std::string text_of_bundle(const Bundle& b) {
  std::string text = fmt::format(
      "{} views, {} points, {} of {} sightings used: {:.6g} px rms, before {:.6g} px\n", b.scene.views.size(),
      b.scene.p_world.size(), b.n_used, b.scene.sightings.size(), b.rms_px, b.rms_px_before);
  text += fmt::format("gauge: {}\n{} iterations, {}: {}\n", b.gauge, b.iterations,
                      b.converged ? "converged" : "NOT converged", b.termination);
  for (double residual : b.bar_residual_m) text += fmt::format("scale bar: off by {:.4g} m\n", residual);
  if (const int n = count(b, SightingFit::Use::kNoProjection); n > 0)
    text += fmt::format("{} sightings lie behind their camera or beyond its lens and were not used\n", n);
  constexpr std::size_t kMostLines = 20;
  for (std::size_t i = 0; i < b.left_out.size() && i < kMostLines; ++i)
    text += fmt::format("left out: {}: {}\n", name_of(b.scene, b.left_out[i]), b.left_out[i].reason);
  if (b.left_out.size() > kMostLines)
    text += fmt::format("and {} more were left out (--json has all)\n", b.left_out.size() - kMostLines);
  return text;
}

Result<int> run(const Options& o, const Common& common) {
  const std::string extension = fs::path(o.structure).extension().string();
  if (!o.structure.empty() && extension != ".svg" && extension != ".png")
    usage_error(fmt::format("--structure {}: a .svg or .png file is needed", o.structure));
  for (const std::string& file : {o.output, o.structure}) {
    if (file.empty()) continue;
    if (Status s = check_output(file, common); !s) return s.error();
  }
  if (Status s = check_parent(o.structure); !s) return s.error();
  auto scene = load_model(o.model);
  if (!scene) return scene.error();
  if (Status s = check_expressible(o, *scene); !s) return s.error();
  for (Sighting& sighting : scene->sightings) sighting.sigma_px = o.sigma_px;
  const BundleOptions options = bundle_options(o, *scene);
  const auto bundle = adjust_bundle(*scene, options);
  if (!bundle) return bundle.error();
  if (!bundle->converged) {
    return Error{ErrorCode::kNotConverged,
                 fmt::format("{} iterations end at {:.6g} px without an optimum ({}); give more with "
                             "--max-iterations, or hold "
                             "what the sightings do not determine: lens parameters (--free-intrinsics), "
                             "views or points (--fix)",
                             bundle->iterations, bundle->rms_px, bundle->termination),
                 o.model};
  }
  std::vector<std::string> written;
  if (Status s = write_model(o, common, bundle->scene, written); !s) return s.error();
  if (!o.structure.empty()) {
    const auto structure = bundle_structure(*scene, options);
    if (!structure) return structure.error();
    if (Status s = write_structure(o.structure, *structure, common.force); !s) return s.error();
    written.push_back(o.structure);
  }
  Json json = json_of_bundle(*bundle, options);
  std::string text = text_of_bundle(*bundle);
  for (const std::string& file : written) text += "written: " + file + "\n";
  json["files"] = written;
  const bool missed = o.max_rms_px > 0 && !(bundle->rms_px <= o.max_rms_px);
  if (missed)
    text += fmt::format("quality gate missed: {:.6g} px is above --max-rms {} px\n", bundle->rms_px,
                        o.max_rms_px);
  if (Status s = print_result(common, json, text); !s) return s.error();
  return missed ? kGateMissed : kDone;
}

}  // namespace

void add_geometry_bundle(CLI::App& app, const Common& common, int& exit_code) {
  auto o = std::make_shared<Options>();
  app.add_option("model", o->model, "folder of COLMAP's text model, or a BAL problem")->required();
  app.add_option("-o,--output", o->output, "a folder for COLMAP's model, or FILE.txt for a BAL problem")
      ->required();
  app.add_option(
         "--fix", o->fix,
         "what stays: view=IMAGE, point=ID, views, points (default: the first view, and the distance to the "
         "view farthest from it unless scale bars are given)")
      ->allow_extra_args(false);
  app.add_option("--scale-bar", o->bars,
                 "POINT,POINT,LENGTH[,SIGMA], once per bar (default sigma: 1e-4 of it)")
      ->allow_extra_args(false);
  app.add_option("--free-intrinsics", o->free_intrinsics,
                 "lens parameters that are refined: fx,fy,k1 or 'camera1 fx' or all (default: none)")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_flag("--tie-focal", o->tie_focal, "fx and fy keep their ratio (always so where BAL is written)");
  app.add_option("--loss", o->loss, "squared, huber:SIGMAS or cauchy:SIGMAS (default: squared)");
  app.add_option("--sigma", o->sigma_px, "error of the sightings [px] (default: 1)")->check(positive());
  app.add_option("--max-iterations", o->max_iterations, "(default: 200)")->check(CLI::Range(1, 100000));
  app.add_option("--solver", o->solver, "auto, dense, sparse or iterative")
      ->check(CLI::IsMember({"auto", "dense", "sparse", "iterative"}));
  app.add_option("--structure", o->structure, "the blocks of J and J'J as a picture, FILE.svg or FILE.png");
  app.add_flag("--sigmas", o->sigmas, "standard deviations of all poses, in --json");
  app.add_option("--max-rms", o->max_rms_px, "exit with 3 when the error is above this [px]")
      ->check(positive());
  on_run(app, exit_code, [o, &common] { return run(*o, common); });
}

}  // namespace plumbline::apps

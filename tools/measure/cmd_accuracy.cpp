// teletact accuracy WHAT: what accuracy costs. Error and CPU time of a method over its knobs, as a
// table, as metrics and as plots with the Pareto front and the default marked.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <stdexcept>

#include "tools/cli/number_list.hpp"
#include "tools/cli/option_use.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/accuracy/clicks_study.hpp"
#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/measure/accuracy/segmentation_study.hpp"
#include "tools/measure/accuracy/weighting_study.hpp"
#include "tools/measure/haptic_study.hpp"
#include "tools/measure/measure_commands.hpp"
#include "tools/record/scenes.hpp"

namespace teletact {

namespace {

// The room at the default setting, under the names that others rely on.
void add_room(const Study& study, Metrics& metrics) {
  for (const StudyRow& row : study.rows) {
    if (row.data != "room" || !row.is_default) continue;
    for (const BenchMetric& m : counted_figures(row)) {
      metrics.add("fusion.synthetic." + m.name, m.value, m.unit);
    }
  }
}

void write_pictures(const Study& study, const std::string& what, const std::string& plots) {
  for (const std::string& file : study.write_plots(plots)) std::cout << file << "\n";
  for (const char* method : {"constrained", "nearest", "force_shading"}) {
    if (what != "haptic") break;
    const std::string file = plots + "/haptic_corner_" + method + ".svg";
    write_whole_file(file, corner_picture(method));
    std::cout << file << "\n";
  }
}

// Of the recording, and of drawn scenes.
void add_fusion(CLI::App& app, FusionStudyOptions& fusion, std::string& intrinsics, int& samples) {
  app.add_option("--rgbd", fusion.rgbd,
                 "fusion, weighting: recording in TUM or 7-Scenes layout with true poses, which "
                 "judge and nothing else");
  app.add_option("--rgbd-frames", fusion.rgbd_frames,
                 "fusion, weighting: of the recording, at most")
      ->check(CLI::Range(5, 100000))
      ->capture_default_str();
  app.add_option("--intrinsics", intrinsics,
                 "of the recording, where it has no intrinsics.txt: fx,fy,cx,cy in px, and depth "
                 "units a metre if the data set's are not right");
  app.add_option("--scenes", fusion.scenes,
                 "fusion, weighting: synthetic ones; of fusion, knobs beside the voxel's size vary "
                 "in the first; of weighting the default is room,stairs,turn")
      ->check(CLI::IsMember(scene_names()))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--frames", fusion.frames, "fusion, weighting: of each synthetic scene")
      ->check(CLI::Range(5, 2000))
      ->capture_default_str();
  app.add_option("--voxels", fusion.voxels_mm,
                 "fusion, weighting: edges of a voxel, mm; of weighting the default is 20")
      ->check(in_range(4, 100))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--incidence", fusion.incidence,
                 "fusion: factor on the noise of the synthetic scenes that grows with the angle of "
                 "incidence, as camera.noise.incidence")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--samples", samples, "weighting: of things that move")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
}

void add_clicks(CLI::App& app, ClicksStudyOptions& clicks, bool& default_only) {
  app.add_option("--clutter", clicks.clutter, "clicks: drawn scenes of clutter")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  app.add_flag("--default-only", default_only, "clicks: the default setting alone");
}

void finish_clicks(const CLI::App& app, const SegmentationStudyOptions& segmentation,
                   bool default_only, ClicksStudyOptions& clicks) {
  clicks.data = segmentation.data;
  clicks.knobs = !default_only;
  if (app.count("--seed") > 0) clicks.seed = segmentation.seed;
}

// What was given to fusion's options, over the study's own defaults.
WeightingOptions weighting_of(const CLI::App& app, const FusionStudyOptions& fusion, int samples,
                              std::uint64_t seed) {
  WeightingOptions o;
  o.samples = samples;
  o.frames = fusion.frames;
  o.rgbd = fusion.rgbd;
  o.rgbd_frames = fusion.rgbd_frames;
  o.pinhole = fusion.pinhole;
  if (app.count("--scenes") > 0) o.scenes = fusion.scenes;
  if (app.count("--voxels") > 0) o.voxels_mm = fusion.voxels_mm;
  if (app.count("--seed") > 0) o.seed = seed;
  return o;
}

Study study_of(const std::string& what, const FusionStudyOptions& fusion,
               const SegmentationStudyOptions& segmentation, const WeightingOptions& weighting,
               const ClicksStudyOptions& clicks) {
  if (what == "clicks") return study_clicks(std::cerr, clicks);
  if (what == "weighting") return study_weighting(std::cerr, weighting);
  if (what == "haptic") return study_haptic(std::cerr);
  return what == "fusion" ? study_fusion(std::cerr, fusion)
                          : study_segmentation(std::cerr, segmentation);
}

// Those that have options of their own; null: none of them.
int (*own_command(int argc, char** argv))(int, char**) {
  const std::string what = argc > 1 ? argv[1] : "";
  if (what == "moving") return cmd_moving;
  if (what == "recording") return cmd_recording;
  if (what == "choice") return cmd_choice;
  if (what == "prediction") return cmd_prediction_study;
  return what == "codec" ? cmd_codec_study : nullptr;
}

}  // namespace

int cmd_accuracy(int argc, char** argv) {
  if (const auto own = own_command(argc, argv)) return own(argc - 1, argv + 1);
  CLI::App app{
      "Error of a method against its CPU time, over its knobs. WHAT: fusion, weighting, "
      "segmentation, clicks, haptic; moving\n"
      "(accuracy moving --help): what a thing that moves does to fusion; recording (accuracy "
      "recording --help):\n"
      "one recording in every order, begun anywhere; choice (accuracy choice --help): segmentation "
      "chosen on one half\nof the images and judged on the other; codec (accuracy codec --help): "
      "what fusion makes of images behind the\nlink's codecs; prediction (accuracy prediction "
      "--help): the base's motion across the delay.",
      "teletact accuracy"};
  std::string what, json, plots, intrinsics;
  FusionStudyOptions fusion;
  SegmentationStudyOptions segmentation;
  ClicksStudyOptions clicks;
  int samples = WeightingOptions{}.samples;
  app.add_option("WHAT", what, "fusion | weighting | segmentation | clicks | haptic")
      ->required()
      ->check(CLI::IsMember({"fusion", "weighting", "segmentation", "clicks", "haptic"}));
  add_fusion(app, fusion, intrinsics, samples);
  app.add_option("--data", segmentation.data,
                 "segmentation, clicks: folder that holds mosd_learn, tabletop or ycb_video");
  bool default_only = false;
  add_clicks(app, clicks, default_only);
  app.add_option("--seed", segmentation.seed,
                 "segmentation: of the touches; weighting: of the samples, default 31; clicks: "
                 "of the first drawn scene, default 100")
      ->capture_default_str();
  app.add_option("--plots", plots, "folder for the SVG plots");
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_accuracy_use(app, what, app.count("--rgbd") > 0);
  if (what == "segmentation" && segmentation.data.empty())
    throw std::runtime_error("accuracy segmentation needs --data DIR");
  finish_clicks(app, segmentation, default_only, clicks);
  if (!intrinsics.empty()) fusion.pinhole = parse_pinhole(intrinsics);
  check_outputs({{"--json", json}}, {});
  if (!plots.empty()) make_output_folder("--plots", plots);
  const Study study = study_of(what, fusion, segmentation,
                               weighting_of(app, fusion, samples, segmentation.seed), clicks);
  study.print(std::cout);
  Metrics metrics("accuracy " + what);
  for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
  if (what == "fusion") add_room(study, metrics);
  if (!plots.empty()) write_pictures(study, what, plots);
  if (!json.empty()) metrics.write(json);
  return 0;
}

}  // namespace teletact

// teletact accuracy codec: what fusion makes of images that went through the link's codecs.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>

#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/measure/accuracy/codec/codec_colour.hpp"
#include "tools/measure/accuracy/codec/codec_steps.hpp"
#include "tools/measure/accuracy/codec/codec_study.hpp"
#include "tools/measure/measure_commands.hpp"

namespace teletact {

namespace {

// What --steps or --colour asks for.
struct Sweep {
  bool steps = false, colour = false;
  CodecStepsOptions options;
  std::string plots, noise = "strict";

  void describe(CLI::App& app) {
    auto* with_steps = app.add_flag(
        "--steps", steps, "instead: error, Mbit/s and CPU of every quality step of every mode");
    app.add_option("--steps-seed", options.seed, "of that room")
        ->needs(with_steps)
        ->capture_default_str();
    app.add_option("--steps-noise", noise, "of camera and codec: strict, lenient")
        ->needs(with_steps)
        ->check(CLI::IsMember({"strict", "lenient"}));
    app.add_flag("--colour", colour,
                 "instead: error, bytes and CPU of H.264 over its finest quantizer")
        ->excludes(with_steps);
    app.add_option("--plots", plots, "folder for the SVG plots of --steps or --colour");
  }
  [[nodiscard]] bool asked() const { return steps || colour; }
  void run(const CodecStudyOptions& o, const std::string& json) {
    if (!plots.empty()) make_output_folder("--plots", plots);
    if (noise == "lenient") options.noise = drivers::DepthNoiseLaw::kLenient;
    const Study study = colour ? study_codec_colour(std::cerr, {21, 60, o.rgbd, o.rgbd_frames})
                               : study_codec_steps(std::cerr, options);
    study.print(std::cout);
    if (!plots.empty()) {
      for (const std::string& file : study.write_plots(plots)) std::cout << file << "\n";
    }
    Metrics metrics("accuracy codec");
    for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
    if (!json.empty()) metrics.write(json);
  }
};

}  // namespace

int cmd_codec_study(int argc, char** argv) {
  CLI::App app{
      "Bytes, CPU, and what fusion makes of depth and colour behind the link's codecs: seeded "
      "rooms, at rest and\nmoving, and a recording. Ends with 1 when a limit is missed.",
      "teletact accuracy codec"};
  CodecStudyOptions o;
  Sweep sweep;
  std::string intrinsics, json;
  o.rgbd = "../shared/data/rgbd/7scenes_redkitchen";
  app.add_option("--seeds", o.seeds, "rooms")->check(CLI::Range(0, 1000))->capture_default_str();
  app.add_option("--rest-frames", o.rest_frames, "of a camera at rest; 0: none")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  app.add_option("--moving-frames", o.moving_frames, "of a carried camera; 0: none")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  app.add_option("--presses", o.presses, "places of each map that a hand presses on; 0: none")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  app.add_option("--voxel", o.voxel_mm, "edge of a voxel, mm")
      ->check(in_range(4, 100))
      ->capture_default_str();
  auto* rgbd =
      app.add_option("--rgbd", o.rgbd, "recording with true poses; the default may be absent")
          ->capture_default_str();
  app.add_option("--rgbd-frames", o.rgbd_frames, "of it, at most")
      ->check(CLI::Range(5, 100000))
      ->capture_default_str();
  app.add_option("--rate", o.rate_mbit_s, "of the recording, depth and colour, Mbit/s")
      ->check(in_range(0.1, 1000))
      ->capture_default_str();
  app.add_option(
      "--intrinsics", intrinsics,
      "where it has no intrinsics.txt: fx,fy,cx,cy in px, and depth units a metre if the "
      "data set's are not right");
  sweep.describe(app);
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  if (!intrinsics.empty()) o.pinhole = parse_pinhole(intrinsics);
  if (rgbd->count() == 0 && !std::filesystem::exists(o.rgbd)) {
    std::cerr << o.rgbd << " is not there: only the synthetic rooms\n";
    o.rgbd.clear();
  }
  if (!sweep.asked() && !sweep.plots.empty())
    throw std::runtime_error("--plots: needs --steps or --colour");
  if (sweep.asked()) {
    sweep.run(o, json);
    return 0;
  }
  const CodecStudy study = study_codec(std::cerr, o);
  study.print(std::cout);
  Metrics metrics("accuracy codec");
  for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
  if (!json.empty()) metrics.write(json);
  return missed(study.limits().all()) > 0 ? 1 : 0;
}

}  // namespace teletact

// The benches of `teletact bench` that have options of their own: those options, and one run.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>

#include "rt/store/run_store.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/fusion_peer.hpp"
#include "tools/measure/bench/fuzz.hpp"
#include "tools/measure/bench/link/link_bench.hpp"
#include "tools/measure/bench/table1.hpp"
#include "tools/measure/days.hpp"
#include "tools/measure/effect_bench.hpp"
#include "tools/measure/fuzz_readers.hpp"
#include "tools/measure/haptic/bench_haptic.hpp"
#include "tools/measure/haptic/boundary.hpp"
#include "tools/measure/haptic/recording_touch.hpp"
#include "tools/measure/prediction/prediction_bench.hpp"

namespace teletact {

struct FuzzBench {
  FuzzOptions options;
  void add_to(CLI::App& app) {
    app.add_option("--seconds", options.seconds,
                   "fuzz: CPU seconds for each reader; console: about so long each part")
        ->check(in_range(0.1, 1e6))
        ->capture_default_str();
    app.add_option("--reader", options.only, "fuzz: one reader only");
    app.add_option("--jobs", options.jobs, "fuzz: readers at once")
        ->check(CLI::Range(1, 64))
        ->capture_default_str();
    app.add_option("--keep", options.keep, "fuzz: folder for the input of a fault")
        ->capture_default_str();
  }
  [[nodiscard]] FuzzResult run(std::uint64_t seed) {
    options.seed = seed;
    const FuzzReaders readers;
    return bench_fuzz(std::cerr, readers.all(), options);
  }
};

struct PeerBench {
  FusionPeerOptions options;
  void add_to(CLI::App& app) {
    app.add_flag("--peer", options.peers, "fusion: OpenCV's rgbd parts and Open3D beside ours");
    app.add_flag("!--no-synthetic", options.synthetic, "fusion: only the recording");
  }
  [[nodiscard]] FusionPeerResult run(const std::string& rgbd) {
    options.rgbd = rgbd;
    return bench_fusion_peer(std::cerr, options);
  }
};

struct HapticBench {
  HapticBenchOptions options;
  RecordingTouchOptions recording;
  BoundaryOptions boundary;
  std::string svg, record, first;
  void add_to(CLI::App& app) {
    app.add_option("--passes", options.passes, "haptic: over the recorded run")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    app.add_flag("!--no-instructions", options.instructions, "haptic: do not run callgrind");
    app.add_option("--runs-in", options.folder, "haptic: folder to keep the recorded runs in");
    app.add_option("--virtual-seconds", recording.seconds, "haptic --rgbd: how long it is touched")
        ->check(in_range(2, 600))
        ->capture_default_str();
    app.add_option("--paths", recording.paths,
                   "haptic --rgbd: how many, seeds from --seed on, all over one fusion")
        ->check(CLI::Range(1, 100))
        ->capture_default_str();
    app.add_option("--first-place", first,
                   "haptic --rgbd: wall | top | edge | corner; default: "
                   "what is seen first")
        ->check(CLI::IsMember({"wall", "top", "edge", "corner"}));
    app.add_flag("!--no-beside", recording.beside, "haptic --rgbd: only the product's method");
    app.add_flag("--optimum", recording.optimum,
                 "haptic --rgbd: where a limit is missed, would the field's optimum miss it?");
    app.add_option("--record", record,
                   "haptic --rgbd: haptic run to write (teletact touch --replay)");
    app.add_option("--rates", boundary.rates_hz, "boundary: ticks a second")
        ->check(in_range(500, 4000))
        ->delimiter(',')
        ->capture_default_str();
    app.add_option("--dampings", boundary.dampings, "boundary: of the device, N s/m")
        ->check(in_range(0.1, 20))
        ->delimiter(',')
        ->capture_default_str();
    app.add_option("--svg", svg, "haptic --rgbd, boundary, prediction: folder for drawings");
  }
  // A hand on a recording.
  [[nodiscard]] RecordingTouchResult touch(const std::string& rgbd, std::uint64_t seed) {
    recording.rgbd = rgbd;
    recording.seed = seed;
    for (const auto kind :
         {Place::Kind::kWall, Place::Kind::kTop, Place::Kind::kEdge, Place::Kind::kCorner}) {
      if (first == name_of(kind)) recording.first = kind;
    }
    std::unique_ptr<WholeFile> file;
    if (!record.empty()) file = std::make_unique<WholeFile>(record);
    if (file) recording.record = file->get();
    RecordingTouchResult result = touch_recording(std::cerr, recording);
    if (file) file->finish();
    draw("haptic_recording_force.svg", result.force_drawing());
    draw("haptic_recording_step.svg", result.step_drawing());
    return result;
  }
  [[nodiscard]] BoundaryResult sweep() {
    BoundaryResult result = bench_boundary(std::cerr, boundary);
    draw("haptic_boundary.svg", result.drawing());
    return result;
  }

 private:
  void draw(const std::string& name, const std::string& text) const {
    if (!svg.empty()) write_whole_file(svg + "/" + name, text);
  }
};

inline void add_table1_options(CLI::App& app, Table1Options& table1, bool& instructions) {
  app.add_option("--edges", table1.edges, "table1: voxels along the cube's edge")
      ->check(CLI::Range(64, 1024))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--isa", table1.isas,
                 "table1: auto, scalar, sse4, avx2 or avx512; further ones run beside the first")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--runs", table1.runs, "table1: passes, of which the median is taken")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app.add_flag("!--no-fixed-voxel", table1.fixed_voxel,
               "table1: without the second table (voxels of 10 mm, cubes of N x 10 mm)");
  app.add_flag("--instructions", instructions,
               "table1: instructions of a frame in place of times (callgrind, 20 frames), with the "
               "watch for moving things and without");
}

struct EffectsBench {
  std::string effect, file;
  double span_s = 8;
  void add_to(CLI::App& app) {
    app.add_option("--effect", effect, "effects: this one alone, by its name in teletact explain");
    app.add_option("--write", file,
                   "effects: write the table that teletact explain prints; prediction, days, link: "
                   "write the page of docs/measured");
    app.add_option("--span", span_s, "effects: simulated seconds of a run")
        ->check(in_range(1, 600))
        ->capture_default_str();
  }
  [[nodiscard]] EffectCosts run(int rounds) const {
    rt::Startup startup;
    EffectCosts costs = measure_effects(startup.token(), std::cerr, span_s, rounds, effect);
    costs.host = tasks::host_id();
    return costs;
  }
};

struct DriftOptions {
  double voxel_m = 0.01;
  bool half_size = false;
  void add_to(CLI::App& app) {
    app.add_option("--voxel", voxel_m, "drift: edge of a voxel, m")
        ->check(in_range(0.005, 0.08))
        ->capture_default_str();
    app.add_flag("--half-size", half_size, "drift: images of 256 x 212");
  }
};

struct DaysBench {
  DaysOptions options;
  std::uint64_t cap_MiB = options.cap_bytes >> 20U;
  void add_to(CLI::App& app) {
    app.add_option("--hours", options.hours, "days: of simulated time")
        ->check(in_range(0.02, 1000))
        ->capture_default_str();
    app.add_option("--store-cap", cap_MiB, "days: MiB of each box's job records")
        ->check(CLI::Range(rt::StoreOptions::kLeastCap >> 20U, std::uint64_t{1} << 24U))
        ->capture_default_str();
    app.add_flag("--in-memory", options.in_memory, "days: without stores, for comparison");
  }
  [[nodiscard]] DaysResult run(const std::string& page, const std::string& command) {
    options.cap_bytes = cap_MiB << 20U;
    DaysResult result = bench_days(std::cerr, options);
    if (!page.empty()) write_whole_file(page, result.page(command));
    return result;
  }
};

struct LinkBench {
  LinkBenchOptions options;
  void add_to(CLI::App& app) {
    app.add_option("--link-run", options.only, "link: these runs alone")
        ->check(CLI::IsMember(link_run_names()))
        ->delimiter(',');
    app.add_option("--run-seconds", options.seconds, "link: of rest, strict and lenient")
        ->check(in_range(20, 600))
        ->capture_default_str();
  }
  [[nodiscard]] LinkBenchResult run(const std::string& page, const std::string& command) const {
    LinkBenchResult result = bench_link(std::cerr, options);
    if (!page.empty()) write_whole_file(page, result.page(command));
    return result;
  }
};

struct ConsoleBench {
  ConsoleBenchOptions options;
  void add_to(CLI::App& app) {
    app.add_option("--part", options.only, "console: these parts alone: stop, acts, cost, growth")
        ->check(CLI::IsMember(console_parts()))
        ->delimiter(',');
  }
  // `seconds`: 0: each part its own length.
  [[nodiscard]] ConsoleBenchResult run(const std::string& recording, double seconds, bool long_run,
                                       const std::string& page, const std::string& command) {
    options.recording = recording;
    options.seconds = seconds;
    options.long_run = long_run;
    ConsoleBenchResult result = bench_console(std::cerr, options);
    if (!page.empty()) write_whole_file(page, result.page(command));
    return result;
  }
};

struct PredictionBench {
  TraceSetOptions options;
  std::string logs = "../shared/data/odometry";
  void add_to(CLI::App& app) {
    app.add_option("--logs", logs, "prediction: folder of odometry logs; the default may be absent")
        ->capture_default_str();
    app.add_flag("--choice", options.choice,
                 "prediction: on the data that its constants were chosen on (seed 5, first halves "
                 "of the logs) in place of those that judge (seed 4, second halves)");
    app.add_option("--trace-seconds", options.length_s, "prediction: of each driven trace")
        ->check(in_range(10, 3600))
        ->capture_default_str();
  }
  [[nodiscard]] PredictionResult run(const CLI::App& app, std::uint64_t seed,
                                     const std::string& svg, const std::string& page) {
    options.seed = app.count("--seed") > 0 ? seed : options.choice ? 5 : 4;
    const bool there = std::filesystem::exists(logs);
    if (!there && app.count("--logs") > 0) throw std::runtime_error(logs + " is not there");
    options.folder = there ? logs : "";
    PredictionResult result = bench_prediction(std::cerr, options);
    if (!there) result.no_logs = logs + " is not there";
    if (!svg.empty()) {
      write_whole_file(svg + "/prediction_100ms.svg", result.drawings[0]);
      write_whole_file(svg + "/prediction_200ms.svg", result.drawings[1]);
    }
    if (!page.empty())
      write_whole_file(page, result.page("teletact bench prediction --write FILE"));
    return result;
  }
};

}  // namespace teletact

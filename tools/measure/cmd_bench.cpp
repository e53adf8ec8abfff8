// teletact bench WHAT: figures beside a peer's, measured in the same run.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <memory>
#include <stdexcept>

#include "rt/store/run_store.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/cli/option_use.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/bench/audit_bench.hpp"
#include "tools/measure/bench/codec/codec_bench.hpp"
#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/drift.hpp"
#include "tools/measure/bench/fusion_peer.hpp"
#include "tools/measure/bench/fuzz.hpp"
#include "tools/measure/bench/link/link_bench.hpp"
#include "tools/measure/bench/log_bench.hpp"
#include "tools/measure/bench/rings.hpp"
#include "tools/measure/bench/table1.hpp"
#include "tools/measure/bench/table1_instructions.hpp"
#include "tools/measure/bench/table2/table2.hpp"
#include "tools/measure/bench/table2/touches.hpp"
#include "tools/measure/bench/wakeup.hpp"
#include "tools/measure/days.hpp"
#include "tools/measure/effect_bench.hpp"
#include "tools/measure/fuzz_readers.hpp"
#include "tools/measure/haptic/bench_haptic.hpp"
#include "tools/measure/haptic/boundary.hpp"
#include "tools/measure/haptic/recording_touch.hpp"
#include "tools/measure/measure_commands.hpp"
#include "tools/measure/prediction/prediction_bench.hpp"

namespace teletact {

namespace {

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

void add_table1_options(CLI::App& app, Table1Options& table1, bool& instructions) {
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
  explicit DaysBench(CLI::App& app) {
    app.add_option("--hours", options.hours, "days: of simulated time")
        ->check(in_range(0.02, 1000))
        ->capture_default_str();
    app.add_option("--store-cap", cap_MiB, "days: MiB of each box's job records")
        ->check(CLI::Range(rt::StoreOptions::kLeastCap >> 20U, std::uint64_t{1} << 24U))
        ->capture_default_str();
    app.add_flag("--in-memory", options.in_memory, "days: without stores, for comparison");
  }
  [[nodiscard]] DaysResult run(const std::string& page, int argc, char** argv) {
    std::string command = "teletact";
    for (int i = 0; i < argc; ++i) command += " " + std::string(argv[i]);
    options.cap_bytes = cap_MiB << 20U;
    DaysResult result = bench_days(std::cerr, options);
    if (!page.empty()) write_whole_file(page, result.page(command));
    return result;
  }
};

struct LinkBench {
  LinkBenchOptions options;
  explicit LinkBench(CLI::App& app) {
    app.add_option("--link-run", options.only, "link: these runs alone")
        ->check(CLI::IsMember(link_run_names()))
        ->delimiter(',');
    app.add_option("--run-seconds", options.seconds, "link: of rest, strict and lenient")
        ->check(in_range(20, 600))
        ->capture_default_str();
  }
  [[nodiscard]] LinkBenchResult run(const std::string& page, int argc, char** argv) const {
    std::string command = "teletact";
    for (int i = 0; i < argc; ++i) command += " " + std::string(argv[i]);
    LinkBenchResult result = bench_link(std::cerr, options);
    if (!page.empty()) write_whole_file(page, result.page(command));
    return result;
  }
};

struct ConsoleBench {
  ConsoleBenchOptions options;
  explicit ConsoleBench(CLI::App& app) {
    app.add_option("--part", options.only, "console: these parts alone: stop, acts, cost, growth")
        ->check(CLI::IsMember(console_parts()))
        ->delimiter(',');
  }
  // `seconds`: 0: each part its own length.
  [[nodiscard]] ConsoleBenchResult run(const std::string& recording, double seconds, bool long_run,
                                       const std::string& page, int argc, char** argv) {
    std::string command = "teletact";
    for (int i = 0; i < argc; ++i) command += " " + std::string(argv[i]);
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
  explicit PredictionBench(CLI::App& app) {
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

void add_what(CLI::App& app, std::string& what) {
  const std::vector<std::string> names = {
      "rings",      "wakeup",  "audit", "table1", "table2", "segmentation",
      "fusion",     "codec",   "drift", "fuzz",   "haptic", "boundary",
      "prediction", "effects", "days",  "link",   "console"};
  app.add_option("WHAT", what,
                 "rings | wakeup | audit | table1 | table2 | segmentation | fusion | codec | drift "
                 "| fuzz | haptic | boundary | prediction | effects | days | link | console")
      ->required()
      ->check(CLI::IsMember(names));
}

}  // namespace

int cmd_bench(int argc, char** argv) {
  CLI::App app{"Measures one part beside its peers. Ends with 1 when a limit is missed."};
  std::string what, json;
  int rounds = 9;
  double slice_s = 1.0;
  add_what(app, what);
  app.add_option("--rounds", rounds, "interleaved rounds")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--slice", slice_s, "wakeup: seconds a slice")
      ->check(in_range(0.2, 60))
      ->capture_default_str();
  EffectsBench effects;
  effects.add_to(app);
  Table1Options table1;
  table1.rgbd = "../shared/data/rgbd/7scenes_redkitchen";
  std::string intrinsics;
  auto* rgbd =
      app.add_option(
             "--rgbd", table1.rgbd,
             "table1, fusion: recording in TUM or 7-Scenes layout; the default may be absent; "
             "haptic: touch this recording instead")
          ->capture_default_str();
  app.add_option("--intrinsics", intrinsics,
                 "of the recording, where it has no intrinsics.txt: fx,fy,cx,cy in px, and depth "
                 "units a metre if the data set's are not right");
  bool instructions = false;
  add_table1_options(app, table1, instructions);
  std::string data;
  std::uint64_t seed = 1;
  app.add_option("--data", data,
                 "table2, segmentation: folder of images with people's or true masks");
  app.add_option("--seed", seed,
                 "segmentation: of the touches; fuzz: of the damage; haptic: of the hand's path; "
                 "codec: of the room; prediction: of the driven traces, default 4")
      ->capture_default_str();
  CodecBenchOptions codec;
  app.add_flag("--long", codec.long_run,
               "codec: 100,000 damaged frames of each kind, 10,000 states; "
               "console: growth over an hour's worth of views");
  FuzzBench fuzz;
  fuzz.add_to(app);
  PeerBench peer;
  peer.add_to(app);
  HapticBench haptic;
  haptic.add_to(app);
  PredictionBench prediction(app);
  DaysBench days(app);
  const LinkBench link(app);
  ConsoleBench console(app);
  int frames = 0;
  DriftOptions drift;
  app.add_option(
         "--frames,--count", frames,
         "how many of each sequence (a shorter recording: as many as it has); default: table1 150, "
         "fusion and codec 60, drift 10000")
      ->check(CLI::Range(20, 10000000));
  drift.add_to(app);
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_bench_use(app, what, rgbd->count() > 0);
  check_outputs({{"--json", json}, {"--record", haptic.record}, {"--write", effects.file}}, {});
  if (!haptic.svg.empty()) make_output_folder("--svg", haptic.svg);
  if (!intrinsics.empty())
    table1.pinhole = peer.options.pinhole = haptic.recording.pinhole = parse_pinhole(intrinsics);
  if (frames > 0) table1.frames = peer.options.frames = codec.frames = frames;
  codec.seed = seed;
  Metrics metrics("bench " + what);
  int missed = 0;
  const auto take = [&](const auto& result) {
    result.print(std::cout);
    for (const auto& m : result.metrics()) metrics.add(m.name, m.value, m.unit);
    missed += result.missed();
  };
  if (what == "rings") {
    take(bench_rings(std::cerr, rounds));
  } else if (what == "wakeup") {
    take(bench_wakeup(std::cerr, rounds, slice_s));
  } else if (what == "drift") {
    take(bench_drift(std::cerr, frames > 0 ? frames : 10000, drift.voxel_m,
                     drift.half_size ? 2 : 1));
  } else if (what == "codec") {
    take(bench_codec(std::cerr, codec));
  } else if (what == "haptic") {
    if (rgbd->count() > 0) {
      take(haptic.touch(table1.rgbd, seed));
    } else {
      take(bench_haptic(std::cerr, haptic.options));
    }
  } else if (what == "boundary") {
    take(haptic.sweep());
  } else if (what == "effects") {
    const EffectCosts costs = effects.run(app.count("--rounds") > 0 ? rounds : 3);
    if (!effects.effect.empty()) {
      costs.print(std::cout);  // one of them: nothing is missing
      for (const auto& m : costs.metrics()) metrics.add(m.name, m.value, m.unit);
    } else {
      take(costs);
    }
    if (!effects.file.empty()) write_whole_file(effects.file, effect_costs_toml(costs));
  } else if (what == "table2" || what == "segmentation") {
    if (data.empty()) throw std::runtime_error("bench " + what + " needs --data DIR");
    if (what == "table2") {
      take(bench_table2(std::cerr, data));
    } else {
      take(bench_touches(std::cerr, data, seed));
    }
  } else if (what == "fuzz") {
    take(fuzz.run(seed));
  } else if (what == "days") {
    take(days.run(effects.file, argc, argv));
  } else if (what == "link") {
    take(link.run(effects.file, argc, argv));
  } else if (what == "console") {
    take(console.run(table1.rgbd, app.count("--seconds") > 0 ? fuzz.options.seconds : 0,
                     codec.long_run, effects.file, argc, argv));
  } else if (what == "prediction") {
    take(prediction.run(app, seed, haptic.svg, effects.file));
  } else if (what == "table1" || what == "fusion") {
    if (rgbd->count() == 0 && !std::filesystem::exists(table1.rgbd)) {
      std::cerr << table1.rgbd << " is not there: only the synthetic room\n";
      table1.rgbd.clear();
    }
    if (what == "table1" && instructions) {
      const InstructionsResult result = count_table1(std::cerr, table1, frames > 0 ? frames : 20);
      take(result);
      missed += result.not_counted.empty() ? 0 : 1;
    } else if (what == "table1") {
      take(bench_table1(std::cerr, table1));
    } else {
      take(peer.run(table1.rgbd));
    }
  } else {
    // A second each: others' load is told in ticks of 10 ms.
    take(bench_audit(1000));
    take(bench_log(30000));
  }
  if (!json.empty()) metrics.write(json);
  return missed == 0 ? 0 : 1;
}

}  // namespace teletact

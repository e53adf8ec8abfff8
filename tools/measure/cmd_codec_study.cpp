// teletact accuracy codec: what fusion makes of images that went through the link's codecs.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>

#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/measure/accuracy/codec_study.hpp"
#include "tools/measure/commands.hpp"

namespace teletact {

int cmd_codec_study(int argc, char** argv) {
  CLI::App app{
      "Bytes, CPU, and what fusion makes of depth and colour behind the link's codecs: seeded "
      "rooms, "
      "at rest and\nmoving, and a recording. Ends with 1 when a limit is missed.",
      "teletact accuracy codec"};
  CodecStudyOptions o;
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
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  if (!intrinsics.empty()) o.pinhole = parse_pinhole(intrinsics);
  if (rgbd->count() == 0 && !std::filesystem::exists(o.rgbd)) {
    std::cerr << o.rgbd << " is not there: only the synthetic rooms\n";
    o.rgbd.clear();
  }
  const CodecStudy study = study_codec(std::cerr, o);
  study.print(std::cout);
  Metrics metrics("accuracy codec");
  for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
  if (!json.empty()) metrics.write(json);
  return missed(study.limits().all()) > 0 ? 1 : 0;
}

}  // namespace teletact

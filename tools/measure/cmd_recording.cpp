// teletact accuracy recording: one recording in every order, begun anywhere, at every level.
#include <CLI/CLI.hpp>
#include <iostream>

#include "tasks/fusion/fusion_task.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/measure/accuracy/recording_study.hpp"
#include "tools/measure/measure_commands.hpp"

namespace teletact {

int cmd_recording(int argc, char** argv) {
  CLI::App app{
      "A recording forwards, backwards and every second frame, begun at each twentieth frame, and "
      "at "
      "each level of\nfusion: is the camera claimed where it is not? Ends with 1 when it is.",
      "teletact accuracy recording"};
  RecordingStudyOptions o;
  std::string rgbd, intrinsics, json;
  int frames = 150;
  app.add_option("--rgbd", rgbd,
                 "recording in TUM or 7-Scenes layout with true poses, which judge "
                 "and nothing else")
      ->required();
  app.add_option("--rgbd-frames", frames, "of the recording, at most")
      ->check(CLI::Range(5, 100000))
      ->capture_default_str();
  app.add_option(
      "--intrinsics", intrinsics,
      "where it has no intrinsics.txt: fx,fy,cx,cy in px, and depth units a metre if the "
      "data set's are not right");
  app.add_option("--voxels", o.voxels_mm, "edges of a voxel, mm, of each order and start")
      ->check(in_range(4, 100))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--start-step", o.start_step, "frames between two starts")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--level-voxels", o.level_voxels_mm, "edges of a voxel, mm, of each level")
      ->check(in_range(4, 100))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--levels", o.levels, "of fusion")
      ->check(CLI::Range(0, tasks::FusionConfig::kMaxLevels - 1))
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--wrong", o.wrong_mm, "a claimed pose farther off is wrong, mm")
      ->check(in_range(0.1, 10000))
      ->capture_default_str();
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  RecordingOptions recording{frames, 2};
  if (!intrinsics.empty()) recording.pinhole = parse_pinhole(intrinsics);
  const RecordingStudy study =
      study_recording(std::cerr, recorded_sequence(std::cerr, rgbd, recording), o);
  study.print(std::cout);
  Metrics metrics("accuracy recording");
  for (const BenchMetric& m : study.metrics()) metrics.add(m.name, m.value, m.unit);
  if (!json.empty()) metrics.write(json);
  return missed(study.limits().all()) > 0 ? 1 : 0;
}

}  // namespace teletact

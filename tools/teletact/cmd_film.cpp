// teletact film: what the synthetic camera sees of a place, written as a recording (TUM layout),
// with its true poses.
//
//   --scene NAME    room, stairs, turn, sixth, near (tools/record/scenes.hpp), or a scene of
//                   config/scenes or a file: its [world], carried by hand as in `room`
//   --out DIR       associations.txt, intrinsics.txt, groundtruth.txt, depth/, rgb/
//   --frames N      images, 30 a second; --first N: begins with that one; --backwards: the last one
//                   first
//   --json FILE     docs/metrics.md
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>

#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/record/recording_writer.hpp"
#include "tools/record/scenes.hpp"
#include "tools/scene/scene.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

int cmd_film(int argc, char** argv) {
  CLI::App app{
      "Films a synthetic place and writes the images as a recording, with the true poses."};
  std::string name = "room", out, json;
  int frames = 150, first = 0;
  bool backwards = false;
  app.add_option("--scene", name,
                 "room, stairs, turn, sixth, near, or the world of a scene, by name or file")
      ->capture_default_str();
  app.add_option("--out", out, "folder of the recording")->required();
  app.add_option("--frames", frames, "images, 30 a second")
      ->check(CLI::Range(1, 3000))
      ->capture_default_str();
  app.add_option("--first", first, "begins with this image of the way")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  app.add_flag("--backwards", backwards, "the last image first");
  app.add_option("--json", json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  check_outputs({{"--json", json}}, {});
  const auto& known = scene_names();
  SyntheticRoom room;
  if (std::find(known.begin(), known.end(), name) != known.end()) {
    room = scene_named(name);
  } else {
    const auto scene = load_scene(find_config("scenes", name), {});
    room.world = scene->world;
    room.noise = scene->camera.noise;
  }
  make_output_folder("--out", out);
  rt::Startup startup;
  FusionSequence sequence;
  film(startup.token(), room, first, frames, sequence);
  write_recording(sequence, out, backwards);
  std::size_t readings = 0;
  const auto& k = sequence.intrinsics;
  for (int i = 0; i < frames; ++i) {
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) readings += sequence.depth_mm(i, u, v) != 0 ? 1 : 0;
    }
  }
  Metrics metrics("film");
  metrics.add("film.frames", frames, "1");
  metrics.add("film.readings_share",
              static_cast<double>(readings) / (static_cast<double>(frames) * k.width * k.height),
              "1");
  if (!json.empty()) metrics.write(json);
  std::printf("%s: %d images of %d x %d\n", out.c_str(), frames, room.camera.width,
              room.camera.height);
  return 0;
}

}  // namespace teletact

// Images through the fusion task, for callgrind to count.
//
//   fusion_count FRAMES VOXEL_M LEVEL MOTION
//
// FRAMES: raw RgbdFrame records of this build, as tools/measure/bench/table1_instructions.cpp
// writes them. MOTION: on, off. Prints how many were claimed; 1 when fewer than 98 % were.
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tools/record/fusion_feed.hpp"

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: fusion_count FRAMES VOXEL_M LEVEL on|off\n");
    return 2;
  }
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(argv[1], "rbe"),
                                                             &std::fclose);
  if (!file) {
    std::fprintf(stderr, "fusion_count: %s can not be opened\n", argv[1]);
    return 2;
  }
  const auto frame = std::make_unique<perception::RgbdFrame>();
  const auto read = [&] { return std::fread(frame.get(), sizeof *frame, 1, file.get()) == 1; };
  if (!read()) {
    std::fprintf(stderr, "fusion_count: %s holds no frame\n", argv[1]);
    return 2;
  }
  rt::Startup startup;
  tasks::FusionConfig config;
  config.tsdf.voxel_size_m = std::atof(argv[2]);
  config.levels[0] = config.levels[static_cast<std::size_t>(std::atoi(argv[3]))];
  config.motion.on = std::string(argv[4]) == "on";
  config.view_period_frames = 0;
  tasks::FusionSetup setup;
  setup.camera = frame->intrinsics;
  tasks::FusionTask task(startup.token(), config, setup);
  teletact::FusionFeed feed(task);
  int frames = 0, claimed = 0;
  do {
    feed.frame() = *frame;
    ++frames;
    claimed += feed.step().camera.claimed ? 1 : 0;
  } while (read());
  std::printf("%d of %d frames claimed\n", claimed, frames);
  return 100 * claimed >= 98 * frames ? 0 : 1;
}

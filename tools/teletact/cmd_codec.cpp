// teletact codec: a recording through the codecs of the link and back.
//
//   --rgbd DIR     recording in TUM or 7-Scenes layout
//   --mode M       lossless, faithful, quiet, moving (drivers/codec/depth_stream.hpp), auto: quiet
//                  while the camera rests and moving while it moves (depth_motion.hpp)
//   --rate MBIT    of depth and colour, Mbit/s: depth takes coarser steps until it fits. Where the
//                  coarsest does not fit, a line says how many frames a second the rate carries
//   --out DIR      what was decoded, as a recording; codec.csv: bytes, kind and CPU of each frame;
//                  groundtruth.txt as the recording has it. Must be empty or not be there
//   --json FILE    docs/metrics.md
#include <CLI/CLI.hpp>

#include "tools/cli/options.hpp"
#include "tools/offline/code.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

int cmd_codec(int argc, char** argv) {
  CodecOptions o;
  CLI::App app("teletact codec: a recording through the codecs of the link and back",
               "teletact codec");
  app.add_option("--rgbd", o.rgbd, "folder in TUM or 7-Scenes layout")->required();
  app.add_option("--mode", o.mode,
                 "of depth: lossless, faithful, quiet, moving; auto: quiet or moving")
      ->required()
      ->check(CLI::IsMember({"lossless", "auto", "faithful", "quiet", "moving"}));
  app.add_option("--out", o.out, "folder for what was decoded; new or empty")->required();
  app.add_option("--rate", o.choice.rate_mbit_s,
                 "of depth and colour, Mbit/s: depth takes coarser steps until it fits")
      ->check(in_range(0.1, 1000));
  app.add_option("--noise", o.noise, "of the depth camera: strict (Kinect v2), lenient")
      ->check(CLI::IsMember({"strict", "lenient"}))
      ->capture_default_str();
  app.add_option("--step", o.choice.step, "quality of depth, 0 the finest; default: the mode's own")
      ->check(CLI::Range(0, drivers::kDepthSteps - 1));
  app.add_option("--colour", o.colour, "jpeg, h264, none")
      ->check(CLI::IsMember({"jpeg", "h264", "none"}))
      ->capture_default_str();
  app.add_option("--quality", o.choice.colour_demand.quality, "of jpeg")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app.add_option("--colour-rate", o.choice.colour_demand.rate_kbit_s, "of h264, kbit/s")
      ->check(CLI::Range(100, 20000))
      ->capture_default_str();
  app.add_flag("--half", o.choice.colour.half, "colour at half the width and height");
  app.add_option("--frames", o.frames, "the first ones, at most")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--intrinsics", o.intrinsics,
                 "where the folder has no intrinsics.txt: fx,fy,cx,cy in px, and depth units a "
                 "metre if the data set's are not right");
  app.add_option("--json", o.json, "write the figures to this file");
  if (!parse_options(app, argc, argv)) return 0;
  return code_recording(o);
}

}  // namespace teletact

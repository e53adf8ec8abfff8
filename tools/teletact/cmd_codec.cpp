// teletact codec: a recording through the codecs of the link and back.
//
//   --rgbd DIR     recording in TUM or 7-Scenes layout
//   --mode M       lossless, faithful, quiet, moving (drivers/codec/depth_stream.hpp)
//   --rate MBIT    of depth and colour, Mbit/s: depth takes coarser steps until it fits. Where the
//                  coarsest does not fit, a line says how many frames a second the rate carries
//   --out DIR      what was decoded, as a recording; codec.csv: bytes, kind and CPU of each frame;
//                  groundtruth.txt as the recording has it. Must be empty or not be there
//   --json FILE    docs/metrics.md
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>

#include "drivers/camera/tum_reader.hpp"
#include "rt/quantile.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/record/codec_chain.hpp"
#include "tools/record/recording_writer.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

struct CodecOptions {
  std::string rgbd, intrinsics, out, json;
  std::string mode, noise = "strict", colour = drivers::h264_built_in() ? "h264" : "jpeg";
  CodecChoice choice;
  int frames = 100000;
};

template <class T>
T take(rt::Result<T> r) {
  if (!r) throw std::runtime_error(r.error());
  return std::move(r.value());
}

CodecChoice choice_of(const CodecOptions& o) {
  CodecChoice c = o.choice;
  for (const auto mode : {drivers::DepthMode::kLossless, drivers::DepthMode::kFaithful,
                          drivers::DepthMode::kQuiet, drivers::DepthMode::kMoving})
    if (o.mode == to_text(mode)) c.mode = mode;
  c.law = o.noise == "lenient" ? drivers::DepthNoiseLaw::kLenient : drivers::DepthNoiseLaw::kStrict;
  c.with_colour = o.colour != "none";
  if (c.with_colour) c.colour.method = o.colour;
  return c;
}

// The folder that is written: new or empty before, and gone or empty again if it is not finished.
class NewFolder {
 public:
  explicit NewFolder(std::string folder) : folder_(std::move(folder)) {
    std::error_code failed;
    if (fs::exists(folder_) && (!fs::is_directory(folder_) || !fs::is_empty(folder_, failed)))
      throw std::runtime_error("--out " + folder_ + ": is there already and not empty");
    was_there_ = fs::exists(folder_);
    make_output_folder("--out", folder_);
  }
  ~NewFolder() {
    if (finished_) return;
    std::error_code ignored;
    if (!was_there_) {
      fs::remove_all(folder_, ignored);
      return;
    }
    for (const auto& entry : fs::directory_iterator(folder_, ignored))
      fs::remove_all(entry.path(), ignored);
  }
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;
  void finish() { finished_ = true; }

 private:
  std::string folder_;
  bool was_there_ = false, finished_ = false;
};

struct CodecTally {
  std::string csv =
      "frame,t_s,kind,step,bytes,depth_bytes,colour_bytes,depth_encode_ms,depth_decode_ms,"
      "colour_encode_ms,colour_decode_ms\n";
  double bytes = 0, depth_bytes = 0;
  std::vector<double> encode_ms, decode_ms;
  int frames = 0, keys = 0;

  void add(const std::string& stamp, const CodedFrame& f) {
    char line[240];
    std::snprintf(line, sizeof line, "%d,%s,%s,%d,%zu,%u,%zu,%.3f,%.3f,%.3f,%.3f\n", frames,
                  stamp.c_str(), to_text(f.depth.kind), f.depth.step, f.bytes(), f.depth.bytes,
                  f.colour_bytes, f.depth_encode_ms, f.depth_decode_ms, f.colour_encode_ms,
                  f.colour_decode_ms);
    csv += line;
    bytes += static_cast<double>(f.bytes());
    depth_bytes += f.depth.bytes;
    encode_ms.push_back(f.depth_encode_ms + f.colour_encode_ms);
    decode_ms.push_back(f.depth_decode_ms + f.colour_decode_ms);
    keys += f.depth.kind == drivers::DepthFrameKind::kKey ? 1 : 0;
    ++frames;
  }
};

// Of the frame rate that the stamps tell; --fps where there is one frame.
double rate_of(const drivers::TumSequence& sequence, int frames) {
  if (frames < 2) return 30;
  const double span_s = sequence.stamp_s(frames - 1) - sequence.stamp_s(0);
  return span_s > 0 ? std::min(1000.0, (frames - 1) / span_s) : 30;
}

// On the road the newest frame wins: where the coarsest step is over the rate, fewer frames arrive.
double fps_in_rate(const CodecTally& t, const CodecChoice& choice) {
  if (choice.rate_mbit_s <= 0) return choice.fps;
  return std::min(choice.fps, choice.rate_mbit_s * 1e6 / 8 * t.frames / t.bytes);
}

// Half a percent over is the last frames' rounding.
void say_rate(const CodecTally& t, const CodecChoice& choice) {
  const double fits = fps_in_rate(t, choice);
  if (fits >= 0.995 * choice.fps) return;
  std::printf(
      "--rate %g Mbit/s was not reached: it carries %.1f of these %.1f fps. Coarser: "
      "--noise lenient, --half, a lower --colour-rate\n",
      choice.rate_mbit_s, fits, choice.fps);
}

Metrics figures(const CodecTally& t, const CodecChoice& choice) {
  const double fps = choice.fps;
  const double n = t.frames;
  Metrics m("codec");
  m.add("codec.frames", n, "1");
  m.add("codec.keys", t.keys, "1");
  m.add("codec.frame_kB", 1e-3 * t.bytes / n, "kB");
  m.add("codec.depth_kB", 1e-3 * t.depth_bytes / n, "kB");
  m.add("codec.mbit_s", 8e-6 * t.bytes / n * fps, "Mbit/s");
  m.add("codec.fps_in_rate", fps_in_rate(t, choice), "1/s");
  m.add("codec.encode_ms", rt::quantile(t.encode_ms, 0.5), "ms");
  m.add("codec.decode_ms", rt::quantile(t.decode_ms, 0.5), "ms");
  return m;
}

int run(const CodecOptions& o) {
  CodecChoice choice = choice_of(o);
  check_outputs({{"--json", o.json}}, {});
  drivers::TumOptions tum;
  tum.register_colour = true;
  tum.skip_colour = !choice.with_colour;
  if (!o.intrinsics.empty()) tum.pinhole = parse_pinhole(o.intrinsics);
  const auto sequence = take(drivers::TumSequence::open(o.rgbd, tum));
  for (const std::string& line : sequence.assumed())
    std::fprintf(stderr, "teletact codec: %s\n", line.c_str());
  const int frames = std::min(sequence.size(), o.frames);
  choice.fps = rate_of(sequence, frames);
  choice.colour.fps = std::clamp(static_cast<int>(std::lround(choice.fps)), 1, 120);
  const auto& k = sequence.intrinsics();
  rt::Startup startup;
  CodecChain chain(startup.token(), choice, k.width, k.height);
  NewFolder folder(o.out);
  RecordingWriter writer(o.out);
  CodecTally tally;
  auto frame = std::make_unique<perception::RgbdFrame>();
  for (int i = 0; i < frames; ++i) {
    take(sequence.read(i, *frame));
    const CodedFrame coded = chain.pass(*frame);
    writer.add(*frame, sequence.stamp_text(i));
    tally.add(sequence.stamp_text(i), coded);
  }
  writer.finish();
  write_whole_file(o.out + "/codec.csv", tally.csv);
  // Poses of 7-Scenes are a file each; those of TUM one, which goes along.
  if (const fs::path truth = fs::path(o.rgbd) / "groundtruth.txt"; fs::exists(truth))
    fs::copy_file(truth, fs::path(o.out) / "groundtruth.txt");
  const Metrics m = figures(tally, choice);
  if (!o.json.empty()) m.write(o.json);
  folder.finish();
  const double n = tally.frames;
  std::printf(
      "%d frames, %d keys; %.1f kB a frame (depth %.1f), %.2f Mbit/s at %.1f fps; CPU %.2f ms "
      "encode, %.2f ms decode (p50)\n",
      tally.frames, tally.keys, 1e-3 * tally.bytes / n, 1e-3 * tally.depth_bytes / n,
      8e-6 * tally.bytes / n * choice.fps, choice.fps, rt::quantile(tally.encode_ms, 0.5),
      rt::quantile(tally.decode_ms, 0.5));
  say_rate(tally, choice);
  return 0;
}

}  // namespace

int cmd_codec(int argc, char** argv) {
  CodecOptions o;
  CLI::App app("teletact codec: a recording through the codecs of the link and back",
               "teletact codec");
  app.add_option("--rgbd", o.rgbd, "folder in TUM or 7-Scenes layout")->required();
  app.add_option("--mode", o.mode, "of depth: lossless, faithful, quiet, moving")
      ->required()
      ->check(CLI::IsMember({"lossless", "faithful", "quiet", "moving"}));
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
  return run(o);
}

}  // namespace teletact

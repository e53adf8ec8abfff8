#include "tools/offline/code.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <vector>

#include "drivers/camera/tum_reader.hpp"
#include "rt/quantile.hpp"
#include "tools/cli/number_list.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/take.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/record/recording_writer.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

CodecChoice choice_of(const CodecOptions& o) {
  CodecChoice c = o.choice;
  for (const auto mode : {drivers::DepthMode::kLossless, drivers::DepthMode::kFaithful,
                          drivers::DepthMode::kQuiet, drivers::DepthMode::kMoving})
    if (o.mode == to_text(mode)) c.mode = mode;
  c.by_motion = o.mode == "auto";
  if (c.by_motion) c.mode = drivers::DepthMode::kQuiet;  // until it moves
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

// The camera's: by the middle interval, so that a pause in the recording is no slow camera. 30 of
// one frame.
double rate_of(const drivers::TumSequence& sequence, int frames) {
  std::vector<double> intervals_s;
  for (int i = 1; i < frames; ++i)
    intervals_s.push_back(sequence.stamp_s(i) - sequence.stamp_s(i - 1));
  const double interval_s = rt::quantile(intervals_s, 0.5, 0);
  return interval_s > 0 ? std::clamp(1 / interval_s, 1.0, 1000.0) : 30;
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

}  // namespace

int code_recording(const CodecOptions& o) {
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

}  // namespace teletact

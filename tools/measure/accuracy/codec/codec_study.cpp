#include "tools/measure/accuracy/codec/codec_study.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "rt/quantile.hpp"
#include "tools/measure/accuracy/fusion_study.hpp"
#include "tools/measure/accuracy/press_error.hpp"
#include "tools/measure/accuracy/surface_error.hpp"
#include "tools/measure/bench/codec/codec_film.hpp"
#include "tools/record/codec_chain.hpp"

namespace teletact {

using drivers::DepthMode;
using perception::Pose;

namespace {

constexpr double kUnmeasured = std::numeric_limits<double>::quiet_NaN();
constexpr double kRestRatio = 1.1, kAte_mm = 1, kRmse_mm = 0.3, kRecordingAte_mm = 2,
                 kForce_N = 0.05;

double sequence_fps(const FusionSequence& s) {
  if (s.size() < 2) return 30;
  const double span_s =
      1e-9 * static_cast<double>((s.exposure(s.size() - 1) - s.exposure(0)).count());
  return span_s > 0 ? (s.size() - 1) / span_s : 30;
}

// The solids, and the points of them that the camera saw.
struct Truth {
  drivers::World solids;
  std::vector<perception::Vec3> seen_W;
};

class Runner {
 public:
  Runner(const CodecStudyOptions& options, std::ostream& progress, CodecStudy& study)
      : o_(options), progress_(progress), study_(study) {}

  // `world`: null where the true surface is not known.
  void fuse(const char* data, std::uint64_t seed, const FusionSequence& sequence,
            const Truth* world, const std::vector<DepthMode>& modes, double rate) {
    for (const DepthMode mode : modes) {
      progress_ << data << " seed " << seed << ": " << to_text(mode) << "\n";
      const CodedSequence coded = through_codec(startup_.token(), sequence, mode, rate);
      CodecStudyRow row;
      row.data = data, row.mode = to_text(mode), row.seed = seed;
      const tasks::FusionConfig config = fusion_with_voxel(1e-3 * o_.voxel_mm);
      const FusionRun run = run_fusion(
          startup_.token(), coded.sequence, config,
          [&](FusionFeed& feed, const Pose& X_WM) { press(feed, X_WM, world, config, row); });
      row.frames = sequence.size();
      row.claimed = static_cast<int>(std::lround(run.claimed * sequence.size()));
      row.mbit_s = coded.mbit_s, row.encode_ms = coded.encode_ms, row.decode_ms = coded.decode_ms;
      row.ate_mm = run.ate_mm;
      row.rmse_mm = row.p95_mm = kUnmeasured;
      if (world != nullptr) {
        const SurfaceError e = surface_error(run.mesh, world->solids, {});
        row.rmse_mm = e.rmse_mm, row.p95_mm = e.p95_mm;
      }
      study_.rows.push_back(row);
    }
  }
  void seed(std::uint64_t seed) {
    std::vector<DepthMode> rest{DepthMode::kLossless};
    rest.insert(rest.end(), o_.rest_modes.begin(), o_.rest_modes.end());
    for (const bool moving : {false, true}) {
      const int frames = moving ? o_.moving_frames : o_.rest_frames;
      if (frames < 2) continue;
      const CodecFilm film = film_codec(
          startup_.token(), {moving, drivers::DepthNoiseLaw::kStrict, seed, frames, false, 0.3});
      Truth truth{drivers::World(startup_.token(), film.world), {}};
      truth.seen_W = seen_surface(truth.solids, film.sensor.intrinsics, film.sensor.known_truth());
      fuse(moving ? "moving" : "rest", seed, film.sensor, &truth,
           moving ? std::vector{DepthMode::kLossless, DepthMode::kMoving} : rest, 0);
    }
  }

 private:
  void press(FusionFeed& feed, const Pose& X_WM, const Truth* world,
             const tasks::FusionConfig& config, CodecStudyRow& row) const {
    row.force_p95_N = kUnmeasured;
    if (world == nullptr || o_.presses == 0) return;
    PressOptions options;
    options.places = o_.presses, options.seed = row.seed;
    options.voxel_m = config.tsdf.voxel_size_m;
    const auto errors = press_errors_N(feed, X_WM, world->solids, world->seen_W, options);
    row.pressed = static_cast<int>(errors.size());
    row.force_p95_N = rt::quantile(errors, 0.95, kUnmeasured);
  }
  rt::Startup startup_;
  const CodecStudyOptions& o_;
  std::ostream& progress_;
  CodecStudy& study_;
};

}  // namespace

CodedSequence through_codec(rt::NonRealtime& nrt, const FusionSequence& sequence, DepthMode mode,
                            double rate_mbit_s) {
  CodecChoice choice;
  choice.mode = mode;
  choice.rate_mbit_s = mode == DepthMode::kLossless ? 0 : rate_mbit_s;
  choice.fps = sequence_fps(sequence);
  choice.colour.method = drivers::h264_built_in() ? "h264" : "jpeg";
  choice.colour.fps = std::clamp(static_cast<int>(std::lround(choice.fps)), 1, 120);
  choice.colour_demand.rate_kbit_s = 1000;
  CodecChain chain(nrt, choice, sequence.intrinsics.width, sequence.intrinsics.height);
  auto frame = std::make_unique<perception::RgbdFrame>();
  CodedSequence out;
  double bytes = 0;
  std::vector<double> encode, decode;
  for (int i = 0; i < sequence.size(); ++i) {
    sequence.frame(i, *frame);
    const CodedFrame coded = chain.pass(*frame);
    out.sequence.append(*frame);
    if (i == 0) continue;
    bytes += static_cast<double>(coded.bytes());
    encode.push_back(coded.depth_encode_ms), decode.push_back(coded.depth_decode_ms);
  }
  out.sequence.name = sequence.name;
  out.sequence.truth_WC = sequence.truth_WC;
  out.mbit_s = 8e-6 * bytes / std::max(1, sequence.size() - 1) * choice.fps;
  out.encode_ms = rt::quantile(encode, 0.5, kUnmeasured),
  out.decode_ms = rt::quantile(decode, 0.5, kUnmeasured);
  return out;
}

double CodecStudy::mean(const std::string& data, const std::string& mode,
                        double CodecStudyRow::*figure) const {
  double sum = 0;
  int n = 0;
  for (const CodecStudyRow& r : rows) {
    if (r.data != data || r.mode != mode) continue;
    sum += r.*figure, ++n;
  }
  return n > 0 ? sum / n : kUnmeasured;
}

Limits CodecStudy::limits() const {
  Limits all;
  const auto of = [&](const char* data, const char* mode, double CodecStudyRow::*figure) {
    return mean(data, mode, figure);
  };
  const auto unless = [&](const char* data) {
    const bool there = std::any_of(rows.begin(), rows.end(),
                                   [&](const CodecStudyRow& r) { return r.data == data; });
    return there ? std::string() : std::string("was not asked for");
  };
  all.add("at rest, quiet: surface RMSE over lossless",
          of("rest", "quiet", &CodecStudyRow::rmse_mm) /
              of("rest", "lossless", &CodecStudyRow::rmse_mm),
          "<=", kRestRatio, unless("rest"));
  all.add("moving: mean ATE over lossless, mm",
          of("moving", "moving", &CodecStudyRow::ate_mm) -
              of("moving", "lossless", &CodecStudyRow::ate_mm),
          "<=", kAte_mm, unless("moving"));
  all.add("moving: surface RMSE over lossless, mm",
          of("moving", "moving", &CodecStudyRow::rmse_mm) -
              of("moving", "lossless", &CodecStudyRow::rmse_mm),
          "<=", kRmse_mm, unless("moving"));
  for (const auto& [data, mode] : {std::pair{"rest", "quiet"}, std::pair{"moving", "moving"}}) {
    const bool asked =
        std::any_of(rows.begin(), rows.end(), [](const CodecStudyRow& r) { return r.pressed > 0; });
    all.add(std::string(data) + ": force off the true solid's, p95 over lossless, N",
            of(data, mode, &CodecStudyRow::force_p95_N) -
                of(data, "lossless", &CodecStudyRow::force_p95_N),
            "<=", kForce_N, asked ? unless(data) : "was not asked for");
  }
  int lost = 0;
  for (const CodecStudyRow& r : rows) lost += r.data == "recording" ? r.frames - r.claimed : 0;
  all.add("recording: frames not claimed", lost, "<=", 0, not_run);
  all.add("recording: ATE off lossless, mm",
          std::abs(of("recording", "moving", &CodecStudyRow::ate_mm) -
                   of("recording", "lossless", &CodecStudyRow::ate_mm)),
          "<=", kRecordingAte_mm, not_run);
  return all;
}

std::vector<BenchMetric> CodecStudy::metrics() const {
  std::vector<BenchMetric> all;
  std::vector<std::string> done;
  for (const CodecStudyRow& r : rows) {
    const std::string name = "accuracy.codec." + r.data + "." + r.mode + ".";
    if (std::find(done.begin(), done.end(), name) != done.end()) continue;
    done.push_back(name);
    const auto add = [&](const char* figure, double CodecStudyRow::*at, const char* unit) {
      const double value = mean(r.data, r.mode, at);
      if (value == value) all.push_back({name + figure, value, unit});
    };
    add("mbit_s", &CodecStudyRow::mbit_s, "Mbit/s");
    add("ate_mm", &CodecStudyRow::ate_mm, "mm");
    add("surface_rmse_mm", &CodecStudyRow::rmse_mm, "mm");
    add("surface_p95_mm", &CodecStudyRow::p95_mm, "mm");
    add("force_p95_N", &CodecStudyRow::force_p95_N, "N");
    add("encode_ms", &CodecStudyRow::encode_ms, "ms");
    add("decode_ms", &CodecStudyRow::decode_ms, "ms");
  }
  return all;
}

void CodecStudy::print(std::ostream& out) const {
  char line[200];
  std::snprintf(line, sizeof line, "%-10s %-9s %4s %8s %8s %8s %8s %8s %8s %8s %8s\n", "data",
                "mode", "seed", "claimed", "Mbit/s", "enc ms", "dec ms", "ATE mm", "RMSE mm",
                "p95 mm", "force N");
  out << line;
  for (const CodecStudyRow& r : rows) {
    std::snprintf(
        line, sizeof line, "%-10s %-9s %4llu %4d/%-3d %8.2f %8.2f %8.2f %8.2f %8.2f %8.2f %8.3f\n",
        r.data.c_str(), r.mode.c_str(), static_cast<unsigned long long>(r.seed), r.claimed,
        r.frames, r.mbit_s, r.encode_ms, r.decode_ms, r.ate_mm, r.rmse_mm, r.p95_mm, r.force_p95_N);
    out << line;
  }
  teletact::print(out, limits().all());
}

CodecStudy study_codec(std::ostream& progress, const CodecStudyOptions& options) {
  CodecStudy study;
  Runner runner(options, progress, study);
  // What is wrong with it is said before the rooms, which take minutes.
  if (options.rgbd.empty()) {
    study.not_run = "no recording was given";
  } else {
    const FusionSequence recording =
        recorded_sequence(progress, options.rgbd, {options.rgbd_frames, 2, options.pinhole});
    runner.fuse("recording", 0, recording, nullptr, {DepthMode::kLossless, DepthMode::kMoving},
                options.rate_mbit_s);
  }
  for (int n = 1; n <= options.seeds; ++n) runner.seed(static_cast<std::uint64_t>(n));
  return study;
}

}  // namespace teletact

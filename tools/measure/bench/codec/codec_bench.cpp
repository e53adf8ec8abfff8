#include "tools/measure/bench/codec/codec_bench.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "rt/quantile.hpp"
#include "rt/random.hpp"
#include "tools/measure/bench/codec/ffv1_peer.hpp"
#include "tools/measure/bench/other_load.hpp"
#include "tools/record/codec_chain.hpp"

namespace teletact {

using drivers::DepthMode;
using drivers::DepthNoiseLaw;
using perception::RgbdFrame;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr auto kStrict = DepthNoiseLaw::kStrict, kLenient = DepthNoiseLaw::kLenient;
constexpr double kRoad_mbit_s = 8.8;  // of 10: what images may take

std::size_t pixels_of(const perception::Intrinsics& k) {
  return std::min(static_cast<std::size_t>(k.width) * static_cast<std::size_t>(k.height),
                  RgbdFrame::kMaxPixels);
}

struct Errors {
  double decoded = 0, sensor = 0, worst = 0;
  std::int64_t inner = 0, flying = 0;

  void add(const CodecFilm& film, int i, const CodecBenchCase& c, const RgbdFrame& out,
           const RgbdFrame& in) {
    const std::size_t pixels = pixels_of(in.intrinsics);
    const std::size_t first = static_cast<std::size_t>(i) * pixels;
    for (std::size_t n = 0; n < pixels; ++n) {
      const int x = in.depth_mm[n], y = out.depth_mm[n], truth = film.truth_mm[first + n];
      if ((x == 0) != (y == 0)) ++flying;
      if (x == 0 || y == 0) continue;
      const double apart = std::abs(x - y) / noise_mm(c.law, 1e-3 * x);
      worst = std::max(worst, apart);
      const int off = truth != 0 ? std::min(std::abs(x - y), std::abs(truth - y)) : std::abs(x - y);
      flying += off > 30 && off > 5 * noise_mm(c.law, 1e-3 * x) ? 1 : 0;
      if (film.inner[first + n] == 0 || truth == 0) continue;
      const double sigma = noise_mm(c.noise, 1e-3 * truth);
      decoded += (y - truth) * (y - truth) / (sigma * sigma);
      sensor += (x - truth) * (x - truth) / (sigma * sigma);
      ++inner;
    }
  }
};

double median(const std::vector<double>& v) { return rt::quantile_or_nan(v, 0.5); }

}  // namespace

// The road has 8.8 Mbit/s for images. Limits: issue of the codecs; lenient is stated for a camera
// with the strict noise too, which is how the reference measured it.
const std::vector<CodecBenchCase>& codec_cases() {
  static const std::vector<CodecBenchCase> cases{
      {"lossless", DepthMode::kLossless, false, kStrict, kStrict, 30, 1500, 0, false},
      {"faithful", DepthMode::kFaithful, false, kStrict, kStrict, 30, 1500, 0, false},
      {"quiet", DepthMode::kQuiet, false, kStrict, kStrict, 30, 1500, 5.5, true},
      {"quiet_lenient", DepthMode::kQuiet, false, kLenient, kLenient, 30, 1500, 5.5, true},
      {"moving", DepthMode::kMoving, true, kStrict, kStrict, 24, 1000, kRoad_mbit_s, false},
      {"moving_lenient", DepthMode::kMoving, true, kLenient, kLenient, 30, 1000, kRoad_mbit_s,
       false},
      {"moving_lenient_law", DepthMode::kMoving, true, kStrict, kLenient, 30, 1500, kRoad_mbit_s,
       false},
  };
  return cases;
}

CodecBenchRow run_codec_case(rt::NonRealtime& nrt, const CodecBenchCase& c, const CodecFilm& film) {
  CodecChoice choice;
  choice.mode = c.mode;
  choice.law = c.law;
  choice.step = c.step;
  choice.with_colour = !c.depth_only;
  choice.fps = c.fps;
  choice.colour.method = drivers::h264_built_in() ? "h264" : "jpeg";
  choice.colour.fps = c.fps;
  choice.colour_demand.rate_kbit_s = c.colour_kbit_s;
  const auto& k = film.sensor.intrinsics;
  CodecChain chain(nrt, choice, k.width, k.height);
  std::unique_ptr<Ffv1Peer> ffv1;
  if (Ffv1Peer::built_in() && !c.depth_only) ffv1 = std::make_unique<Ffv1Peer>(k.width, k.height);
  const auto pixels = pixels_of(k);
  auto in = std::make_unique<RgbdFrame>(), out = std::make_unique<RgbdFrame>();
  std::vector<double> encode, decode, colour_encode, colour_decode, peer_encode, peer_decode;
  double depth = 0, colour = 0, peer = 0;
  Errors errors;
  CodecBenchRow row;
  row.what = &c;
  for (int i = 0; i < film.sensor.size(); ++i) {
    film.sensor.frame(i, *in);
    *out = *in;
    const CodedFrame coded = chain.pass(*out);
    errors.add(film, i, c, *out, *in);
    row.step = coded.depth.step;
    if (i == 0) row.key_kB = 1e-3 * static_cast<double>(coded.bytes());
    if (i == 0) continue;
    encode.push_back(coded.depth_encode_ms), decode.push_back(coded.depth_decode_ms);
    colour_encode.push_back(coded.colour_encode_ms);
    colour_decode.push_back(coded.colour_decode_ms);
    depth += coded.depth.bytes, colour += static_cast<double>(coded.colour_bytes);
    if (!ffv1) continue;
    const auto lossless = ffv1->pass({in->depth_mm.data(), pixels});
    peer_encode.push_back(lossless.encode_ms), peer_decode.push_back(lossless.decode_ms);
    peer += static_cast<double>(lossless.bytes);
  }
  const double per_frame = 8e-6 * c.fps / std::max(1, film.sensor.size() - 1);
  row.depth_mbit_s = depth * per_frame, row.colour_mbit_s = colour * per_frame;
  row.ffv1_mbit_s = ffv1 ? peer * per_frame : kNaN;
  row.encode_ms = median(encode), row.decode_ms = median(decode);
  row.colour_encode_ms = median(colour_encode), row.colour_decode_ms = median(colour_decode);
  row.ffv1_encode_ms = median(peer_encode), row.ffv1_decode_ms = median(peer_decode);
  row.error_sigma = std::sqrt(errors.decoded / static_cast<double>(errors.inner));
  row.sensor_sigma = std::sqrt(errors.sensor / static_cast<double>(errors.inner));
  row.worst_sigma = errors.worst;
  row.flying = static_cast<double>(errors.flying) / film.sensor.size();
  return row;
}

int compare_codec_states(rt::NonRealtime& nrt, const CodecFilm& film, int frames,
                         std::uint64_t seed) {
  const auto& k = film.sensor.intrinsics;
  const drivers::DepthStreamConfig config{k.width, k.height, kStrict};
  drivers::DepthEncoder encoder(nrt, config);
  drivers::DepthDecoder decoder(nrt, config);
  const auto pixels = pixels_of(k);
  std::vector<std::uint8_t> bytes(drivers::max_depth_frame_bytes(pixels));
  std::vector<std::uint16_t> decoded(pixels);
  auto in = std::make_unique<RgbdFrame>();
  rt::Random random(seed, 73);
  drivers::DepthDemand demand;
  int differ = 0;
  for (int n = 0; n < frames; ++n) {
    if (random.integer(0, 9) == 0) {
      demand.mode = static_cast<DepthMode>(random.integer(0, drivers::kDepthModes - 1));
      demand.step = static_cast<int>(random.integer(-1, drivers::kDepthSteps - 1));
    }
    demand.key = random.integer(0, 29) == 0;
    film.sensor.frame(n % film.sensor.size(), *in);
    drivers::DepthFrameInfo coded, seen;
    const auto encoded = encoder.encode({in->depth_mm.data(), pixels}, demand, bytes, coded);
    const auto status = decoder.decode({bytes.data(), coded.bytes}, decoded, seen);
    const bool equal = encoded == drivers::DepthStatus::kOk &&
                       status == drivers::DepthStatus::kOk &&
                       encoder.state_hash() == decoder.state_hash();
    differ += equal ? 0 : 1;
  }
  return differ;
}

CodecBenchResult bench_codec(std::ostream& progress, CodecBenchOptions o) {
  if (o.long_run) o.damaged = 100000, o.states = 10000;
  rt::Startup startup;
  CodecBenchResult result;
  const OtherLoad others;
  CodecFilm film;
  const CodecBenchCase* filmed = nullptr;
  for (const CodecBenchCase& c : codec_cases()) {
    if (filmed == nullptr || filmed->moving != c.moving || filmed->noise != c.noise) {
      progress << "filming: " << (c.moving ? "moving" : "at rest") << ", " << to_text(c.noise)
               << " noise, " << o.frames << " frames, seed " << o.seed << "\n";
      film = film_codec(startup.token(), {c.moving, c.noise, o.seed, o.frames});
      filmed = &c;
    }
    result.rows.push_back(run_codec_case(startup.token(), c, film));
  }
  progress << o.states << " frames: states; " << o.damaged << " damaged ones of each kind, seed "
           << o.seed << "\n";
  result.states = o.states;
  result.states_differ = compare_codec_states(startup.token(), film, o.states, o.seed);
  result.damage = damage_codecs(startup.token(), film, o.damaged, o.seed);
  result.other_load = others.cores();
  return result;
}

}  // namespace teletact

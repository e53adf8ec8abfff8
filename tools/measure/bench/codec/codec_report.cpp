#include <cstdio>

#include "tools/measure/bench/codec/codec_bench.hpp"

namespace teletact {

namespace {

constexpr double kEncode_ms = 5.5, kDecode_ms = 3.2;  // of depth, one thread
constexpr double kDamage_ms = 50;                     // of one damaged frame

std::string head(const CodecBenchRow& r) { return std::string(r.what->name) + ": "; }

}  // namespace

std::vector<Limit> CodecBenchResult::limits() const {
  Limits all;
  const std::string busy = disturbed(other_load);
  for (const CodecBenchRow& r : rows) {
    if (r.what->mode != drivers::DepthMode::kLossless) {
      all.add(head(r) + "encode, ms", r.encode_ms, "<=", kEncode_ms, busy);
      all.add(head(r) + "decode, ms", r.decode_ms, "<=", kDecode_ms, busy);
    }
    if (r.what->most_mbit_s > 0)
      all.add(head(r) + "depth and colour, Mbit/s", r.mbit_s(), "<=", r.what->most_mbit_s);
    if (r.what->error_below_sensor)
      all.add(head(r) + "error of truth over the camera's own", r.err_over_sensor(), "<", 1);
    all.add(head(r) + "flying pixels a frame", r.flying, "<=", 0);
  }
  for (const CodecDamage& d : damage) {
    all.add("damaged, " + d.name + ": taken unsealed, or a key after it spoilt", d.wrong, "<=", 0);
    all.add("damaged, " + d.name + ": longest, ms", d.worst_ms, "<=", kDamage_ms, busy);
  }
  all.add("frames after which the two ends differ", states_differ, "<=", 0);
  return all.all();
}

std::vector<BenchMetric> CodecBenchResult::metrics() const {
  std::vector<BenchMetric> all;
  for (const CodecBenchRow& r : rows) {
    const std::string name = std::string("codec.") + r.what->name + ".";
    all.push_back({name + "encode_ms", r.encode_ms, "ms"});
    all.push_back({name + "decode_ms", r.decode_ms, "ms"});
    all.push_back({name + "mbit_s", r.mbit_s(), "Mbit/s"});
    all.push_back({name + "err_over_sensor", r.err_over_sensor(), "1"});
    all.push_back({name + "depth_mbit_s", r.depth_mbit_s, "Mbit/s"});
    all.push_back({name + "flying", r.flying, "1"});
    if (!(r.ffv1_encode_ms > 0)) continue;
    all.push_back({name + "encode_over_ffv1", r.encode_ms / r.ffv1_encode_ms, "1"});
    all.push_back({name + "decode_over_ffv1", r.decode_ms / r.ffv1_decode_ms, "1"});
  }
  return all;
}

void CodecBenchResult::print(std::ostream& out) const {
  char line[320];
  std::snprintf(line, sizeof line,
                "%-19s %4s %3s %7s %7s %7s %7s | %7s %7s %7s %7s | %6s %6s %6s %6s %6s\n", "mode",
                "step", "fps", "depth", "colour", "sum", "key kB", "enc ms", "dec ms", "/FFV1",
                "/FFV1", "error", "camera", "ratio", "worst", "flying");
  out << line;
  for (const CodecBenchRow& r : rows) {
    std::snprintf(line, sizeof line,
                  "%-19s %4d %3d %7.2f %7.2f %7.2f %7.1f | %7.2f %7.2f %7.2f %7.2f | %6.3f %6.3f "
                  "%6.3f %6.2f %6.2f\n",
                  r.what->name, r.step, r.what->fps, r.depth_mbit_s, r.colour_mbit_s, r.mbit_s(),
                  r.key_kB, r.encode_ms, r.decode_ms, r.encode_ms / r.ffv1_encode_ms,
                  r.decode_ms / r.ffv1_decode_ms, r.error_sigma, r.sensor_sigma,
                  r.err_over_sensor(), r.worst_sigma, r.flying);
    out << line;
  }
  out << "depth, colour, sum: Mbit/s at fps; times: thread CPU of depth, median, and over FFV1's; "
         "error: RMS off the\ntruth in sigma, of what was decoded and of the camera; worst: "
         "furthest from the camera's reading, in sigma\n";
  if (!rows.empty()) {
    const CodecBenchRow& r = rows.front();
    std::snprintf(
        line, sizeof line, "at rest: FFV1 %.2f Mbit/s, %.2f and %.2f ms; colour %.2f and %.2f ms\n",
        r.ffv1_mbit_s, r.ffv1_encode_ms, r.ffv1_decode_ms, r.colour_encode_ms, r.colour_decode_ms);
    out << line;
  }
  for (const CodecDamage& d : damage) {
    std::snprintf(line, sizeof line,
                  "damaged, %-9s %d: %d refused, %d decoded, %d wrong, longest %.2f ms\n",
                  (d.name + ":").c_str(), d.frames, d.refused, d.decoded, d.wrong, d.worst_ms);
    out << line;
  }
  std::snprintf(line, sizeof line, "states: %d frames, %d after which the two ends differ\n",
                states, states_differ);
  out << line;
  teletact::print(out, limits());
}

}  // namespace teletact

// teletact bench codec: the link's codecs on what a depth camera of 512 x 424 sees of a seeded room
// (codec_film.hpp), one thread.
//
//   rows      mode, camera at rest or moving, noise of the camera and law of the codec
//   times     thread CPU of depth, median of the frames, beside FFV1 (libavcodec) in the same run
//   Mbit/s    mean of all frames behind the first, a key; depth and colour (H.264 where built in)
//   error     RMS of (decoded - truth) / sigma, of the camera's reading the same way, and their
//             ratio; pixels away from depth edges (codec_film.hpp), all frames
//   flying    pixels more than 30 mm and 5 sigma from both the camera's reading and the truth, or
//             with a reading where the camera has none, or the other way round. (A stray reading of
//             the camera that a mean does not follow is not the codec's.)
//   damage    depth frames and pictures with bits, bytes and lengths changed, half of them with
//             their checks made good again: refused, or an image, in bounded time; then a good key
//             must decode as ever
//   state     encoder and decoder hold equal images after every frame, modes, steps and keys drawn
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/codec/codec_film.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct CodecBenchOptions {
  int frames = 60;  // of each film
  std::uint64_t seed = 1;
  int damaged = 3000;     // frames, of each kind
  int states = 300;       // frames
  bool long_run = false;  // 100,000 damaged and 10,000 states
};

struct CodecBenchCase {
  const char* name;  // in metrics: codec.<name>.mbit_s
  drivers::DepthMode mode;
  bool moving;
  drivers::DepthNoiseLaw noise, law;
  int fps;                  // that the rate is stated at
  int colour_kbit_s;        // of H.264
  double most_mbit_s;       // 0: no limit
  bool error_below_sensor;  // limit: err_over_sensor < 1
  int step = -1;            // of depth; -1: the mode's own
  bool depth_only = false;  // neither colour nor FFV1
};
[[nodiscard]] const std::vector<CodecBenchCase>& codec_cases();

struct CodecBenchRow {
  const CodecBenchCase* what = nullptr;
  int step = 0;
  double depth_mbit_s = 0, colour_mbit_s = 0, key_kB = 0;
  double encode_ms = 0, decode_ms = 0, colour_encode_ms = 0, colour_decode_ms = 0;
  double ffv1_encode_ms = 0, ffv1_decode_ms = 0, ffv1_mbit_s = 0;  // NaN: not built in
  double error_sigma = 0, sensor_sigma = 0, worst_sigma = 0;  // worst: from the camera's reading
  double flying = 0;                                          // a frame
  [[nodiscard]] double mbit_s() const { return depth_mbit_s + colour_mbit_s; }
  [[nodiscard]] double err_over_sensor() const { return error_sigma / sensor_sigma; }
};

struct CodecDamage {
  std::string name;
  int frames = 0, refused = 0, decoded = 0;
  int wrong = 0;        // a good key after it did not decode as ever, or an unsealed one was taken
  double worst_ms = 0;  // thread CPU
};

struct CodecBenchResult {
  std::vector<CodecBenchRow> rows;
  std::vector<CodecDamage> damage;
  int states = 0, states_differ = 0;
  double other_load = 0;

  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

[[nodiscard]] CodecBenchResult bench_codec(std::ostream& progress, CodecBenchOptions options);

// One case on its film.
[[nodiscard]] CodecBenchRow run_codec_case(rt::NonRealtime& nrt, const CodecBenchCase& c,
                                           const CodecFilm& film);
[[nodiscard]] std::vector<CodecDamage> damage_codecs(rt::NonRealtime& nrt, const CodecFilm& film,
                                                     int frames, std::uint64_t seed);
// How many of the frames left encoder and decoder with different images.
[[nodiscard]] int compare_codec_states(rt::NonRealtime& nrt, const CodecFilm& film, int frames,
                                       std::uint64_t seed);

}  // namespace teletact

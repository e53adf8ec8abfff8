#include "tools/measure/accuracy/codec/codec_colour.hpp"

#include <array>
#include <cmath>
#include <memory>
#include <span>
#include <stdexcept>
#include <vector>

#include "drivers/codec/colour_stream.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "tools/measure/bench/codec/codec_film.hpp"

namespace teletact {

namespace {

using perception::Rgb;
using perception::RgbdFrame;

constexpr std::array kFinest{0, 12, 16, 18, 20, 22, 24, 26, 30};
// The first pictures of a chain are a key and what makes up for it.
constexpr int kBegin = 20;

double squares(std::span<const Rgb> a, std::span<const Rgb> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (const int d : {a[i].r - b[i].r, a[i].g - b[i].g, a[i].b - b[i].b}) sum += d * d;
  }
  return sum / (3.0 * static_cast<double>(a.size()));
}

// `count` pictures from `first` on; `still`: the first of them, again and again.
StudyRow run_setting(rt::NonRealtime& nrt, const FusionSequence& film, const std::string& data,
                     int first, int count, bool still, int finest) {
  drivers::ColourStreamConfig config;
  const bool is_default = config.finest == finest;
  config.method = "h264", config.finest = finest;
  const int w = film.intrinsics.width, h = film.intrinsics.height;
  const auto encoder = make_colour_encoder(nrt, config, w, h);
  drivers::ColourDecoder decoder(nrt);
  const auto frame = std::make_unique<RgbdFrame>(), back = std::make_unique<RgbdFrame>();
  std::vector<std::uint8_t> bytes(drivers::kMostColourBytes);
  std::vector<double> kB, error, encode_ms;
  for (int i = 0; i < count; ++i) {
    film.frame(first + (still ? 0 : i), *frame);
    const auto pixels = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
    const std::span<const std::uint16_t> depth{frame->depth_mm.data(), pixels};
    const std::int64_t begin = rt::thread_cpu_ns();
    const auto coded = encoder->encode(frame->rgb(), depth, {}, bytes);
    const double ms = 1e-6 * static_cast<double>(rt::thread_cpu_ns() - begin);
    back->intrinsics = frame->intrinsics;
    if (coded.status != drivers::ColourStatus::kOk ||
        decoder.decode({bytes.data(), coded.bytes}, depth, back->rgb()) !=
            drivers::ColourStatus::kOk)
      throw std::runtime_error("accuracy codec --colour: a picture could not be coded");
    if (i < kBegin) continue;
    kB.push_back(1e-3 * static_cast<double>(coded.bytes));
    encode_ms.push_back(ms);
    error.push_back(squares({frame->colour.data(), pixels}, {back->colour.data(), pixels}));
  }
  const std::string setting = finest > 0 ? "finest_" + std::to_string(finest) : "no_limit";
  return {data,
          "finest",
          setting,
          finest > 0 ? "finest " + std::to_string(finest) : "no limit",
          is_default,
          {{"rms_error", std::sqrt(rt::quantile(error, 0.5)), "of 255"},
           {"kB", rt::quantile(kB, 0.5), "kB"},
           {"kB_p95", rt::quantile(kB, 0.95), "kB"},
           {"encode_ms", rt::quantile(encode_ms, 0.5), "ms"}}};
}

}  // namespace

Study study_codec_colour(std::ostream& progress, const CodecColourOptions& o) {
  if (!drivers::h264_built_in())
    throw std::runtime_error("accuracy codec --colour: H.264 is not built in (TELETACT_H264)");
  Study study;
  study.name = "accuracy.codec_colour";
  rt::Startup startup;
  const auto sweep = [&](const FusionSequence& film, const std::string& data, int first, int count,
                         bool still) {
    for (const int finest : kFinest) {
      progress << "\r" << data << ", finest " << finest << "      " << std::flush;
      study.rows.push_back(run_setting(startup.token(), film, data, first, count, still, finest));
    }
    for (const auto& [cost, label] : {std::pair{"kB", "median picture, kB"},
                                      std::pair{"encode_ms", "thread CPU of encoding it, ms"}})
      study.plots.push_back({"accuracy_codec_colour_" + data + "_" + cost, "H.264, " + data, data,
                             "rms_error", "RMS error of colour, of 255", cost, label});
  };
  for (const bool moving : {false, true}) {
    CodecFilmOptions scene;
    scene.moving = moving, scene.seed = o.seed, scene.frames = o.frames;
    const FusionSequence film = film_codec(startup.token(), scene).sensor;
    if (!moving) sweep(film, "still", 0, o.frames, true);
    sweep(film, moving ? "moving" : "rest", 0, o.frames, false);
  }
  if (!o.rgbd.empty()) {
    RecordingOptions options;
    options.frames = o.rgbd_frames;
    options.at_least = 4 * kBegin;
    const FusionSequence film = recorded_sequence(progress, o.rgbd, options);
    const int half = film.size() / 2;
    sweep(film, "recording_still", 0, half, true);
    sweep(film, "recording_first", 0, half, false);
    sweep(film, "recording_second", half, film.size() - half, false);
  }
  progress << "\r                                  \r";
  return study;
}

}  // namespace teletact

#include "tools/measure/accuracy/codec/codec_steps.hpp"

#include <cstdio>

#include "tools/measure/bench/codec/codec_bench.hpp"

namespace teletact {

using drivers::DepthMode;

namespace {

// Of what a mode runs with when nobody asks for a step.
bool is_default(DepthMode mode, int step, drivers::DepthNoiseLaw law) {
  return mode == DepthMode::kLossless || step == drivers::default_depth_step(mode, law);
}

void add_row(rt::NonRealtime& nrt, const CodecFilm& film, const std::string& data, DepthMode mode,
             int step, drivers::DepthNoiseLaw law, Study& study) {
  const CodecBenchCase c{to_text(mode), mode, false, law, law, 30, 0, 0, false, step, true};
  const CodecBenchRow row = run_codec_case(nrt, c, film);
  std::string setting = to_text(mode), label = setting;
  if (mode != DepthMode::kLossless) {
    char text[40];
    std::snprintf(text, sizeof text, " %.1f sigma",
                  drivers::kDepthStepEighths[static_cast<std::size_t>(step)] / 8.0);
    label += text;
    setting += "_step" + std::to_string(step);
  }
  study.rows.push_back({data,
                        to_text(mode),
                        setting,
                        label,
                        is_default(mode, step, law),
                        {{"err_over_sensor", row.err_over_sensor(), "1"},
                         {"furthest_sigma", row.worst_sigma, "1"},
                         {"flying", row.flying, "1"},
                         {"mbit_s", row.depth_mbit_s, "Mbit/s"},
                         {"encode_ms", row.encode_ms, "ms"},
                         {"decode_ms", row.decode_ms, "ms"}}});
}

}  // namespace

Study study_codec_steps(std::ostream& progress, const CodecStepsOptions& o) {
  Study study;
  study.name = "accuracy.codec_steps";
  rt::Startup startup;
  for (const bool moving : {false, true}) {
    const std::string data = std::string(moving ? "moving" : "rest") +
                             (o.noise == drivers::DepthNoiseLaw::kLenient ? "_lenient" : "");
    CodecFilmOptions scene;
    scene.moving = moving;
    scene.seed = o.seed;
    scene.noise = o.noise;
    scene.frames = o.frames;
    scene.lateral_px = 0.3;
    const CodecFilm film = film_codec(startup.token(), scene);
    for (const DepthMode mode :
         {DepthMode::kLossless, DepthMode::kFaithful, DepthMode::kQuiet, DepthMode::kMoving}) {
      const int steps = mode == DepthMode::kLossless ? 1 : drivers::kDepthSteps;
      for (int step = 0; step < steps; ++step) {
        progress << "\r" << data << " " << to_text(mode) << " step " << step << "      "
                 << std::flush;
        add_row(startup.token(), film, data, mode, step, o.noise, study);
      }
    }
    const std::string title =
        moving ? "Depth codec, camera carried" : "Depth codec, camera at rest";
    for (const auto& [cost, label] : {std::pair{"mbit_s", "depth, Mbit/s at 30 frames a second"},
                                      std::pair{"encode_ms", "thread CPU of encoding a frame, ms"}})
      study.plots.push_back({"accuracy_codec_steps_" + data + "_" + cost, title, data,
                             "err_over_sensor", "RMS error over the camera's own", cost, label});
  }
  progress << "\r                                  \r";
  return study;
}

}  // namespace teletact

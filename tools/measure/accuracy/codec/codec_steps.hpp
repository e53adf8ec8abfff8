// teletact accuracy codec --steps: what each quality step of each mode of the depth codec costs:
// error against the truth, Mbit/s and thread CPU, on a camera at rest and a carried one
// (bench/codec/codec_film.hpp). Depth alone.
#pragma once

#include <cstdint>
#include <ostream>

#include "drivers/codec/depth_stream.hpp"
#include "tools/measure/accuracy/study.hpp"

namespace teletact {

struct CodecStepsOptions {
  std::uint64_t seed = 21;  // seed 1 chose the codec's constants
  int frames = 60;
  drivers::DepthNoiseLaw noise = drivers::DepthNoiseLaw::kStrict;  // of camera and codec
};
[[nodiscard]] Study study_codec_steps(std::ostream& progress, const CodecStepsOptions& options);

}  // namespace teletact

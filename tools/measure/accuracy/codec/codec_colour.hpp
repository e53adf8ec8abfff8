// teletact accuracy codec --colour: what the finest quantizer of H.264 costs: bytes a picture and
// thread CPU against the picture's error. One picture that stands still, the same with the noise of
// a sensor, a carried camera, and both halves of a recording where one is given.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>

#include "tools/measure/accuracy/study.hpp"

namespace teletact {

struct CodecColourOptions {
  std::uint64_t seed = 21;  // of the seeded room (bench/codec/codec_film.hpp)
  int frames = 60;          // of each kind
  std::string rgbd;         // empty: none. Its first half chose ColourStreamConfig::finest
  int rgbd_frames = 150;
};
// Throws std::runtime_error without libx264, and for a recording that can not be read.
[[nodiscard]] Study study_codec_colour(std::ostream& progress, const CodecColourOptions& options);

}  // namespace teletact

// What a depth camera sees of a seeded room, with the truth of each pixel: the input of the codec's
// bench and study.
//
//   at rest   the camera stands; a box swings before it like a robot's arm
//   moving    the camera is carried by hand, 0.25 m/s and 15 deg/s at most; the box swings too
//
// Noise along the axis, normal, sigma(z) of z in m: strict is a Kinect v2's (depth_noise.hpp),
// lenient 1.5 + 2 z^2 mm. Drop-out at edges and flying pixels are the synthetic camera's in both;
// lateral jitter (more than sigma on a floor seen at a low angle) where it is asked for. Colour has
// normal noise of 3 of 255. A seed: other furniture and colours, other way, other noise.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

struct CodecFilm {
  FusionSequence sensor;  // with truth_WC
  drivers::WorldConfig world;
  std::vector<std::uint16_t> truth_mm;  // of each pixel of each frame; 0: nothing in range
  // Of each pixel of each frame: away from depth edges, so that the sensor's error is that along
  // its axis alone.
  std::vector<std::uint8_t> inner;
};

struct CodecFilmOptions {
  bool moving = false;
  drivers::DepthNoiseLaw noise = drivers::DepthNoiseLaw::kStrict;
  std::uint64_t seed = 1;
  int frames = 60;
  bool arm = true;  // false: nothing moves but the camera
  double lateral_px = 0;
};

// Standard deviation along the axis, mm.
[[nodiscard]] double noise_mm(drivers::DepthNoiseLaw law, double z_m) noexcept;

// Of each pixel of a true depth image: 0 within two pixels of a step of the inverse depth's second
// difference, or of a pixel without a reading, where jitter and drop-out act; else 1.
void mark_inner(const std::uint16_t* mm, int width, int height, std::uint8_t* inner);

[[nodiscard]] CodecFilm film_codec(rt::NonRealtime& nrt, const CodecFilmOptions& options);

}  // namespace teletact

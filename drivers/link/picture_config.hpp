// How pictures cross the link: which codecs, how fine. Keys of the section [link], for both boxes.
#pragma once

#include <string>

#include "config/schema.hpp"

namespace drivers {

// Section [codec]: the pictures themselves.
struct ColourCodecConfig {
  int quality = 60;  // of JPEG, 1..100
  bool half = true;  // half the width and height: a quarter of the bytes and of the time
  void describe(config::Section& s);
};

struct PictureConfig {
  std::string depth_codec = "lossless";  // lossless, auto, faithful, quiet, moving
  std::string colour_codec = "jpeg";     // jpeg, h264, none
  std::string depth_noise = "strict";    // of the sensor: strict, lenient (depth_stream.hpp)
  int depth_step = -1;                   // index of a quality step; -1: the codec's own
  int colour_rate_kbit_per_s = 1500;     // of h264

  void describe(config::Section& link);
  // A codec that needs its previous frame: capture encodes what is asked for, and the other end
  // reports.
  [[nodiscard]] bool on_demand() const noexcept {
    return depth_codec != "lossless" || colour_codec == "h264";
  }
  // What both ends must have the same, said in the handshake; empty without such a codec.
  [[nodiscard]] std::string dialect() const;
};

}  // namespace drivers

#include "drivers/link/picture_config.hpp"

#include "drivers/codec/depth_stream.hpp"

namespace drivers {

void ColourCodecConfig::describe(config::Section& s) {
  s.integer("quality", quality, 1, 100, "of the JPEG pictures");
  s.flag("half", half, "half the width and height");
}

void PictureConfig::describe(config::Section& link) {
  link.text("depth_codec", depth_codec, {"lossless", "auto", "faithful", "quiet", "moving"},
            "depth on the link; all but lossless code a frame from the one before it; auto: quiet "
            "while the camera rests, moving while it moves");
  link.text("colour_codec", colour_codec, {"jpeg", "h264", "none"},
            "colour on the link; h264 codes a picture from the one before it");
  link.text("depth_noise", depth_noise, {"strict", "lenient"},
            "of the sensor, as the depth codec takes it");
  link.integer("depth_step", depth_step, -1, kDepthSteps - 1,
               "quality of the depth codec, 0 the finest; -1: the codec's own");
  link.integer("colour_rate_kbit_per_s", colour_rate_kbit_per_s, 100, 20000,
               "of h264, at 30 frames a second; a line seen to be slow lowers it");
}

std::string PictureConfig::dialect() const {
  return on_demand() ? "depth " + depth_codec + ", colour " + colour_codec : std::string{};
}

}  // namespace drivers

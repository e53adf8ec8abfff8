// Frames through the link's codecs and back, without a link: what the other box would see, how many
// bytes that took and what CPU. For the commands that measure or show what coding does.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/codec/colour_stream.hpp"
#include "drivers/codec/depth_motion.hpp"
#include "drivers/codec/depth_stream.hpp"
#include "drivers/codec/rate_steps.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

struct CodecChoice {
  drivers::DepthMode mode = drivers::DepthMode::kFaithful;
  bool by_motion = false;  // instead: quiet or moving, frame by frame (depth_motion.hpp)
  drivers::DepthNoiseLaw law = drivers::DepthNoiseLaw::kStrict;
  int step = -1;           // of depth; -1: the mode's own, and with a rate coarser where it must
  double rate_mbit_s = 0;  // of depth and colour; 0: no limit
  double fps = 30;
  bool with_colour = true;
  drivers::ColourStreamConfig colour;
  drivers::ColourDemand colour_demand;
};

struct CodedFrame {
  drivers::DepthFrameInfo depth;
  std::size_t colour_bytes = 0;
  bool colour_key = false;
  // Thread CPU, ms.
  double depth_encode_ms = 0, depth_decode_ms = 0, colour_encode_ms = 0, colour_decode_ms = 0;
  [[nodiscard]] std::size_t bytes() const noexcept { return depth.bytes + colour_bytes; }
};

class CodecChain {
 public:
  // Throws std::exception for sizes that the codecs do not take.
  CodecChain(rt::NonRealtime& nrt, const CodecChoice& choice, int width, int height);
  // `frame` becomes what its decoder makes of it. Throws std::runtime_error when a codec refuses
  // what the other end made, or the two ends hold different states.
  CodedFrame pass(perception::RgbdFrame& frame, bool key = false);

 private:
  void pass_lossless(perception::RgbdFrame& frame, CodedFrame& out);
  void pass_stream(perception::RgbdFrame& frame, bool key, CodedFrame& out);
  void encode_colour(const perception::RgbdFrame& frame, bool key, CodedFrame& out);
  void decode_colour(perception::RgbdFrame& frame, CodedFrame& out);
  CodecChoice choice_;
  drivers::DepthEncoder depth_encoder_;
  drivers::DepthDecoder depth_decoder_;
  drivers::DepthMotion motion_;
  std::unique_ptr<drivers::ColourEncoder> colour_encoder_;
  drivers::ColourDecoder colour_decoder_;
  const int first_step_;
  drivers::RateSteps steps_;
  std::vector<std::uint8_t> depth_out_, colour_out_;
  std::vector<std::uint16_t> depth_in_;
  std::uint32_t seq_ = 0;
};

}  // namespace teletact

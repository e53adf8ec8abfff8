// RgbdFrame <-> EncodedFrame, by the codecs that the scene names. Of the codecs that take each
// frame alone (lossless depth, JPEG): same frame, same bytes. Of the others: same frames and
// demands, same bytes; and whoever decodes needs every frame that was encoded, in order, from a key
// on.
#pragma once

#include <memory>
#include <optional>

#include "drivers/codec/colour_stream.hpp"
#include "drivers/codec/depth_motion.hpp"
#include "drivers/codec/depth_stream.hpp"
#include "drivers/link/encoded_frame.hpp"
#include "drivers/link/frame_demand.hpp"
#include "drivers/link/picture_config.hpp"

namespace drivers {

enum class CodecEnd : std::uint8_t { kEncodes, kDecodes };

// What encoding and decoding need beside the frames; one per thread that does either.
struct FrameCodecScratch {
  // Lossless depth and JPEG.
  FrameCodecScratch(rt::NonRealtime&, const ColourCodecConfig& jpeg);
  // camera: all frames are of its size, where a codec needs its previous frame.
  FrameCodecScratch(rt::NonRealtime&, const ColourCodecConfig& jpeg, const PictureConfig& pictures,
                    const perception::Intrinsics& camera, CodecEnd end);
  // An encoded frame was lost on this side: the next one is a key.
  void restart() noexcept;

  std::optional<DepthEncoder> depth_encoder;
  std::optional<DepthDecoder> depth_decoder;
  std::unique_ptr<ColourEncoder> colour_encoder;
  std::optional<ColourDecoder> colour_decoder;
  DepthMode depth_mode = DepthMode::kLossless;
  std::optional<DepthMotion> depth_motion;  // auto: it names the mode of each frame
  DepthNoiseLaw depth_law = DepthNoiseLaw::kStrict;
  int depth_step = -1;
  bool colour_chained = false;  // a picture needs the one before it
  ColourDemand colour_demand;   // before what a frame's demand changes
  bool with_colour = true;
  bool colour_key_due = false;  // a key was asked for, and no picture was one since
  // decode() found a picture that needs one before it which was not decoded here.
  bool colour_wants_key = false;
};

// kOk; kWithoutColour when colour was asked for and could not be coded; kBadHeader for a frame
// whose intrinsics no image can have, or of another size than the camera's (nothing is encoded
// then).
[[nodiscard]] FrameStatus encode(const perception::RgbdFrame& frame, rt::Box box, bool with_colour,
                                 FrameCodecScratch& scratch, EncodedFrame& out,
                                 const FrameDemand& demand = {}) noexcept;

// `exposure` is the frame's stamp in the reader's clock: only the link can convert it. On any
// status but kOk and kWithoutColour a codec that needs its previous frame may take nothing more
// before a key.
[[nodiscard]] FrameStatus decode(const EncodedFrame& frame, rt::Time exposure,
                                 FrameCodecScratch& scratch, perception::RgbdFrame& out) noexcept;

}  // namespace drivers

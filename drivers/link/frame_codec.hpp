// RgbdFrame <-> EncodedFrame. Same frame, same bytes.
#pragma once

#include "drivers/link/colour_codec.hpp"
#include "drivers/link/encoded_frame.hpp"

namespace drivers {

// What encoding and decoding need beside the frames; one per thread that does either.
struct FrameCodecScratch {
  FrameCodecScratch(rt::NonRealtime& nrt, const ColourCodecConfig& config) : colour(nrt, config) {}
  ColourCodec colour;
};

// kOk; kNoColour when colour was asked for and could not be coded; kBadHeader for a frame whose
// intrinsics no image can have (nothing is written then).
[[nodiscard]] FrameStatus encode(const perception::RgbdFrame& frame, rt::Box box, bool with_colour,
                                 FrameCodecScratch& scratch, EncodedFrame& out) noexcept;

// `exposure` is the frame's stamp in the reader's clock: only the link can convert it.
[[nodiscard]] FrameStatus decode(const EncodedFrame& frame, rt::Time exposure,
                                 FrameCodecScratch& scratch, perception::RgbdFrame& out) noexcept;

}  // namespace drivers

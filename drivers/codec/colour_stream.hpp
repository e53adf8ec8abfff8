// Colour of a frame as bytes, behind one interface: JPEG (libturbojpeg), each picture alone, or
// H.264 with zero latency (libavcodec, libx264), each picture from the one coded before it.
//
//   JPEG    the same picture and demand give the same bytes: no state, exact integer transform.
//   H.264   the bytes depend on every picture and demand since the encoder was made, and on the
//           build of libx264 (its rate control calculates in floating point; it is asked to depend
//           on no instruction set). One build gives the same bytes again for the same pictures and
//           demands, which are therefore to be recorded. Decoding is exact by the standard.
//
// Pixels without colour (perception/geometry/no_colour.hpp) come back exactly: they are named
// beside the picture (colour_mask.hpp), relative to which depth pixels have a reading; so both ends
// must have the same pixels without a reading.
//
// Wire form, little-endian:
//   u8 'C', u8 method, u8 flags (1 key, 2 half), u8 step, u16 width, u16 height, u32 mask size,
//   u32 payload size, u64 check (rt::Hash64 over all the rest), mask, payload
// step: pictures since the last key, modulo 256; so a decoder sees that it misses one. width and
// height are of the frame; half: the payload has half of them, rounded up.
//
// Libraries allocate: for firm tasks and ordinary threads, not for hard ones. Nothing is thrown by
// encode() and decode(). libav has no threads of its own here. Sources: ITU-T T.81 and H.264;
// BT.601, full range.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "config/schema.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

enum class ColourMethod : std::uint8_t { kJpeg = 1, kH264 = 2 };

// What the road asks of one picture. A recorded input: with it and the picture the bytes follow.
struct ColourDemand {
  int quality = 60;        // of JPEG, 1..100
  int rate_kbit_s = 1500;  // of H.264, 100..20000, at the encoder's frame rate: a frame's share of
                           // it is rate / frame rate, however many frames are sent
  bool key = false;        // of H.264: a picture that needs none before it
  friend bool operator==(const ColourDemand&, const ColourDemand&) = default;
};

// Section [codec.colour].
struct ColourStreamConfig {
  std::string method = "jpeg";  // jpeg, h264
  bool half = false;            // half the width and height, grown again by the decoder
  int fps = 30;                 // of H.264: frames a second that the rate is spread over
  // Of H.264: the least quantizer, 0 to 51. Without it a picture at rest takes its whole share of
  // the rate to become finer than anyone sees, and depth behind it comes later. Chosen on the first
  // half of a recording, where it has the least error (`teletact accuracy codec --colour`).
  int finest = 24;
  void describe(config::Section& s);
};

enum class ColourStatus : std::uint8_t {
  kOk,
  kBadSize,   // the image is empty, too large, or not of the coded picture's size
  kNoRoom,    // the result does not fit; the encoder makes its next picture a key
  kFailed,    // the library refused; the encoder makes its next picture a key
  kDamaged,   // the bytes are no picture of ours, or do not decode
  kNeedsKey,  // a picture is missing before this one: ask for a key
};
[[nodiscard]] const char* to_text(ColourStatus s) noexcept;

inline constexpr std::size_t kColourHeader = 24;
// Most bytes of a picture; what is longer is refused before anything is done with it.
inline constexpr std::size_t kMostColourBytes = std::size_t{256} * 1024;

class ColourEncoder {
 public:
  struct Coded {
    ColourStatus status = ColourStatus::kFailed;
    std::size_t bytes = 0;  // written
    bool key = false;       // decodes without an earlier one
  };
  virtual ~ColourEncoder() = default;
  // depth_mm: of the image's size, or empty: readings everywhere; decode() is to be given readings
  // at the same pixels. Values of the demand are brought into their ranges. After kOk the bytes
  // must reach the decoder, or the next demand must ask for a key.
  [[nodiscard]] virtual Coded encode(perception::ImageView<const perception::Rgb> image,
                                     std::span<const std::uint16_t> depth_mm,
                                     const ColourDemand& demand,
                                     std::span<std::uint8_t> out) noexcept = 0;
};

// Throws std::runtime_error when the library can not be set up, or H.264 was not built in.
// width and height: of all images; H.264 codes one size only, JPEG any up to it.
[[nodiscard]] std::unique_ptr<ColourEncoder> make_colour_encoder(rt::NonRealtime&,
                                                                 const ColourStreamConfig& config,
                                                                 int width, int height);
// H.264 was built in (CMake TELETACT_H264; Debian's libavcodec and libx264 are under the GPL).
[[nodiscard]] bool h264_built_in() noexcept;

// Takes pictures of either method, or of JPEG alone (the other's library is not set up then, its
// pictures are kFailed). After kDamaged and kNeedsKey pictures that are no keys are refused until a
// key comes. On any status but kOk the image's content is unspecified.
class ColourDecoder {
 public:
  explicit ColourDecoder(rt::NonRealtime&, bool with_h264 = true);
  ~ColourDecoder();
  ColourDecoder(const ColourDecoder&) = delete;
  ColourDecoder& operator=(const ColourDecoder&) = delete;
  [[nodiscard]] ColourStatus decode(std::span<const std::uint8_t> in,
                                    std::span<const std::uint16_t> depth_mm,
                                    perception::ImageView<perception::Rgb> image) noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Makes the check of a picture's bytes good, so that damage gets past it: for fuzzing alone.
void seal_colour(std::span<std::uint8_t> picture) noexcept;

}  // namespace drivers

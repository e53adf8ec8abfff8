// Depth images as a stream of small frames: an encoder on the robot's side, a decoder on the
// operator's. docs/codec.md.
//
// A depth is coded on a lattice whose points lie one eighth of the sensor's noise sigma(z) apart
// (depth_lattice.hpp), with a step that is a quality of the frame. What a mode promises of every
// pixel, where x is the camera's reading and y the decoded one:
//
//   lossless   y = x
//   faithful   |y - x| <= depth_error_bound(faithful, step); y stays as it was while that holds
//   quiet      camera at rest: y follows the mean of what the camera saw, and the sum of y over the
//              frames follows the sum of x; |y - x| <= depth_error_bound(quiet, step)
//   moving     no memory in time: |y - x| <= depth_error_bound(moving, step)
//
// A pixel without a reading (0) has none decoded, and the other way round, in every mode. No y lies
// between two surfaces where x lies on one of them: that is what the bounds say.
//
// A delta frame needs the decoder to have decoded the frame before it: a frame that was encoded
// must not be lost. Who loses one, or whose decoder says needs_key(), asks for a key
// (DepthDemand::key); a key needs nothing.
//
// Integer arithmetic only: the same images and demands give the same bytes on every machine, at any
// number of threads. After construction nothing here allocates, locks, waits or throws.
//
// Image: row-major, width x height, millimetres along the optical axis of C, 0 = no reading.
// Source: noise-matched quantisation after C. V. Nguyen et al. (3DIMPVT 2012) for sigma(z); rANS
// after J. Duda (2013); block prediction, gates and the sum-keeping refinement are own work.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace drivers {

enum class DepthMode : std::uint8_t { kLossless, kFaithful, kQuiet, kMoving };
inline constexpr int kDepthModes = 4;
[[nodiscard]] const char* to_text(DepthMode m) noexcept;

// Noise of the sensor along its axis, z in m, sigma in mm.
enum class DepthNoiseLaw : std::uint8_t {
  kStrict,   // max(1.2, 1.5 - 0.5 z + 0.3 z^2): Kinect v2, as drivers/camera/depth_noise.hpp
  kLenient,  // 1.5 + 2 z^2
};
[[nodiscard]] const char* to_text(DepthNoiseLaw l) noexcept;

// Quality steps, finest first: distance between two coded depths in eighths of sigma. A road that
// has too little room asks for the next one; one that has room to spare, for the one before.
inline constexpr std::array<int, 8> kDepthStepEighths{4, 6, 8, 12, 16, 20, 24, 32};
inline constexpr int kDepthSteps = static_cast<int>(kDepthStepEighths.size());
// The step a mode takes when it is not told (an index into kDepthStepEighths; lossless has none:
// 0).
[[nodiscard]] int default_depth_step(DepthMode m, DepthNoiseLaw law) noexcept;
// Most that |y - x| can be, in eighths of sigma at x; 0: lossless. `step` in [0, kDepthSteps).
// Quiet is bound by kQuietBoundMm or five sigma besides, whichever is more.
inline constexpr int kQuietBoundMm = 30;
[[nodiscard]] int depth_error_bound_eighths(DepthMode m, int step) noexcept;
// The same in mm for a reading of depth_mm, rounding to millimetres included.
[[nodiscard]] int depth_error_bound_mm(DepthNoiseLaw law, DepthMode m, int step,
                                       std::uint16_t depth_mm) noexcept;

struct DepthStreamConfig {
  int width = 512, height = 424;  // of every image, px: [1, 640] x [1, 480]
  DepthNoiseLaw law = DepthNoiseLaw::kStrict;
};

// What is asked of one frame.
struct DepthDemand {
  DepthMode mode = DepthMode::kFaithful;
  int step = -1;  // index into kDepthStepEighths; outside it: default_depth_step()
  bool key =
      false;  // true: needs no frame before it. The first frame and one after a change from or
              // to lossless are keys unasked
};

enum class DepthFrameKind : std::uint8_t {
  kKey,     // stands alone
  kDelta,   // what changed
  kRefine,  // nothing changed but by refinement: what is at rest moves towards its mean
};
[[nodiscard]] const char* to_text(DepthFrameKind k) noexcept;

enum class DepthStatus : std::uint8_t {
  kOk,
  kNoRoom,     // the destination is shorter than what can be needed; nothing was done
  kTruncated,  // not as many bytes as the header says
  kBadHeader,  // no frame of ours, or a field outside its range
  kBadSize,    // an image of another size than the decoder's
  kBadCheck,   // bytes changed on the way
  kNeedsKey,   // a delta on a frame that this decoder has not decoded
  kBadData,    // the check fits, the content can not be: no encoder of ours wrote it
};
[[nodiscard]] const char* to_text(DepthStatus s) noexcept;

// What a frame is: from encode(), and from its header by decode().
struct DepthFrameInfo {
  DepthFrameKind kind = DepthFrameKind::kKey;
  DepthMode mode = DepthMode::kLossless;
  int step = 0;                       // index into kDepthStepEighths
  std::uint32_t seq = 0;              // frames encoded before this one
  std::uint32_t bytes = 0;            // of the whole frame
  std::uint32_t blocks = 0;           // 8 x 8 pixels, of the image
  std::uint32_t coded_blocks = 0;     // of them not a copy of the frame before (encode() only)
  std::uint32_t restless_pixels = 0;  // jumped beyond the gate or changed validity (encode() only)
};

inline constexpr std::size_t kDepthFrameHeader = 32;
// No frame of an image of so many pixels is longer, whatever is in it.
[[nodiscard]] constexpr std::size_t max_depth_frame_bytes(std::size_t pixels) noexcept {
  return kDepthFrameHeader + 2 * pixels + 64;
}

class DepthEncoder {
 public:
  // Throws std::invalid_argument for a size outside the range. Allocates all it will ever need.
  DepthEncoder(rt::NonRealtime&, const DepthStreamConfig& config);
  ~DepthEncoder();
  DepthEncoder(DepthEncoder&&) noexcept;
  DepthEncoder& operator=(DepthEncoder&&) noexcept;

  // Codes `depth_mm` (width x height values) into the front of `out`; info.bytes of it are the
  // frame. kNoRoom when `out` is shorter than max_depth_frame_bytes(), or depth_mm is not one
  // image: then the stream is as before. Two stripes of the image are coded by two of the threads
  // of `team`; the bytes do not depend on it.
  [[nodiscard]] DepthStatus encode(std::span<const std::uint16_t> depth_mm,
                                   const DepthDemand& demand, std::span<std::uint8_t> out,
                                   DepthFrameInfo& info,
                                   rt::ForkJoin& team = rt::serial()) noexcept;
  // The next frame will be a key.
  void restart() noexcept;
  // Of what the decoder holds after the last frame: equal on both sides. Not cheap: reads the
  // image.
  [[nodiscard]] std::uint64_t state_hash() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

class DepthDecoder {
 public:
  // Frames of other sizes are refused; `law` comes with the frame. Throws as DepthEncoder does.
  DepthDecoder(rt::NonRealtime&, const DepthStreamConfig& config);
  ~DepthDecoder();
  DepthDecoder(DepthDecoder&&) noexcept;
  DepthDecoder& operator=(DepthDecoder&&) noexcept;

  // `frame` is exactly one frame. Writes `depth_mm` (width x height values) only when kOk; reads
  // and writes nothing outside the two. After kNoRoom, kTruncated, kBadHeader, kBadSize, kBadCheck
  // and kNeedsKey the state is as before; after kBadData only a key is taken.
  [[nodiscard]] DepthStatus decode(std::span<const std::uint8_t> frame,
                                   std::span<std::uint16_t> depth_mm, DepthFrameInfo& info,
                                   rt::ForkJoin& team = rt::serial()) noexcept;
  // No delta can be decoded: at the beginning, and after kBadData.
  [[nodiscard]] bool needs_key() const noexcept;
  [[nodiscard]] std::uint64_t state_hash() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace drivers

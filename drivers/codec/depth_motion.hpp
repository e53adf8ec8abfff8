// Whether the camera moves, told from its depth alone: which mode a frame takes where the scene
// asks for `auto`. Quiet is made for rest: in motion it costs twice the bytes of moving and errs
// twice as far (docs/measured/codec.md); moving at rest shows the sensor's noise.
//
// Of each frame one pixel in 8 x 8 is kept. A frame moves when more than kMoves of those that have
// a reading now and some frames ago lie further apart than the noise: what stands before the camera
// and swings is less. It rests when fewer than kRests have, for as many frames in a row.
//
// Integers only: same images, same modes. Noexcept, no allocation after construction.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/codec/depth_stream.hpp"

namespace drivers {

class DepthMotion {
 public:
  DepthMotion(rt::NonRealtime&, const DepthStreamConfig& config);
  // kQuiet or kMoving. Once for each frame that is encoded, in order; depth_mm has the size that
  // was configured (another one: the last answer again).
  DepthMode judge(std::span<const std::uint16_t> depth_mm) noexcept;
  // Of the last frame, in thousandths of the pixels that were compared.
  [[nodiscard]] int moved_permille() const noexcept { return moved_permille_; }

  static constexpr int kBack = 8;  // frames
  // At rest 2 to 99 permille, carried 313 to 992.
  // chosen on: teletact bench codec seeds 21, 24, 25; judged on: seeds 22, 23
  static constexpr int kMoves_permille = 200, kRests_permille = 130;
  static constexpr int kGate_sigma = 5;

 private:
  static constexpr int kStride = 8;
  DepthStreamConfig config_;
  std::size_t kept_;                 // pixels of a frame
  std::vector<std::uint16_t> past_;  // kBack frames, a ring
  int frames_ = 0, next_ = 0, still_ = 0, moved_permille_ = 0;
  DepthMode mode_ = DepthMode::kQuiet;
};

}  // namespace drivers

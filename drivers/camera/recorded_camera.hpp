// Plays a recorded sequence at its own time stamps. The whole recording is decoded in the
// constructor (about 1.5 MB a frame with colour), so poll() only copies. After the last frame that
// frame is delivered again with new exposure times for hold_s, then kEnd. It never loops.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "drivers/camera/camera.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers {

class RecordedCamera : public Camera {
 public:
  using Progress = std::function<void(int done, int of)>;
  static constexpr std::size_t kMaxBytes = std::size_t{4} << 30U;  // of decoded images

  // Frame 0 is available at `start`. Throws std::runtime_error with the reader's message, or when
  // the recording would take more than kMaxBytes.
  RecordedCamera(rt::NonRealtime&, const TumSequence& sequence, rt::Time start, double hold_s,
                 const Progress& progress = {});

  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return intrinsics_; }
  [[nodiscard]] double rate_hz() const noexcept override { return rate_hz_; }
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override;

  [[nodiscard]] int recorded() const noexcept { return static_cast<int>(offsets_.size()); }
  [[nodiscard]] rt::Nanos length() const noexcept;  // of the recording and the held part

 private:
  void deliver(std::size_t i, std::uint64_t seq, rt::Time exposure,
               perception::RgbdFrame& out) const noexcept;

  perception::Intrinsics intrinsics_;
  double rate_hz_ = 30;
  bool has_colour_ = false;
  rt::Time start_;
  rt::Nanos hold_;
  std::vector<rt::Nanos> offsets_;       // of frame i after frame 0
  std::vector<std::uint16_t> depth_mm_;  // all frames, one after the other
  std::vector<perception::Rgb> colour_;
  std::int64_t next_ = 0;  // first frame number not handed out and not passed over
};

}  // namespace drivers

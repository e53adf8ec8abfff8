#include "drivers/camera/recorded_camera.hpp"

#include <algorithm>
#include <memory>
#include <stdexcept>

namespace drivers {

using perception::RgbdFrame;

namespace {
constexpr rt::Rate kHeldRate{30, 1};
}

RecordedCamera::RecordedCamera(rt::NonRealtime&, const TumSequence& sequence, rt::Time start,
                               double hold_s, const Progress& progress)
    : intrinsics_(sequence.intrinsics()), start_(start), hold_(rt::nanos_from_seconds(hold_s)) {
  const auto n = static_cast<std::size_t>(sequence.size());
  const std::size_t pixels =
      static_cast<std::size_t>(intrinsics_.width) * static_cast<std::size_t>(intrinsics_.height);
  auto frame = std::make_unique<RgbdFrame>();
  for (std::size_t i = 0; i < n; ++i) {
    const auto ok = sequence.read(static_cast<int>(i), *frame);
    if (!ok) throw std::runtime_error(ok.error());
    if (i == 0) {
      has_colour_ = frame->has_colour;
      const std::size_t bytes = n * pixels * (has_colour_ ? 5 : 2);
      if (bytes > kMaxBytes) {
        throw std::runtime_error("replay: " + std::to_string(n) + " frames would take " +
                                 std::to_string(bytes >> 20U) + " MiB, allowed are " +
                                 std::to_string(kMaxBytes >> 20U));
      }
      depth_mm_.resize(n * pixels);
      if (has_colour_) colour_.resize(n * pixels);
    }
    offsets_.push_back(
        rt::nanos_from_seconds(sequence.stamp_s(static_cast<int>(i)) - sequence.stamp_s(0)));
    std::copy_n(frame->depth_mm.data(), pixels, depth_mm_.data() + i * pixels);
    if (has_colour_) std::copy_n(frame->colour.data(), pixels, colour_.data() + i * pixels);
    if (progress) progress(static_cast<int>(i) + 1, static_cast<int>(n));
  }
  if (n > 1) rate_hz_ = static_cast<double>(n - 1) / rt::seconds(offsets_.back());
}

rt::Nanos RecordedCamera::length() const noexcept { return offsets_.back() + hold_; }

void RecordedCamera::deliver(std::size_t i, std::uint64_t seq, rt::Time exposure,
                             RgbdFrame& out) const noexcept {
  const std::size_t pixels =
      static_cast<std::size_t>(intrinsics_.width) * static_cast<std::size_t>(intrinsics_.height);
  out.exposure = exposure;
  out.seq = seq;
  out.intrinsics = intrinsics_;
  out.has_colour = has_colour_;
  out.joints = {};
  std::copy_n(depth_mm_.data() + i * pixels, pixels, out.depth_mm.data());
  if (has_colour_) std::copy_n(colour_.data() + i * pixels, pixels, out.colour.data());
}

CameraStatus RecordedCamera::poll(rt::Time now, RgbdFrame& out) noexcept {
  const rt::Nanos t = now - start_;
  const std::size_t last = offsets_.size() - 1;
  if (t < offsets_[last]) {
    // Newest recorded frame at t.
    const auto after = std::upper_bound(offsets_.begin(), offsets_.end(), t);
    const std::int64_t i = after - offsets_.begin() - 1;
    if (i < next_) return CameraStatus::kNoFrame;
    deliver(static_cast<std::size_t>(i), static_cast<std::uint64_t>(i),
            start_ + offsets_[static_cast<std::size_t>(i)], out);
    next_ = i + 1;
    return CameraStatus::kFrame;
  }
  // Number of the repetition of the last frame, 0 being the frame itself.
  auto r = static_cast<std::uint64_t>((std::min(t - offsets_[last], hold_)).count() *
                                      kHeldRate.num / 1000000000);
  while (kHeldRate.release(r + 1) <= std::min(t - offsets_[last], hold_)) ++r;
  while (r > 0 && kHeldRate.release(r) > t - offsets_[last]) --r;
  const std::int64_t number = static_cast<std::int64_t>(last + r);
  if (number >= next_) {
    deliver(last, static_cast<std::uint64_t>(number),
            start_ + offsets_[last] + kHeldRate.release(r), out);
    next_ = number + 1;
    return CameraStatus::kFrame;
  }
  return t > length() ? CameraStatus::kEnd : CameraStatus::kNoFrame;
}

}  // namespace drivers

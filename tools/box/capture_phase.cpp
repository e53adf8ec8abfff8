#include "tools/box/capture_phase.hpp"

#include <algorithm>
#include <vector>

namespace teletact {

void CapturePhase::arrived(rt::Time at) {
  if (frames_.size() == kFrames) frames_.pop_front();
  frames_.push_back(at);
  ++fresh_;
}

rt::Nanos CapturePhase::after_release(rt::Time at) const {
  // Releases of a rate repeat after `den` seconds: nothing is rounded over days.
  const rt::Nanos again = std::chrono::seconds{rate_.den};
  rt::Nanos since = (at - first_) % again;
  if (since < rt::Nanos{0}) since += again;
  auto k = static_cast<std::uint64_t>(since.count() / rate_.period().count());
  while (rate_.release(k + 1) <= since) ++k;  // a period is rounded up
  return since - rate_.release(k);
}

rt::Nanos CapturePhase::look() {
  if (fresh_ < kFirst) return rt::Nanos{0};
  fresh_ = 0;
  const rt::Nanos period = rate_.period();
  std::vector<rt::Nanos> after;
  for (const rt::Time at : frames_) after.push_back(after_release(at));
  std::sort(after.begin(), after.end());
  // On the circle of the period: what is free of frames before frame i.
  const std::size_t n = after.size();
  const auto quiet = [&](std::size_t i) {
    return i == 0 ? after.front() + period - after.back() : after[i] - after[i - 1];
  };
  // By how much later capture would be released soon after the frames that begin with frame i.
  const auto later_by = [&](std::size_t i) {
    return (after[(i + n - 1 - n / kOneLateOf) % n] + kSpare) % period;
  };
  std::size_t begin = 0;
  for (std::size_t i = 1; i < n; ++i) {
    if (quiet(i) > quiet(begin)) begin = i;
  }
  if (quiet(begin) < period / kQuietPart) return rt::Nanos{0};
  for (std::size_t i = 0; i < n; ++i) {
    const bool alike = quiet(i) + period / kAlikePart >= quiet(begin);
    const rt::Nanos later = later_by(i);
    if (alike && (later <= kLater || period - later <= kEarlier)) return rt::Nanos{0};
  }
  const rt::Nanos later = later_by(begin);
  first_ += later;
  return later;
}

}  // namespace teletact

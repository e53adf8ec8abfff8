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
  // On the circle of the period the frames begin behind the widest part in which none comes.
  std::size_t begin = 0;
  rt::Nanos widest = after.front() + period - after.back();
  for (std::size_t i = 1; i < after.size(); ++i) {
    if (after[i] - after[i - 1] <= widest) continue;
    widest = after[i] - after[i - 1];
    begin = i;
  }
  if (widest < period / kQuietPart) return rt::Nanos{0};
  std::rotate(after.begin(), after.begin() + static_cast<std::ptrdiff_t>(begin), after.end());
  const rt::Nanos last = after[after.size() - 1 - after.size() / kOneLateOf];
  const rt::Nanos later = (last + kSpare) % period;
  if (later <= kLater || period - later <= kEarlier) return rt::Nanos{0};
  first_ += later;
  return later;
}

}  // namespace teletact

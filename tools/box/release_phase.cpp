#include "tools/box/release_phase.hpp"

#include <algorithm>
#include <utility>

namespace teletact {

void ReleasePhase::arrived(rt::Time at) {
  if (!newest_.empty() && at - newest_.back() > kAnew * rate_.period()) {
    newest_.clear();
    fresh_ = 0;
    patience_ = kFirst;
    lasting_ = 0;
    was_earlier_ = false;
  }
  if (newest_.size() == kArrivals) newest_.pop_front();
  newest_.push_back(at);
  ++fresh_;
}

rt::Nanos ReleasePhase::after_release(rt::Time at) const {
  // Releases of a rate repeat after `den` seconds: nothing is rounded over days.
  const rt::Nanos again = std::chrono::seconds{rate_.den};
  rt::Nanos since = (at - first_) % again;
  if (since < rt::Nanos{0}) since += again;
  auto k = static_cast<std::uint64_t>(since.count() / rate_.period().count());
  while (rate_.release(k + 1) <= since) ++k;  // a period is rounded up
  return since - rate_.release(k);
}

std::vector<ReleasePhase::Arrival> ReleasePhase::on_the_grid() const {
  std::vector<Arrival> out;
  const rt::Nanos period = rate_.period();
  const rt::Time from = newest_.front() - after_release(newest_.front());
  for (const rt::Time at : newest_) {
    const rt::Nanos after = after_release(at);
    // Whole periods but for a nanosecond each.
    out.push_back({(at - after - from + period / 2) / period, after});
  }
  return out;
}

rt::Nanos ReleasePhase::cost(const std::vector<Arrival>& arrivals, rt::Nanos later) const {
  const rt::Nanos period = rate_.period();
  rt::Nanos sum{0};
  std::int64_t before = -1;  // the release that takes the arrival before
  for (const Arrival& a : arrivals) {
    const bool next = a.after > later;
    const std::int64_t taken = a.release + (next ? 1 : 0);
    sum += later - a.after + (next ? period : rt::Nanos{0});
    if (taken == before) sum += kLost * period;
    before = taken;
  }
  return sum;
}

ReleasePhase::Best ReleasePhase::best_of(const std::vector<Arrival>& arrivals) const {
  const rt::Nanos now = cost(arrivals, rt::Nanos{0});
  rt::Nanos best = now, aim{0};
  for (const Arrival& a : arrivals) {
    const rt::Nanos costs = cost(arrivals, a.after);
    if (costs < best) best = costs, aim = a.after;
  }
  const auto n = static_cast<std::int64_t>(arrivals.size());
  return {(aim + kSpare) % rate_.period(), (now - best) / n - kSpare};
}

bool ReleasePhase::worth(const Best& best, std::size_t fresh) noexcept {
  const rt::Nanos earlier = rate_.period() - best.later;
  const bool small = best.gain > kSmallGain && earlier >= kSmallGain;
  lasting_ = small ? lasting_ + fresh : 0;
  return lasting_ >= kLasting || (best.gain > kGain && earlier >= kEarlier);
}

bool ReleasePhase::too_soon(rt::Nanos later) noexcept {
  const bool earlier = later > rate_.period() / 2;
  if (earlier && moved_ago_ < patience_) return true;
  if (was_earlier_) {
    const bool stayed = earlier || moved_ago_ > kTried;
    patience_ = stayed ? std::max(patience_ / kMorePatience, kFirst)
                       : std::min(patience_ * kMorePatience, kLatest);
  }
  was_earlier_ = earlier;
  moved_ago_ = 0;
  return false;
}

rt::Nanos ReleasePhase::look() {
  if (fresh_ < kFirst) return rt::Nanos{0};
  const std::size_t fresh = std::exchange(fresh_, 0);
  moved_ago_ += fresh;
  const Best best = best_of(on_the_grid());
  if (!worth(best, fresh) || too_soon(best.later)) return rt::Nanos{0};
  lasting_ = 0;
  first_ += best.later;
  return best.later;
}

}  // namespace teletact

#include "drivers/emulator/line_schedule.hpp"

#include <algorithm>
#include <cmath>

#include "rt/random.hpp"

namespace drivers {

namespace {
constexpr std::uint64_t kFlapStream = 0x464C4150;  // of the seed; ways have 0 and 1
}  // namespace

LineSchedule::LineSchedule(const NetworkConfig& c, std::int64_t epoch_ns) : seed_(c.seed) {
  const auto at = [&](double s) { return epoch_ns + static_cast<std::int64_t>(s * 1e9); };
  rates_.push_back({std::numeric_limits<std::int64_t>::min(), c.rate_Mbit_per_s * 1e-3});
  for (const auto& r : c.rate_changes) rates_.push_back({at(r.at_s), r.rate_Mbit_per_s * 1e-3});
  for (const auto& s : c.stalls) {
    stalls_.push_back({at(s.at_s), static_cast<std::int64_t>(s.for_ms * 1e6),
                       static_cast<std::int64_t>(s.every_s * 1e9)});
  }
  if (c.flaps_per_minute > 0) {
    flap_from_ = at(c.flap_from_s);
    flap_period_ = static_cast<std::int64_t>(60e9 / c.flaps_per_minute);
    flap_length_ = static_cast<std::int64_t>(c.flap_down_ms * 1e6);
  }
}

double LineSchedule::rate_at(std::int64_t t_ns) const noexcept {
  double rate = 0;
  for (const Rate& r : rates_) {
    if (r.from > t_ns) break;
    rate = r.bit_per_ns;
  }
  return rate;
}

std::int64_t LineSchedule::stalled_until(std::int64_t t_ns) const noexcept {
  // One stall may begin before another has ended; what repeats leaves a tenth of the time free.
  for (bool moved = true; moved;) {
    moved = false;
    for (const Stall& s : stalls_) {
      if (t_ns < s.first) continue;
      const std::int64_t into = s.every > 0 ? (t_ns - s.first) % s.every : t_ns - s.first;
      if (into >= s.length) continue;
      t_ns += s.length - into;
      moved = true;
    }
  }
  return t_ns;
}

// Of the rate, or the begin of a stall: after t, which is in none.
std::int64_t LineSchedule::next_change(std::int64_t t_ns) const noexcept {
  std::int64_t next = kNever;
  for (const Rate& r : rates_) {
    if (r.from > t_ns) next = std::min(next, r.from);
  }
  for (const Stall& s : stalls_) {
    if (s.first > t_ns)
      next = std::min(next, s.first);
    else if (s.every > 0)
      next = std::min(next, t_ns + s.every - (t_ns - s.first) % s.every);
  }
  return next;
}

std::int64_t LineSchedule::carried_at(std::int64_t start_ns, std::size_t bytes) const noexcept {
  double bits = 8.0 * static_cast<double>(bytes);
  std::int64_t t = stalled_until(start_ns);
  for (;;) {
    const double rate = rate_at(t);
    if (rate <= 0) return t;
    const std::int64_t change = next_change(t);
    const double needs_ns = std::ceil(bits / rate);
    if (change == kNever || needs_ns <= static_cast<double>(change - t))
      return t + static_cast<std::int64_t>(needs_ns);
    bits = std::max(0.0, bits - rate * static_cast<double>(change - t));
    t = stalled_until(change);
  }
}

std::int64_t LineSchedule::flap_begin(std::int64_t k) const noexcept {
  const double u =
      rt::Random(rt::mix64(seed_, kFlapStream), static_cast<std::uint64_t>(k)).uniform();
  return flap_from_ + k * flap_period_ +
         static_cast<std::int64_t>(0.5 * u * static_cast<double>(flap_period_));
}

LineSchedule::Flap LineSchedule::flap_at(std::int64_t t_ns) const noexcept {
  Flap out;
  if (flap_period_ == 0) return out;
  if (t_ns < flap_from_) {
    out.next_begin_ns = flap_begin(0);
    return out;
  }
  const std::int64_t k = (t_ns - flap_from_) / flap_period_;
  const std::int64_t begin = flap_begin(k);
  const bool begun = begin <= t_ns;
  out.count = static_cast<std::uint64_t>(begun ? k + 1 : k);
  out.next_begin_ns = begun ? flap_begin(k + 1) : begin;
  // At 0.4 of the time between two, a flap ends within its own part of the minute.
  out.down = begun && t_ns < begin + flap_length_;
  return out;
}

}  // namespace drivers

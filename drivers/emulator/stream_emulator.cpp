#include "drivers/emulator/stream_emulator.hpp"

#include <algorithm>
#include <cmath>

namespace drivers {

namespace {
constexpr std::size_t kPiece = 1448;  // what a TCP segment carries on Ethernet

std::uint64_t stream_of(Way way, std::uint64_t what) {
  return 2 * what + (way == Way::kToRobot ? 0 : 1);
}
}  // namespace

StreamEmulator::StreamEmulator(const NetworkConfig& c, Way way, std::int64_t epoch_ns)
    : config_(c),
      line_(c, epoch_ns),
      jitter_(c.seed, stream_of(way, 0)),
      damage_(c.seed, stream_of(way, 1)),
      damage_from_ns_(epoch_ns + static_cast<std::int64_t>(c.corrupt_from_s * 1e9)) {
  for (const CutConfig& cut : c.cuts) {
    if (cut.of(way))
      cut_at_ns_ = std::min(cut_at_ns_, epoch_ns + static_cast<std::int64_t>(cut.at_s * 1e9));
  }
}

void StreamEmulator::leave_queue(std::int64_t now_ns) {
  while (!queue_.empty() && queue_.front().carried <= now_ns) {
    waiting_ -= queue_.front().bytes;
    queue_.pop_front();
  }
}

bool StreamEmulator::dead(std::int64_t now_ns) const noexcept {
  const LineSchedule::Flap flap = line_.flap_at(now_ns);
  return now_ns >= cut_at_ns_ || flap.down || flap.count != renewed_after_;
}

std::size_t StreamEmulator::write(std::int64_t now_ns, std::span<const std::uint8_t> bytes) {
  leave_queue(now_ns);
  if (dead(now_ns)) {
    stats_.bytes_taken += bytes.size();
    stats_.bytes_lost += bytes.size();
    return bytes.size();
  }
  const bool waits = line_.rate_at(now_ns) > 0 || line_.stalled_until(now_ns) > now_ns;
  const auto most = waits ? static_cast<std::size_t>(config_.queue_kB * 1000) : bytes.size();
  const std::size_t taken = std::min(bytes.size(), most - std::min(most, waiting_));
  if (taken == 0) return 0;
  const std::int64_t end_ns = std::min(cut_at_ns_, line_.flap_at(now_ns).next_begin_ns);
  const std::int64_t way_ns =
      static_cast<std::int64_t>(config_.delay_ms * 1e6) +
      (config_.jitter_ms > 0
           ? static_cast<std::int64_t>(jitter_.uniform() * config_.jitter_ms * 1e6)
           : 0);
  for (std::size_t at = 0; at < taken; at += kPiece) {
    const auto piece = bytes.subspan(at, std::min(kPiece, taken - at));
    carried_until_ns_ = line_.carried_at(std::max(now_ns, carried_until_ns_), piece.size());
    last_due_ns_ = std::max(last_due_ns_, carried_until_ns_ + way_ns);
    if (carried_until_ns_ > now_ns) {
      queue_.push_back({carried_until_ns_, piece.size()});
      waiting_ += piece.size();
    }
    if (last_due_ns_ >= end_ns) {
      stats_.bytes_lost += piece.size();
      continue;
    }
    pieces_.push_back({last_due_ns_, {piece.begin(), piece.end()}});
    on_the_way_ += piece.size();
    if (config_.corrupt_per_MB > 0 && now_ns >= damage_from_ns_) damage(pieces_.back().bytes);
  }
  stats_.bytes_taken += taken;
  stats_.most_waiting = std::max(stats_.most_waiting, waiting_);
  return taken;
}

// Distances between changed bytes are exponential: a rate, without a rhythm.
void StreamEmulator::damage(std::span<std::uint8_t> bytes) {
  const double mean = 1e6 / config_.corrupt_per_MB;
  const auto draw = [&] { return -mean * std::log(1.0 - damage_.uniform()); };
  if (to_damage_ == 0) to_damage_ = draw();
  double at = to_damage_;
  while (at < static_cast<double>(bytes.size())) {
    bytes[static_cast<std::size_t>(at)] ^= static_cast<std::uint8_t>(damage_.integer(1, 255));
    ++stats_.bytes_changed;
    at = std::floor(at) + 1 + draw();
  }
  to_damage_ = at - static_cast<double>(bytes.size());
}

void StreamEmulator::read(std::int64_t now_ns, std::vector<std::uint8_t>& out) {
  while (!pieces_.empty() && pieces_.front().due <= now_ns) {
    const auto& bytes = pieces_.front().bytes;
    out.insert(out.end(), bytes.begin(), bytes.end());
    stats_.bytes_arrived += bytes.size();
    on_the_way_ -= bytes.size();
    pieces_.pop_front();
  }
}

std::int64_t StreamEmulator::next_arrival_ns() const noexcept {
  return pieces_.empty() ? kNever : pieces_.front().due;
}

bool StreamEmulator::busy(std::int64_t now_ns) const noexcept {
  return carried_until_ns_ > now_ns || dead(now_ns);
}

rt::Nanos StreamEmulator::busy_for(std::int64_t now_ns) const noexcept {
  if (!busy(now_ns)) return rt::Nanos{0};
  const double rate = line_.rate_at(now_ns);
  if (dead(now_ns) || rate <= 0 || line_.stalled_until(now_ns) > now_ns) return rt::Nanos::max();
  std::size_t waits = 0;
  for (auto w = queue_.rbegin(); w != queue_.rend() && w->carried > now_ns; ++w) waits += w->bytes;
  return rt::Nanos{static_cast<std::int64_t>(8.0 * static_cast<double>(waits) / rate)};
}

std::uint64_t StreamEmulator::ends(std::int64_t now_ns) const noexcept {
  return line_.flap_at(now_ns).count;
}

bool StreamEmulator::passable(std::int64_t now_ns) const noexcept {
  return now_ns < cut_at_ns_ && !line_.flap_at(now_ns).down;
}

void StreamEmulator::renew(std::int64_t now_ns) {
  stats_.bytes_lost += on_the_way_;
  on_the_way_ = 0;
  pieces_.clear();
  queue_.clear();
  waiting_ = 0;
  carried_until_ns_ = last_due_ns_ = now_ns;
  renewed_after_ = ends(now_ns);
}

}  // namespace drivers

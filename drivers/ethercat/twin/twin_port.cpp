#include "drivers/ethercat/twin/twin_port.hpp"

#include <algorithm>

namespace drivers::ethercat {

namespace {

// 100 Mbit/s: 80 ns a byte, with preamble, check sequence and gap; 1 us a slave there and back.
constexpr std::int64_t kByte_ns = 80, kAround_bytes = 24, kSlave_ns = 2 * kHop.count();

bool use_up(int& count) noexcept {
  if (count <= 0) return false;
  --count;
  return true;
}

}  // namespace

bool TwinPort::send(std::span<const std::uint8_t> frame) noexcept {
  if (faults_.link_down != link_lost_) {
    link_lost_ = faults_.link_down;
    if (link_lost_ && chain_.size() > 0) chain_.slave(0).lose_link(0);
  }
  if (faults_.link_down || frame.size() > kMaxFrame) return false;
  if (use_up(faults_.refuse)) return false;
  if (use_up(faults_.lose_out)) return true;
  std::copy(frame.begin(), frame.end(), work_.bytes.begin());
  work_.size = frame.size();
  const auto around = static_cast<std::int64_t>(frame.size()) + kAround_bytes;
  const std::int64_t flight_ns =
      kByte_ns * around + kSlave_ns * static_cast<std::int64_t>(chain_.reach());
  const std::int64_t cpu = cpu_clock_ != nullptr ? cpu_clock_() : 0;
  const auto bytes = std::span(work_.bytes).first(work_.size);
  const bool hurt_out = use_up(faults_.corrupt_out), lost = use_up(faults_.lose_back);
  const bool hurt = hurt_out || (!lost && use_up(faults_.corrupt));
  if (hurt) {
    chain_.pass_damaged(bytes, now_, {faults_.cable, hurt_out});
  } else {
    chain_.pass(bytes, now_);
  }
  if (cpu_clock_ != nullptr) twin_cpu_ns_ += cpu_clock_() - cpu;
  if (lost) return true;
  rt::Time arrives = now_ + rt::Nanos{flight_ns};
  if (use_up(faults_.delay)) arrives += faults_.delay_by;
  if (use_up(faults_.wrong_counter)) lower_counter(bytes);
  if (hurt) {
    rt::Random random(faults_.seed, order_);
    damage_heads(bytes, random);
  }
  put(bytes, arrives);
  if (use_up(faults_.duplicate)) put(bytes, arrives + rt::Nanos{flight_ns});
  return true;
}

void damage_heads(std::span<std::uint8_t> frame, rt::Random& random) noexcept {
  const auto at = static_cast<std::size_t>(random.integer(14, 23));
  const auto bit = static_cast<unsigned>(random.integer(0, 7));
  if (at < frame.size()) frame[at] ^= static_cast<std::uint8_t>(1U << bit);
}

void lower_counter(std::span<std::uint8_t> frame) noexcept {
  if (frame.size() < 24) return;
  const std::size_t at = 26 + (load_u16(frame, 22) & 0x07FFU);
  if (at + 2 <= frame.size())
    store_u16(frame, at, static_cast<std::uint16_t>(load_u16(frame, at) - 1));
}

void TwinPort::put(std::span<const std::uint8_t> frame, rt::Time arrives) noexcept {
  for (InFlight& slot : flight_) {
    if (slot.size > 0) continue;
    std::copy(frame.begin(), frame.end(), slot.bytes.begin());
    slot.size = frame.size();
    slot.arrives = arrives;
    slot.order = ++order_;
    return;
  }
}

std::size_t TwinPort::receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept {
  InFlight* next = nullptr;
  for (InFlight& slot : flight_) {
    if (slot.size == 0) continue;
    if (next == nullptr || slot.arrives < next->arrives ||
        (slot.arrives == next->arrives && slot.order < next->order))
      next = &slot;
  }
  const rt::Time until = std::max(now_, deadline);
  if (next == nullptr || next->arrives > until) {
    now_ = until;
    return 0;
  }
  now_ = std::max(now_, next->arrives);
  const std::size_t n = std::min(next->size, into.size());
  std::copy_n(next->bytes.begin(), n, into.begin());
  next->size = 0;
  return n;
}

}  // namespace drivers::ethercat

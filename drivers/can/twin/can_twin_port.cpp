#include "drivers/can/twin/can_twin_port.hpp"

#include <algorithm>
#include <cerrno>

namespace drivers::can {

namespace {
constexpr std::uint32_t kErrorController = 0x004, kErrorProtocol = 0x008, kErrorNoAck = 0x020,
                        kErrorBusOff = 0x040, kErrorRestarted = 0x100;
constexpr std::uint8_t kPassive = 0x20;  // CAN_ERR_CRTL_TX_PASSIVE
}  // namespace

CanTwinPort::CanTwinPort(rt::NonRealtime&, std::vector<TmclModule> modules, int rate_kbit_per_s,
                         rt::Nanos think)
    : modules_(std::move(modules)), ns_per_bit_(1e6 / rate_kbit_per_s), think_(think) {}

void CanTwinPort::tell(std::uint32_t id, std::uint8_t controller) noexcept {
  const std::array<std::uint8_t, 8> data{0, controller, 0, 0, 0, 0, 0, 0};
  watch_.take_error(id, data);
}

int CanTwinPort::send(rt::Time now, std::span<const CanFrame> frames) noexcept {
  advance(now);
  int taken = 0;
  const auto held = static_cast<std::size_t>(
      std::count_if(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(count_),
                    [](const Waiting& w) { return !w.from_module; }));
  if (faults_.interface_down) {
    watch_.take_errno(ENETDOWN);
  } else if (watch_.port != PortState::kBusOff) {
    for (const CanFrame& f : frames) {
      if (held + static_cast<std::size_t>(taken) >= kQueue || count_ == waiting_.size()) break;
      waiting_[count_++] = {f, now, false};
      ++taken;
    }
    if (static_cast<std::size_t>(taken) < frames.size()) {
      watch_.take_errno(ENOBUFS);
    } else if (!frames.empty()) {
      watch_.take_room();
    }
  }
  watch_.counters.sent += static_cast<std::uint64_t>(taken);
  watch_.counters.refused += frames.size() - static_cast<std::size_t>(taken);
  return taken;
}

int CanTwinPort::receive(rt::Time now, std::span<Received> out) noexcept {
  advance(now);
  if (faults_.interface_down) watch_.take_errno(ENETDOWN);
  const std::size_t n = std::min(arrived_, out.size());
  std::copy_n(in_.begin(), n, out.begin());
  std::copy(in_.begin() + static_cast<std::ptrdiff_t>(n),
            in_.begin() + static_cast<std::ptrdiff_t>(arrived_), in_.begin());
  arrived_ -= n;
  return static_cast<int>(n);
}

// Lowest identifier of those that are ready; of equal ones the older. -1: none.
int CanTwinPort::next_to_go(rt::Time at) const noexcept {
  int best = -1;
  for (std::size_t i = 0; i < count_; ++i) {
    if (waiting_[i].ready > at) continue;
    if (best < 0 || waiting_[i].frame.id < waiting_[static_cast<std::size_t>(best)].frame.id)
      best = static_cast<int>(i);
  }
  return best;
}

void CanTwinPort::advance(rt::Time now) noexcept {
  if (stop_all_.exchange(false, std::memory_order_acq_rel)) {
    for (TmclModule& m : modules_) {
      tmcl::Reply reply;
      bool text = false;
      (void)m.answer({0, static_cast<std::uint8_t>(tmcl::Command::kMotorStop), 0, 0, 0}, reply,
                     text);
    }
  }
  if (faults_.interface_down) {
    count_ = 0;
    return;
  }
  if (faults_.cable_cut) {
    if (count_ > 0) tell(kErrorController | kErrorNoAck, kPassive);
    free_at_ = std::max(free_at_, now);
    return;
  }
  while (count_ > 0) {
    rt::Time start = waiting_[0].ready;
    for (std::size_t i = 1; i < count_; ++i) start = std::min(start, waiting_[i].ready);
    start = std::max(start, free_at_);
    const int i = next_to_go(start);
    const Waiting w = waiting_[static_cast<std::size_t>(i)];
    const rt::Nanos takes{static_cast<std::int64_t>(ns_per_bit_ * most_bits(w.frame.length))};
    if (start + takes > now) return;
    free_at_ = start + takes;
    busy_ += takes;
    if (faults_.corrupt > 0) {
      --faults_.corrupt;
      tell(kErrorProtocol, 0);
      continue;  // it goes again
    }
    std::copy(waiting_.begin() + i + 1, waiting_.begin() + static_cast<std::ptrdiff_t>(count_),
              waiting_.begin() + i);
    --count_;
    deliver(w, free_at_);
  }
}

void CanTwinPort::deliver(const Waiting& w, rt::Time end) noexcept {
  if (!w.from_module) {
    module_takes(w.frame, end);
    return;
  }
  watch_.take_life();
  ++watch_.counters.received;
  if (arrived_ == in_.size()) {
    ++watch_.counters.dropped;
    return;
  }
  in_[arrived_++] = {w.frame, end};
}

void CanTwinPort::module_takes(const CanFrame& f, rt::Time end) noexcept {
  tmcl::Request q;
  if (f.length < tmcl::kCanBytes || !tmcl::from_can(f.bytes().first(tmcl::kCanBytes), q)) return;
  for (TmclModule& m : modules_) {
    if (m.id != f.id) continue;
    tmcl::Reply reply;
    bool text = false;
    if (!m.answer(q, reply, text)) continue;
    CanFrame out;
    if (text) {
      constexpr std::array<std::uint8_t, 8> kName{'1', '6', '4', '0', 'V', '1', '4', '8'};
      (void)fill(out, m.reply_id, std::span(kName).first(f.length));
    } else {
      (void)fill(out, m.reply_id, tmcl::to_can(reply));
    }
    if (faults_.lose_replies > 0) {
      --faults_.lose_replies;
      continue;
    }
    // A module answers in the order that it was asked in.
    m.answered = std::max(m.answered, end + think_ + faults_.delay_replies);
    put_reply(out, m.answered);
    if (faults_.double_replies > 0) {
      --faults_.double_replies;
      put_reply(out, m.answered);
    }
  }
}

void CanTwinPort::put_reply(const CanFrame& f, rt::Time ready) noexcept {
  if (count_ < waiting_.size()) waiting_[count_++] = {f, ready, true};
}

void CanTwinPort::bus_off() noexcept {
  count_ = 0;
  tell(kErrorBusOff, 0);
}
void CanTwinPort::restart() noexcept { tell(kErrorRestarted, 0); }

}  // namespace drivers::can

// Sync managers: who may touch which byte of the process-data memory, and what follows.
// Source: ETG.1000.4, 6.7; ESC data sheet section I, 8 (mailbox mode, buffered mode).
#include <algorithm>

#include "drivers/ethercat/twin/esc.hpp"

namespace drivers::ethercat {

Esc::Area Esc::area(int i) const noexcept {
  const auto b = std::span(memory_).subspan(reg::sync_manager(i), reg::kSmBytes);
  return {load_u16(b), load_u16(b, 2), b[4], (b[6] & sm::kEnable) != 0};
}

int Esc::manager_of(bool outputs) const noexcept {
  for (int i = 0; i < config_.sync_managers && i < kManagers; ++i) {
    const Area& w = wanted_[static_cast<std::size_t>(i)];
    if (w.enabled && !w.mailbox() && w.written_by_master() == outputs) return i;
  }
  return -1;
}

// May the bytes [at, at + size) of this area be touched? Opens the area where its first byte is.
bool Esc::open_for(int i, const Area& a, std::size_t at, std::size_t size, bool write,
                   rt::Time now) noexcept {
  Manager& m = managers_[static_cast<std::size_t>(i)];
  if (write != a.written_by_master()) return false;
  if (a.mailbox()) {
    if (write == m.full) return false;
  } else if (al_.is() != AlState::kSafeOp && al_.is() != AlState::kOp) {
    return false;  // the application keeps process data closed
  } else if (write && al_.error() && config_.error_closes_outputs) {
    return false;  // and its outputs, until the error is acknowledged
  }
  const bool first = at <= a.start && a.start < at + size;
  if (first && !write && !a.mailbox() && !m.open)
    application_->fill_inputs(std::span(memory_).subspan(a.start, a.length), now);
  if (first) m.open = true;
  if (first && write) m.emptied = false;
  return m.open;
}

// The last byte was touched: the mailbox changes hands, a buffer is handed over.
void Esc::closed(int i, const Area& a, bool write, rt::Time now) noexcept {
  Manager& m = managers_[static_cast<std::size_t>(i)];
  m.open = false;
  if (a.mailbox()) {
    m.full = write;
    m.emptied = !write;
    if (write) {
      request_waits_ = true;
      request_due_ = now + config_.mailbox_delay;
    }
    return;
  }
  if (!write) return;
  outputs_came_ = true;
  fed_ = now;
  watchdog_good_ = true;
  if (al_.is() == AlState::kOp)
    application_->on_outputs(std::span(memory_).subspan(a.start, a.length), now);
}

bool Esc::read_ram(std::size_t at, std::span<std::uint8_t> out, rt::Time now) noexcept {
  std::fill(out.begin(), out.end(), std::uint8_t{0});
  std::array<bool, kManagers> allowed{};
  std::array<Area, kManagers> areas{};
  for (int i = 0; i < kManagers; ++i) {
    const auto k = static_cast<std::size_t>(i);
    areas[k] = area(i);
    if (!areas[k].enabled || at >= areas[k].start + areas[k].length ||
        at + out.size() <= areas[k].start)
      continue;
    allowed[k] = open_for(i, areas[k], at, out.size(), false, now);
  }
  bool any = false;
  for (std::size_t b = 0; b < out.size() && at + b < memory_.size(); ++b) {
    bool may = true;
    for (std::size_t k = 0; k < areas.size(); ++k)
      if (areas[k].holds(at + b)) may = may && allowed[k];
    if (!may) continue;
    out[b] = memory_[at + b];
    any = true;
  }
  for (std::size_t k = 0; k < areas.size(); ++k) {
    const std::size_t end = areas[k].start + areas[k].length;
    if (allowed[k] && at + out.size() >= end && at < end)
      closed(static_cast<int>(k), areas[k], false, now);
  }
  if (any) application_->on_traffic(now);
  return any;
}

bool Esc::write_ram(std::size_t at, std::span<const std::uint8_t> in, rt::Time now) noexcept {
  std::array<bool, kManagers> allowed{};
  std::array<Area, kManagers> areas{};
  for (int i = 0; i < kManagers; ++i) {
    const auto k = static_cast<std::size_t>(i);
    areas[k] = area(i);
    if (!areas[k].enabled || at >= areas[k].start + areas[k].length ||
        at + in.size() <= areas[k].start)
      continue;
    allowed[k] = open_for(i, areas[k], at, in.size(), true, now);
  }
  bool any = false;
  for (std::size_t b = 0; b < in.size() && at + b < memory_.size(); ++b) {
    bool may = true;
    for (std::size_t k = 0; k < areas.size(); ++k)
      if (areas[k].holds(at + b)) may = may && allowed[k];
    if (!may) continue;
    memory_[at + b] = in[b];
    any = true;
  }
  if (any) application_->on_traffic(now);
  for (std::size_t k = 0; k < areas.size(); ++k) {
    const std::size_t end = areas[k].start + areas[k].length;
    if (allowed[k] && at + in.size() >= end && at < end)
      closed(static_cast<int>(k), areas[k], true, now);
  }
  return any;
}

// A write to a sync manager's registers: switched off it forgets; a turned repeat bit of the in
// mailbox puts the last reply there again.
void Esc::activate(int i, rt::Time) noexcept {
  Manager& m = managers_[static_cast<std::size_t>(i)];
  const Area a = area(i);
  if (!a.enabled || a.start + a.length > memory_.size() || a.start < reg::kRam) {
    m = {};
    if (a.enabled) memory_[reg::sm_activate(i)] &= static_cast<std::uint8_t>(~sm::kEnable);
    return;
  }
  if (!config_.knows_repeat) return;
  const bool asked = (memory_[reg::sm_activate(i)] & sm::kRepeatRequest) != 0;
  if (asked == m.repeat) return;
  m.repeat = asked;
  if (a.mailbox() && !a.written_by_master()) m.full = true;
}

// The application takes a request when its reply has room.
void Esc::serve_mailbox(rt::Time now) noexcept {
  if (!request_waits_ || now < request_due_ || al_.is() == AlState::kInit) return;
  const Area out = area(0), in = area(1);
  if (!out.enabled || !in.enabled || managers_[1].full) return;
  request_waits_ = false;
  managers_[0].full = false;
  managers_[0].emptied = true;
  const bool replied = application_->on_mailbox(
      std::span<const std::uint8_t>(memory_).subspan(out.start, out.length),
      std::span(memory_).subspan(in.start, in.length), request_due_);
  managers_[1].full = replied;
  if (replied) managers_[1].emptied = false;
}

}  // namespace drivers::ethercat

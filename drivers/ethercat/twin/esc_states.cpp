// The state machine of the virtual slave: ETG.1000.6, 5.3 and 6.4; codes of the table "AL status
// codes". A refused request leaves the state and sets the error bit; it stands until it is
// acknowledged or INIT is asked for.
#include "drivers/ethercat/twin/esc.hpp"

namespace drivers::ethercat {

namespace {

bool may_go(AlState from, AlState to) noexcept {
  if (to == AlState::kInit || to == from) return true;
  switch (from) {
    case AlState::kInit:
      return to == AlState::kPreOp;
    case AlState::kPreOp:
      return to == AlState::kSafeOp;
    case AlState::kSafeOp:
      return to == AlState::kPreOp || to == AlState::kOp;
    case AlState::kOp:
      return to == AlState::kPreOp || to == AlState::kSafeOp;
    default:
      return false;
  }
}

bool is_state(AlState s) noexcept {
  return s == AlState::kInit || s == AlState::kPreOp || s == AlState::kBoot ||
         s == AlState::kSafeOp || s == AlState::kOp;
}

}  // namespace

void Esc::advance(rt::Time now) noexcept {
  serve_mailbox(now);
  if (al_.is() != AlState::kOp) return;
  const int outputs = manager_of(true);
  const rt::Nanos limit = watchdog_time();
  if (outputs < 0 || limit.count() == 0 || (area(outputs).control & sm::kWatchdog) == 0) return;
  const rt::Time expiry = fed_ + limit;
  if (now < expiry) return;
  watchdog_good_ = false;
  if (memory_[reg::kWatchdogCount] < 0xFF) ++memory_[reg::kWatchdogCount];
  fall(al_code::kWatchdog, expiry);
}

rt::Nanos Esc::watchdog_time() const noexcept {
  const std::int64_t unit_ns = 40 * (load_u16(memory_, reg::kWatchdogDivider) + std::int64_t{2});
  return rt::Nanos{unit_ns * load_u16(memory_, reg::kDataWatchdog)};
}

void Esc::fall(std::uint16_t code, rt::Time now) noexcept {
  if (al_.is() == AlState::kOp) enter(AlState::kSafeOp, now);
  al_ = {static_cast<std::uint8_t>(al_.state | kAlError), code};
  show_state();
}

// As the SII asks for it, with the length of the PDOs where the category leaves it at that.
Esc::Area Esc::wanted_area(int i) const noexcept { return wanted_[static_cast<std::size_t>(i)]; }

bool Esc::manager_matches(int i, const Area& wanted) const noexcept {
  const Area is = area(i);
  return is.enabled && is.start == wanted.start && is.length == wanted.length &&
         is.mailbox() == wanted.mailbox() && is.written_by_master() == wanted.written_by_master();
}

std::uint16_t Esc::refusal(AlState to) const noexcept {
  if (to == AlState::kPreOp && al_.is() == AlState::kInit) {
    for (int i = 0; i < 2; ++i) {
      const Area w = wanted_area(i);
      if (!w.enabled || !w.mailbox()) continue;
      // Masters set up a mailbox where the SII names a protocol (word 0x1C), and some only there.
      const bool wrong = area(i).enabled ? !manager_matches(i, w) : mailbox_needed_;
      if (wrong) return al_code::kMailbox;
    }
  }
  if (to == AlState::kSafeOp && al_.is() == AlState::kPreOp) {
    const int out = manager_of(true), in = manager_of(false);
    if (out >= 0 && !manager_matches(out, wanted_area(out))) return al_code::kOutputs;
    if (in >= 0 && !manager_matches(in, wanted_area(in))) return al_code::kInputs;
  }
  if (to == AlState::kOp && al_.is() == AlState::kSafeOp && config_.op_needs_outputs &&
      manager_of(true) >= 0 && !outputs_came_)
    return al_code::kNoOutputs;
  return al_code::kNone;
}

void Esc::request_state(unsigned control, rt::Time now) noexcept {
  const auto to = static_cast<AlState>(control & kAlStateMask);
  // Beckhoff's slave stack (5.x, AL_ControlInd) and SOES (ESC_state) do the same; older stacks also
  // served the same or a lower state.
  if (al_.error() && (control & kAlAcknowledge) == 0 && to != AlState::kInit) return;
  std::uint16_t code = al_code::kNone;
  if (!is_state(to)) {
    code = al_code::kUnknownState;
  } else if (to == AlState::kBoot) {
    code = al_code::kNoBootstrap;
  } else if (!may_go(al_.is(), to)) {
    code = al_code::kInvalidChange;
  } else {
    code = refusal(to);
  }
  if (code != al_code::kNone) {
    al_ = {static_cast<std::uint8_t>((al_.state & kAlStateMask) | kAlError), code};
  } else {
    enter(to, now);
  }
  looks_left_ = config_.state_looks;
  if (looks_left_ == 0) show_state();
}

void Esc::enter(AlState to, rt::Time now) noexcept {
  const AlState from = al_.is();
  al_ = {static_cast<std::uint8_t>(to), al_code::kNone};
  if (to == from) return;
  if (to == AlState::kOp) fed_ = now;
  if (to == AlState::kInit || to == AlState::kPreOp) outputs_came_ = false;
  if (to == AlState::kInit) {
    request_waits_ = false;
    for (Manager& m : managers_) m.full = m.open = m.emptied = false;
  }
  application_->on_state(to, now);
}

}  // namespace drivers::ethercat

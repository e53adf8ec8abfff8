#include "drivers/ethercat/state_control.hpp"

#include <array>
#include <cstdio>

#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"

namespace drivers::ethercat {

namespace {

constexpr rt::Nanos kStatePoll = std::chrono::microseconds{500};

rt::Error refusal(const SlaveInfo& s, AlState wanted, const AlStatus& is) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), ": %s %s; is %s%s, code 0x%04X: %s",
                is.error() ? "refuses" : "does not reach", state_text(wanted), state_text(is.is()),
                is.error() ? " + ERROR" : "", is.code, code_text(is.code));
  return {s.label() + text.data()};
}

rt::Result<bool> write_blocks(RegisterAccess& r, const SlaveInfo& s,
                              std::span<const RegisterBlock> blocks) {
  for (const RegisterBlock& b : blocks) {
    if (r.write(s.station, b.reg, std::span(b.bytes).first(b.size))) continue;
    std::array<char, 96> text{};
    std::snprintf(text.data(), text.size(), ": register 0x%04X: %s", b.reg, r.why());
    return rt::Error{s.label() + text.data()};
  }
  return true;
}

}  // namespace

rt::Result<bool> request_state(RegisterAccess& r, const SlaveInfo& s, AlState wanted,
                               rt::Nanos timeout) {
  const rt::Time end = r.port().now() + timeout;
  AlStatus is = read_al_status(r, s.station);
  // Alone, and until it shows: an old error bit that is read behind the request would look like the
  // request's refusal.
  if (is.error() && !r.write_u16(s.station, reg::kAlControl, is.state | kAlAcknowledge))
    return rt::Error{s.label() + ": " + r.why()};
  while (is.error()) {
    if (r.port().now() >= end) return refusal(s, wanted, is);
    r.port().sleep_until(r.port().now() + kStatePoll);
    is = read_al_status(r, s.station);
  }
  if (!r.write_u16(s.station, reg::kAlControl, static_cast<unsigned>(wanted)))
    return rt::Error{s.label() + ": " + r.why()};
  for (;;) {
    is = read_al_status(r, s.station);
    if (is.is() == wanted && !is.error()) return true;
    if (is.error() || r.port().now() >= end) return refusal(s, wanted, is);
    r.port().sleep_until(r.port().now() + kStatePoll);
  }
}

rt::Result<bool> to_preop(RegisterAccess& r, const SlaveInfo& s, const SlaveMapping& m,
                          rt::Nanos timeout) {
  // A slave that was running takes its time to INIT; what is written before it is there, is lost.
  auto idle = request_state(r, s, AlState::kInit, timeout);
  if (!idle) return idle;
  auto written = write_blocks(
      r, s, std::span(m.mailbox_setup).first(static_cast<std::size_t>(m.mailbox_blocks)));
  if (!written) return written;
  if (!r.write_u8(s.station, reg::kSiiAccess, 1)) return rt::Error{s.label() + ": " + r.why()};
  return request_state(r, s, AlState::kPreOp, timeout);
}

rt::Result<bool> to_safeop(RegisterAccess& r, const SlaveInfo& s, const SlaveMapping& m,
                           rt::Nanos timeout) {
  auto written =
      write_blocks(r, s, std::span(m.data_setup).first(static_cast<std::size_t>(m.data_blocks)));
  if (!written) return written;
  return request_state(r, s, AlState::kSafeOp, timeout);
}

}  // namespace drivers::ethercat

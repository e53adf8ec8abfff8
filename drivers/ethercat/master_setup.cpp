// From nothing to OP, and back.
#include <algorithm>
#include <array>
#include <cstdio>

#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/registers.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/served.hpp"
#include "drivers/ethercat/state_control.hpp"

namespace drivers::ethercat {

namespace {

// (n + 2) * 40 ns: 100 us (ESC data sheet II, register 0x0400).
constexpr std::uint16_t kDivider100us = 2498;
// Of stop(): less than the 100 ms of the slaves' watchdogs. The look under way when it is over
// takes its three tries.
constexpr rt::Nanos kStopTime = std::chrono::milliseconds{50};

RegisterBlock u16_block(std::uint16_t r, unsigned value) {
  RegisterBlock b{r, 2, {}};
  store_u16(b.bytes, 0, value);
  return b;
}

void set_watchdog(SlaveMapping& m, int ms) {
  if (!m.watchdog || ms == 0) return;
  m.data_setup[static_cast<std::size_t>(m.data_blocks++)] =
      u16_block(reg::kWatchdogDivider, kDivider100us);
  m.data_setup[static_cast<std::size_t>(m.data_blocks++)] =
      u16_block(reg::kDataWatchdog, static_cast<unsigned>(10 * ms));
}

}  // namespace

Master::Master(rt::NonRealtime&, Port& port, const MasterConfig& config)
    : config_(config), registers_(port), frames_(port) {}

rt::Result<bool> Master::find(rt::NonRealtime& nrt) {
  auto found = scan(nrt, registers_);
  if (!found) return rt::Error{found.error()};
  slaves_ = std::move(found.value());
  ServedChain served = map_served(slaves_);
  mapping_ = std::move(served.mapping);
  problem_ = std::move(served.problem);
  for (SlaveMapping& m : mapping_.slaves) set_watchdog(m, config_.watchdog_ms);
  image_.assign(mapping_.output_bytes + mapping_.input_bytes, 0);
  al_.assign(slaves_.size(), AlStatus{});
  kept_.assign(slaves_.size(), false);
  recovery_ = Recovery(&mapping_.slaves);
  transfer_.stop();
  present_ = static_cast<int>(slaves_.size());
  watched_ = 0;
  stopped_ = false;
  started_ = false;  // they are in INIT
  return true;
}

rt::Result<bool> Master::configure(rt::NonRealtime&) {
  if (slaves_.empty()) return rt::Error{"EtherCAT: no slave"};
  if (!problem_.empty()) return rt::Error{problem_};
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    auto done = to_preop(registers_, slaves_[i], mapping_.slaves[i], config_.state_timeout);
    if (!done) return done;
  }
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    auto done = to_safeop(registers_, slaves_[i], mapping_.slaves[i], config_.state_timeout);
    if (!done) return done;
  }
  return true;
}

rt::Result<bool> Master::start(rt::NonRealtime& nrt) {
  Port& port = frames_.port();
  clear_outputs();
  counters_.bad_in_row = 0;
  stopped_ = false;
  started_ = true;
  // Slaves want valid outputs before OP: a few cycles first.
  rt::Time next = port.now();
  const auto wait_period = [&] { port.sleep_until(next += config_.period); };
  for (int i = 0; i < 3; ++i) {
    (void)exchange();
    wait_period();
  }
  recover();
  const rt::Time end = next + config_.state_timeout * static_cast<int>(slaves_.size());
  while (recovering() && port.now() < end) {
    (void)exchange();
    wait_period();
  }
  if (!recovery_.succeeded()) {
    const auto i = static_cast<std::size_t>(recovery_.slave());
    return rt::Error{slaves_[i].label() +
                     ": does not reach OP: " + code_text(recovery_.status().code)};
  }
  // Each slave's own state once, so that al_status() is of now; and more, until a cycle is good:
  // the last one may have been lost.
  constexpr std::size_t kMoreCycles = 100;
  const std::size_t all = slaves_.size();
  for (std::size_t i = 0; i <= all || (i <= all + kMoreCycles && health().fault != BusFault::kNone);
       ++i) {
    (void)exchange();
    wait_period();
  }
  const BusHealth h = health();
  if (h.fault != BusFault::kNone) return rt::Error{describe(nrt, h)};
  return true;
}

void Master::stop(rt::NonRealtime&) noexcept {
  if (!started_) return;
  started_ = false;
  stopped_ = true;  // zeros, whoever calls a cycle after this
  std::fill(kept_.begin(), kept_.end(), false);
  Port& port = frames_.port();
  const rt::Time end = port.now() + kStopTime;
  // Twice: the first may be lost, and SAFEOP shall find outputs that are zero.
  (void)exchange();
  (void)exchange();
  std::array<std::uint8_t, 2> states{};
  // Registers 0x0130 of all, ORed. Nobody there: nobody to be told.
  const auto look = [&] {
    states = {};
    return registers_.run(Command::kBrd, broadcast_address(reg::kAlStatus), states).value_or(0);
  };
  if (look() == 0) return;
  // A slave below SAFEOP refuses it, and would end with an error.
  constexpr auto kBelow = static_cast<std::uint8_t>(AlState::kBoot);  // bits of INIT and PREOP
  const AlState to = (states[0] & kBelow) == 0 ? AlState::kSafeOp : AlState::kInit;
  const std::array<std::uint8_t, 2> request{
      static_cast<std::uint8_t>(static_cast<unsigned>(to) | kAlAcknowledge), 0};
  (void)registers_.write_all(reg::kAlControl, request);
  while (look() > 0 && states[0] != static_cast<std::uint8_t>(to) && port.now() < end)
    port.sleep_until(port.now() + std::chrono::milliseconds{1});
}

std::string Master::losses() const {
  const ExchangeCounters &a = registers_.counters(), &b = frames_.counters();
  const auto sent = a.sent + b.sent, lost = a.lost + b.lost;
  const auto wrong = registers_.wrong_counters() + counters_.short_counter;
  std::string out;
  const auto tell = [&](std::uint64_t n, const char* what) {
    if (n == 0 || 100 * n < sent) return;
    out += (out.empty() ? std::to_string(n) + " of " + std::to_string(sent) + " frames "
                        : ", " + std::to_string(n) + " ") +
           what;
  };
  tell(lost, "were lost or damaged");
  tell(wrong, "came back with a wrong working counter");
  return out;
}

std::string Master::describe(rt::NonRealtime&, const BusHealth& h) const {
  const auto of_slave = [&] {
    const auto i = static_cast<std::size_t>(h.slave);
    return h.slave >= 0 && i < slaves_.size() ? slaves_[i].label() : std::string("a slave");
  };
  std::array<char, 160> text{};
  switch (h.fault) {
    case BusFault::kSlavesMissing:
      return of_slave() + " and those behind it are gone: cable, power or emergency stop";
    case BusFault::kSlaveState:
      if (h.too_many > 0) {
        std::snprintf(text.data(), text.size(),
                      "%d slaves answer and %zu were found: %d too many, plugged in since",
                      h.too_many + h.slave, slaves_.size(), h.too_many);
        return text.data();
      }
      std::snprintf(text.data(), text.size(), " is in %s%s, code 0x%04X: %s", state_text(h.al.is()),
                    h.al.error() ? " + ERROR" : "", h.al.code, code_text(h.al.code));
      return of_slave() + text.data();
    default:
      return to_text(h.fault);
  }
}

}  // namespace drivers::ethercat

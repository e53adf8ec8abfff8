// Brings slaves back to OP, one datagram a cycle, while the others go on: an acknowledged error, a
// lost address, a slave that was off. Each step follows from the AL status that was read before it,
// so it does not matter which frame was lost.
// Source: ETG.1000.6, 5.3 (error acknowledge), 6.4; the order of the set-up is that of
// state_control.
//
//   no answer            its address again, by position, if the chain is that long
//   error                AL control = state + acknowledge
//   INIT                 mailbox sync managers, one a cycle, EEPROM to the application, then PREOP
//   PREOP                process data sync managers and FMMUs, one a cycle, then SAFEOP
//   SAFEOP               OP
//   OP                   next slave
//
// Nothing here allocates.
#pragma once

#include <bitset>
#include <vector>

#include "drivers/ethercat/exchange.hpp"
#include "drivers/ethercat/mapping.hpp"

namespace drivers::ethercat {

class Recovery {
 public:
  Recovery() = default;
  explicit Recovery(const std::vector<SlaveMapping>* slaves) noexcept : slaves_(slaves) {}

  // All slaves, each with `steps` datagrams at most: one that does not come ends it, however many
  // there are.
  void start(int steps) noexcept;
  [[nodiscard]] bool active() const noexcept { return active_; }
  // Of the last start(): all slaves were seen in OP.
  [[nodiscard]] bool succeeded() const noexcept { return succeeded_; }
  // Slave `i` was found in INIT: its power was off, and what it counted begins anew.
  [[nodiscard]] bool began_anew(std::size_t i) const noexcept { return anew_[i]; }
  // The slave at work, and what it said last.
  [[nodiscard]] int slave() const noexcept { return slave_; }
  [[nodiscard]] const AlStatus& status() const noexcept { return status_; }
  // The datagram under way reads its AL status; else it writes.
  [[nodiscard]] bool observes() const noexcept { return step_ == Step::kObserve; }

  [[nodiscard]] bool add_to(FrameExchange& frame) noexcept;
  void on_reply(const DatagramView& d) noexcept;
  void on_lost() noexcept;

 private:
  enum class Step : std::uint8_t { kObserve, kWrite };
  struct Write {
    Command command = Command::kNop;
    std::uint32_t address = 0;
    std::size_t size = 0;
    std::array<std::uint8_t, 16> bytes{};
  };
  void decide() noexcept;
  void write_al(unsigned value) noexcept;
  // The next block of the set-up; false: all are written.
  bool write_block(std::span<const RegisterBlock> blocks) noexcept;
  // False: it is given.
  bool give_sii() noexcept;
  void next_slave() noexcept;
  [[nodiscard]] const SlaveMapping& at_work() const noexcept {
    return (*slaves_)[static_cast<std::size_t>(slave_)];
  }

  const std::vector<SlaveMapping>* slaves_ = nullptr;
  bool active_ = false, succeeded_ = false;
  std::bitset<256> anew_;
  int slave_ = 0, steps_ = 0, left_ = 0;
  Step step_ = Step::kObserve;
  Write write_;
  AlStatus status_;
  std::size_t block_ = 0;  // of the set-up of this state that is written next
  AlState block_state_ = AlState::kNone;
  int patience_ = 0;  // observations until a request is repeated
};

}  // namespace drivers::ethercat

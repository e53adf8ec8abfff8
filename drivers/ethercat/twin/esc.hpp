// Twin of an EtherCAT slave: the slave controller (registers, sync managers, FMMUs, EEPROM,
// watchdog) and the state machine of the application behind it. Datagrams pass through it byte for
// byte. Source: ETG.1000.4, 5.4 and 6; ETG.1000.6, 5.3; Beckhoff ESC data sheet, sections I and II.
//
// Time    lazy: the instants of watchdog and mailbox replies are those they would have, whenever
//         the next datagram comes.
// Access  a datagram counts if at least one byte of it could be read or written. Registers that are
//         not built read 0 and count. A sync manager in mailbox mode takes a write only when empty
//         and gives a read only when full; in buffered mode the area opens by its first byte and is
//         handed over by its last.
// Mailbox sync managers 0 and 1 that are on have to be the SII's, else PREOP is refused (0x0016).
//         Off they may be only where the SII names no protocol: then no mailbox is served.
// Events  a new DL or AL status and what happened to mailboxes, ORed into the irq field of each
//         datagram as far as 0x0200 lets them (data sheet II, 0x0210). Buffers have none.
// Errors  counted as the data sheet has it (I, "error counters"): frames that came damaged, by the
//         first that hears it (0x0300) and those behind it (0x0308); frames whose structure is
//         wrong (0x030C); lost links (0x0310). The counters of refused symbols stay 0.
// Clocks  answer: system time, offset, delay, latched receive times, kHop from slave to slave and
//         on the way back; nothing is synchronised.
// Limits  FMMUs map whole bytes (feature bit 0 says so).
// One owner; nothing allocates after construction.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "drivers/ethercat/al_state.hpp"
#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/registers.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/time.hpp"

namespace drivers::ethercat {

// From one slave to the next, in either direction: its work on a byte, and the cable.
inline constexpr rt::Nanos kHop{500};

// What stands behind the slave controller.
class EscApplication {
 public:
  virtual ~EscApplication() = default;
  // Outputs as the master wrote them; in OP alone.
  virtual void on_outputs(std::span<const std::uint8_t>, rt::Time) noexcept {}
  virtual void fill_inputs(std::span<std::uint8_t>, rt::Time) noexcept {}
  // The whole out mailbox. True: `reply`, the whole in mailbox, was filled.
  virtual bool on_mailbox(std::span<const std::uint8_t>, std::span<std::uint8_t>,
                          rt::Time) noexcept {
    return false;
  }
  // A new state; from OP to another one: outputs are void.
  virtual void on_state(AlState, rt::Time) noexcept {}
  // A datagram of process data or mailbox reached this slave.
  virtual void on_traffic(rt::Time) noexcept {}
};

struct EscConfig {
  std::uint8_t type = 0x11, revision = 0, ram_kib = 4;
  std::uint8_t fmmus = 4, sync_managers = 4;  // at most 16 and 8
  std::uint16_t build = 2;
  std::uint16_t features = feature::kByteFmmu | feature::kClocks;
  bool sii_reads_eight = false;
  int sii_busy_looks = 1;            // so many reads of 0x0502 find it busy
  bool reload_takes_alias = true;    // as the ESC20's; others take it when their power comes alone
  bool op_needs_outputs = true;      // SAFEOP to OP only after outputs came: drives differ
  int state_looks = 0;               // so many reads of 0x0130 until a new state shows
  rt::Nanos mailbox_delay{0};        // from a request to its reply
  bool error_closes_outputs = true;  // as Beckhoff's slave stack; others take outputs on
  bool knows_repeat = true;          // else a lost reply stays lost
};

class Esc {
 public:
  Esc(rt::NonRealtime&, const EscConfig&, std::vector<std::uint8_t> sii,
      std::unique_ptr<EscApplication> application);

  // A datagram on its way: address, data and counter as this slave leaves them.
  struct Passing {
    Command command;
    std::uint32_t address;
    std::span<std::uint8_t> data;
    std::uint16_t counter;
    std::uint16_t irq;
  };
  void pass(Passing& d, rt::Time now) noexcept;
  // A frame that the processing unit could not read.
  void count_bad_frame() noexcept;
  // A frame with a wrong check sequence came by this port; `first`: no other slave had marked it.
  void count_damaged(std::size_t port, bool first) noexcept;
  // The link of this port went.
  void lose_link(std::size_t port) noexcept;

  // Power off and on: registers as new, INIT, no address.
  void power_cycle(rt::Time now) noexcept;
  // The application leaves for SAFEOP + ERROR by itself.
  void fall(std::uint16_t al_status_code, rt::Time now) noexcept;
  // Slaves before this one and behind it on its line: show in DL status and receive times.
  void set_place(std::size_t before, std::size_t behind) noexcept;

  [[nodiscard]] AlStatus al_status() const noexcept { return al_; }
  [[nodiscard]] EscApplication& application() noexcept { return *application_; }
  [[nodiscard]] std::uint16_t station() const noexcept { return load_u16(memory_, reg::kStation); }
  [[nodiscard]] std::span<const std::uint8_t> memory() const noexcept { return memory_; }
  [[nodiscard]] std::vector<std::uint8_t>& eeprom() noexcept { return sii_; }

 private:
  static constexpr std::size_t kMemory = 0x2000;
  static constexpr int kManagers = 8;
  struct Manager {
    bool open = false, full = false;
    bool emptied = false;  // read to its end, and not written since
    bool repeat = false;   // the request bit that was answered last
  };
  struct Area {  // of a sync manager as its registers say
    std::size_t start = 0, length = 0;
    std::uint8_t control = 0;
    bool enabled = false;
    [[nodiscard]] bool mailbox() const noexcept {
      return (control & sm::kModeMask) == sm::kMailbox;
    }
    [[nodiscard]] bool written_by_master() const noexcept {
      return (control & sm::kDirectionMask) == sm::kMasterWrites;
    }
    [[nodiscard]] bool holds(std::size_t at) const noexcept {
      return enabled && at >= start && at < start + length;
    }
  };

  // esc.cpp: addressing and registers
  void run_position(Passing& d, rt::Time now) noexcept;
  [[nodiscard]] bool access(Passing& d, std::size_t at, rt::Time now) noexcept;
  void pass_logical(Passing& d, rt::Time now) noexcept;
  [[nodiscard]] bool read(std::size_t at, std::span<std::uint8_t> out, rt::Time now) noexcept;
  [[nodiscard]] bool write(std::size_t at, std::span<const std::uint8_t> in, rt::Time now) noexcept;
  void reset_registers() noexcept;
  void show(rt::Time now) noexcept;
  void show_state() noexcept;
  [[nodiscard]] unsigned manager_status(int i) const noexcept;
  [[nodiscard]] unsigned event_request() const noexcept;
  [[nodiscard]] bool is_built(std::size_t at) const noexcept;
  void write_register(std::size_t at, std::uint8_t value) noexcept;
  void act_on_write(std::size_t at, std::size_t size, rt::Time now) noexcept;
  void run_sii_command() noexcept;
  void load_configuration(bool at_power_on) noexcept;
  [[nodiscard]] bool sii_sealed() const noexcept;
  void clear_counters(std::size_t at) noexcept;
  void count_up(std::size_t counter) noexcept;
  void latch_clocks(rt::Time now) noexcept;
  // The instant at which the frame that left the master `now` passes this slave.
  [[nodiscard]] std::int64_t passing_ns(rt::Time now) const noexcept {
    return rt::ns_of(now) + static_cast<std::int64_t>(before_) * kHop.count();
  }
  // esc_memory.cpp: sync managers
  [[nodiscard]] Area area(int i) const noexcept;
  [[nodiscard]] bool open_for(int i, const Area& a, std::size_t at, std::size_t size, bool write,
                              rt::Time now) noexcept;
  void closed(int i, const Area& a, bool write, rt::Time now) noexcept;
  [[nodiscard]] bool read_ram(std::size_t at, std::span<std::uint8_t> out, rt::Time now) noexcept;
  [[nodiscard]] bool write_ram(std::size_t at, std::span<const std::uint8_t> in,
                               rt::Time now) noexcept;
  void activate(int i, rt::Time now) noexcept;
  void serve_mailbox(rt::Time now) noexcept;
  [[nodiscard]] int manager_of(bool outputs) const noexcept;
  // esc_states.cpp
  void advance(rt::Time now) noexcept;
  void request_state(unsigned control, rt::Time now) noexcept;
  [[nodiscard]] std::uint16_t refusal(AlState to) const noexcept;
  [[nodiscard]] bool manager_matches(int i, const Area& wanted) const noexcept;
  void enter(AlState to, rt::Time now) noexcept;
  [[nodiscard]] rt::Nanos watchdog_time() const noexcept;
  [[nodiscard]] Area wanted_area(int i) const noexcept;

  EscConfig config_;
  std::vector<std::uint8_t> sii_;
  std::unique_ptr<EscApplication> application_;
  std::array<std::uint8_t, kMemory> memory_{};
  std::array<Manager, kManagers> managers_{};
  std::array<Area, kManagers> wanted_{};  // sync managers as the SII asks for them
  AlStatus al_, shown_;                   // as it is; as register 0x0130 shows it
  unsigned events_ = 0;                   // those of DL and AL status
  int looks_left_ = 0, sii_busy_ = 0;
  std::size_t before_ = 0, behind_ = 0;
  bool mailbox_needed_ = false;  // the SII names a protocol
  bool outputs_came_ = false, watchdog_good_ = true;
  rt::Time fed_{};  // watchdog
  bool request_waits_ = false;
  rt::Time request_due_{};
};

}  // namespace drivers::ethercat

// The master of a chain: finds the slaves, brings them to OP, and exchanges process data once a
// cycle.
//
//   set-up    find() -> configure() -> start(); each waits, allocates, and says in one line what is
//             wrong and with which slave.
//   cycle     exchange(): outputs out and inputs in by one frame. Or read_inputs() at the beginning
//             of a job and write_outputs() at its end: two frames. noexcept, allocates nothing,
//             waits at most `reply_timeout` for a frame; half of it for a write after a lost read,
//             so that a job of 1 ms with two lost frames ends before the next.
//   frame     LRW of the whole image (LRD and LWR where a slave forbids it), then in the same frame
//             BRD of AL status (how many slaves there are, and is one not in OP), FPRD of one
//             slave's AL status in turn (which one, and why) or a step of a recovery, and a step of
//             a mailbox transfer.
//   counter   The working counter of every cycle is held against the expected one. If it differs,
//             or the frame is lost, inputs keep their last good values.
//   stop      So many lost or short cycles in a row latch a stop: outputs are zero from then on,
//             which is "motor stop" on a youBot. recover() is the act that ends it: slaves are
//             brought back to OP with zero outputs; the latch falls when all are there. Outputs of
//             kept slaves go on as their owner writes them: an arm without brakes is held.
//   clocks    Distributed clocks are not used. The slaves' watchdog of process data is set.
// Source: ETG.1000.4 (commands, counters), ETG.1000.6 (states). One owner; no thread safety.
#pragma once

#include <vector>

#include "drivers/ethercat/mailbox.hpp"
#include "drivers/ethercat/recovery.hpp"
#include "drivers/ethercat/register_access.hpp"
#include "drivers/ethercat/slave_info.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::ethercat {

struct MasterConfig {
  rt::Nanos reply_timeout = std::chrono::microseconds{500};  // as the youBot's own driver has it
  rt::Nanos state_timeout = std::chrono::seconds{2};  // a step of a state; in recover(), a slave
  rt::Nanos period = std::chrono::milliseconds{1};    // between cycles while starting
  int bad_limit = 100;    // lost or short cycles in a row that stop; a read and a write are one
  int watchdog_ms = 100;  // of process data, in the slaves that have one; 0: as they come
};

enum class CycleStatus : std::uint8_t {
  kOk,
  kLost,      // no frame came back, or the card refused this one
  kLinkDown,  // the same, and the card has no carrier, or it refused three in a row
  kShort      // a frame came back, and its working counter is not the expected one
};
[[nodiscard]] const char* to_text(CycleStatus) noexcept;

struct CycleResult {
  CycleStatus status = CycleStatus::kLost;
  int counter = 0, expected = 0;  // working counter; of LRD and LWR in one frame: their sum
};

// Of cycles: read_inputs() with the write_outputs() after it is one, and bad once if either is.
struct BusCounters {
  std::uint64_t cycles = 0, lost = 0, link_down = 0, short_counter = 0;
  int bad_in_row = 0;
};

// What is wrong with the bus, the worst first.
enum class BusFault : std::uint8_t {
  kNone,
  kLinkDown,
  kFramesLost,
  kSlavesMissing,  // `slave`: the first that is gone, counted from 0
  kSlaveState,  // `slave` is not in OP; `al` says why. More slaves than were found: `slave` is how
                // many were, the place of the first too many if it stands last; `al` is none
  kWorkingCounter  // all are there and in OP, and the counter differs
};
[[nodiscard]] const char* to_text(BusFault) noexcept;

struct BusHealth {
  BusFault fault = BusFault::kNone;
  int slave = -1;
  AlStatus al;
  int too_many = 0;  // kSlaveState: slaves that answer and were not found
};

class Master {
 public:
  Master(rt::NonRealtime&, Port& port, const MasterConfig& config = {});

  // ---- set-up
  // A slave that can not be driven is found too, and configure() refuses: problem().
  [[nodiscard]] rt::Result<bool> find(rt::NonRealtime&);       // all in INIT
  [[nodiscard]] rt::Result<bool> configure(rt::NonRealtime&);  // all in SAFEOP
  [[nodiscard]] rt::Result<bool> start(rt::NonRealtime&);      // all in OP, outputs zero
  // The end of what start() began: outputs zero, then SAFEOP for all, or INIT if one is below it,
  // errors acknowledged. So nobody's watchdog ends it (0x001B). Waits for them, 60 ms at most;
  // without a start(), or a second time, it does nothing.
  void stop(rt::NonRealtime&) noexcept;

  [[nodiscard]] const std::vector<SlaveInfo>& slaves() const noexcept { return slaves_; }
  // Of the chain that was found: why it is not driven; empty: it is.
  [[nodiscard]] const std::string& problem() const noexcept { return problem_; }
  [[nodiscard]] const ProcessMapping& mapping() const noexcept { return mapping_; }
  [[nodiscard]] RegisterAccess& registers() noexcept { return registers_; }
  // What the frames met since this object is there, where it is 1 % of them or more: "41 of 812
  // frames were lost"; empty: less.
  [[nodiscard]] std::string losses() const;
  // "slave 3 'TMCM-1632' fell to SAFEOP + ERROR: sync manager watchdog (0x001B)"
  [[nodiscard]] std::string describe(rt::NonRealtime&, const BusHealth&) const;

  // ---- cycle
  CycleResult exchange() noexcept;
  CycleResult read_inputs() noexcept;
  CycleResult write_outputs() noexcept;
  // Slave `i`, from 0. Inputs are those of the last good cycle.
  [[nodiscard]] std::span<std::uint8_t> outputs(std::size_t i) noexcept;
  [[nodiscard]] std::span<const std::uint8_t> inputs(std::size_t i) const noexcept;
  void clear_outputs() noexcept;
  // What slave `i` is told goes on in a stop and in a recovery. Set-up.
  void keep_outputs(rt::NonRealtime&, std::size_t i) { kept_[i] = true; }

  [[nodiscard]] BusHealth health() const noexcept;
  [[nodiscard]] const BusCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] const ExchangeCounters& frames() const noexcept { return frames_.counters(); }
  // Slaves that answered the last frame that came back.
  [[nodiscard]] int present() const noexcept { return present_; }
  // As each slave was seen last; in a recovery the one at work.
  [[nodiscard]] const AlStatus& al_status(std::size_t i) const noexcept { return al_[i]; }

  [[nodiscard]] bool stopped() const noexcept { return stopped_; }
  // An operator's act. Outputs stay zero until it has succeeded, but those of kept slaves.
  void recover() noexcept;
  [[nodiscard]] bool recovering() const noexcept { return recovery_.active(); }
  // Of the last recovery: slave `i` had been without power.
  [[nodiscard]] bool began_anew(std::size_t i) const noexcept { return recovery_.began_anew(i); }

  // A mailbox request that the cycles carry; false: one is under way. Its end is in mailbox().
  bool post(std::size_t slave, std::span<const std::uint8_t> request, int patience = 200) noexcept;
  // Reads a reply that nobody waits for any more, as long as one comes; the same otherwise.
  bool post_read(std::size_t slave, int patience) noexcept;
  [[nodiscard]] const MailboxTransfer& mailbox() const noexcept { return transfer_; }

 private:
  struct Places {  // of the datagrams in the frame under way; -1: not in it
    int data = -1, write = -1, all = -1, service = -1, mailbox = -1;
  };
  enum class Half : std::uint8_t { kBoth, kRead, kWrite };
  void add_watch(Places& p) noexcept;
  CycleResult finish(const Places& p, int expected, Half h) noexcept;
  void take_watch(const Places& p) noexcept;
  void lose(const Places& p) noexcept;
  void judge(Half h, CycleStatus s) noexcept;
  void take_service(const DatagramView& d) noexcept;
  // Zeros where nothing is kept.
  void stop_outputs() noexcept;
  [[nodiscard]] std::span<const std::uint8_t> output_image() const noexcept;

  MasterConfig config_;
  RegisterAccess registers_;
  FrameExchange frames_;
  std::vector<SlaveInfo> slaves_;
  ProcessMapping mapping_;
  std::string problem_;
  std::vector<std::uint8_t> image_;  // outputs, then inputs
  std::vector<AlStatus> al_;
  std::vector<bool> kept_;  // by slave
  Recovery recovery_;
  MailboxTransfer transfer_;
  BusCounters counters_;
  CycleStatus last_ = CycleStatus::kOk;
  bool half_read_ = false;  // a read went, its write has not
  int present_ = 0;
  std::uint8_t all_states_ = 0;  // of all slaves, ORed
  std::size_t watched_ = 0;
  int refused_in_row_ = 0;  // frames that the card did not take
  bool stopped_ = false;
  bool started_ = false;  // and not ended by stop()
};

}  // namespace drivers::ethercat

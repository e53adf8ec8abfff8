// Faults of the virtual youBot as a program, as `--fault KIND[:VALUE][@FROM[-TO]]` asks for them,
// seconds after the start; from 0 unless said, to the end unless said.
//
//   of frames   lose-out, lose-back, duplicate, delay, corrupt, counter; VALUE: share of frames,
//               above 0 and at most 1. silence: all of them are swallowed, no value.
//   of the      cut, fall (to SAFEOP), i2t, stick (encoder); VALUE: slave, counted from 1. estop,
//   chain       link (the card of this program goes down): no value. At TO the cable is mended,
//               the emergency stop released, the encoder turns on, the card goes up. fall and i2t
//               end by the master's recovery and the motor's clear, and so have no TO.
//
// What a frame meets is random, with one seed: the same frames meet the same in each run.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <vector>

#include "drivers/ethercat/frame.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"
#include "rt/random.hpp"

namespace teletact {

enum class TwinFaultKind : std::uint8_t {
  kLoseOut,  // does not reach the slaves
  kLoseBack,
  kDuplicate,
  kDelay,    // by 2 ms
  kCorrupt,  // a bit of its heads
  kCounter,  // the first datagram's working counter is one too small
  kCut,      // behind the slave
  kFall,
  kI2t,
  kStick,
  kEmergencyStop,
  kSilence,
  kLink
};

struct TwinFault {
  TwinFaultKind kind = TwinFaultKind::kLoseOut;
  double share = 0;       // of frames
  std::size_t slave = 0;  // counted from 1
  double from_s = 0, to_s = std::numeric_limits<double>::infinity();
};

// Throws std::runtime_error with one line that says what is allowed.
[[nodiscard]] TwinFault parse_twin_fault(const std::string& text);

// The chain with its faults, between a frame that came and those that go back. Nothing allocates
// after construction.
class FaultyTwin {
 public:
  // Throws std::runtime_error where the chain has no such slave, or the slave no motor.
  FaultyTwin(drivers::youbot_bus::YoubotChain&, std::vector<TwinFault>);

  // Seconds of faults count from here.
  void start(rt::Time now) noexcept { begin_ = now; }

  // Faults of the chain whose time has come, or is over.
  void act(rt::Time now) noexcept;
  // A frame that came; what goes back lies there until give() has taken it.
  void take(std::span<std::uint8_t> frame, rt::Time now) noexcept;
  // The next frame that goes back by now; its length, 0: none.
  [[nodiscard]] std::size_t give(std::span<std::uint8_t> into, rt::Time now) noexcept;
  // When there is something to do without a frame that comes; at the latest `until`.
  [[nodiscard]] rt::Time next(rt::Time until) const noexcept;
  // Was this asked for at all?
  [[nodiscard]] bool has(TwinFaultKind) const noexcept;
  // Is the card of this program to be down? Whoever has the card does it.
  [[nodiscard]] bool link_down() const noexcept { return link_down_; }

 private:
  enum class Stage : std::uint8_t { kWaits, kActs, kOver };
  struct Waiting {
    std::array<std::uint8_t, drivers::ethercat::kMaxFrame> bytes{};
    std::size_t size = 0;  // 0: free
    rt::Time due{};
  };
  [[nodiscard]] rt::Time after(double seconds) const noexcept;
  [[nodiscard]] bool acts(TwinFaultKind) const noexcept;
  void begin(const TwinFault&, rt::Time now) noexcept;
  void end(const TwinFault&, rt::Time now) noexcept;
  void connect() noexcept;
  [[nodiscard]] bool meets(TwinFaultKind, rt::Time now) noexcept;
  void put(std::span<const std::uint8_t> frame, rt::Time due) noexcept;

  drivers::youbot_bus::YoubotChain& chain_;
  std::vector<TwinFault> faults_;
  std::vector<Stage> stage_;  // of those of the chain
  bool link_down_ = false;
  rt::Time begin_{};
  rt::Random random_{1};
  std::array<Waiting, 64> waiting_{};
};

}  // namespace teletact

// Faults of the virtual youBot as a program, as `--fault KIND[:VALUE][@SECONDS]` asks for them.
//
//   of frames   lose-out, lose-back, duplicate, delay, corrupt, counter; VALUE: share of frames,
//               above 0 and at most 1. From SECONDS on (0 unless said) to the end.
//   of the      cut, fall (to SAFEOP), i2t, stick (encoder); VALUE: slave, counted from 1. estop:
//   chain       no value. Once, SECONDS after the start.
//
// What a frame meets is random, with one seed: the same frames meet the same in each run.
#pragma once

#include <array>
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
  kEmergencyStop
};

struct TwinFault {
  TwinFaultKind kind = TwinFaultKind::kLoseOut;
  double share = 0;       // of frames
  std::size_t slave = 0;  // counted from 1
  double from_s = 0;
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

  // Faults of the chain whose time has come.
  void act(rt::Time now) noexcept;
  // A frame that came; what goes back lies there until give() has taken it.
  void take(std::span<std::uint8_t> frame, rt::Time now) noexcept;
  // The next frame that goes back by now; its length, 0: none.
  [[nodiscard]] std::size_t give(std::span<std::uint8_t> into, rt::Time now) noexcept;
  // When there is something to do without a frame that comes; at the latest `until`.
  [[nodiscard]] rt::Time next(rt::Time until) const noexcept;

 private:
  struct Waiting {
    std::array<std::uint8_t, drivers::ethercat::kMaxFrame> bytes{};
    std::size_t size = 0;  // 0: free
    rt::Time due{};
  };
  [[nodiscard]] rt::Time begin_of(const TwinFault&) const noexcept;
  [[nodiscard]] bool meets(TwinFaultKind, rt::Time now) noexcept;
  void put(std::span<const std::uint8_t> frame, rt::Time due) noexcept;

  drivers::youbot_bus::YoubotChain& chain_;
  std::vector<TwinFault> faults_;
  std::vector<bool> done_;
  rt::Time begin_{};
  rt::Random random_{1};
  std::array<Waiting, 64> waiting_{};
};

}  // namespace teletact

// Port onto a virtual chain in the same process: no threads, and time is the caller's. A frame
// comes back after the time that its bytes and the slaves take; receive() advances the clock to
// that instant, or to its deadline. Faults of the wire are asked for in `faults()`.
#pragma once

#include "drivers/ethercat/port.hpp"
#include "drivers/ethercat/twin/chain.hpp"
#include "rt/random.hpp"

namespace drivers::ethercat {

// Counts are of the next frames sent; each is used up frame by frame.
struct WireFaults {
  int lose_out = 0;   // does not reach the slaves
  int lose_back = 0;  // reaches them, does not come back
  int duplicate = 0;  // comes back twice
  int delay = 0;      // comes back later, by:
  rt::Nanos delay_by = std::chrono::milliseconds{2};
  int corrupt = 0;        // comes back with another bit in its heads
  int corrupt_out = 0;    // is so already on its way out: slaves behind that cable do not take it
  std::size_t cable = 1;  // of both: behind this slave; 0: at the master's card
  int wrong_counter = 0;  // the first datagram's working counter is one too small
  int refuse = 0;         // the card does not take it; its link is up
  bool link_down = false;
  std::uint64_t seed = 1;  // of the corrupted bytes
};

// What the faults above do to a frame's bytes. Damage is of what the check sequence of a real link
// would have caught: a bit of the EtherCAT header, or of the first datagram's command, index,
// address or length.
void damage_heads(std::span<std::uint8_t> frame, rt::Random&) noexcept;
void lower_counter(std::span<std::uint8_t> frame) noexcept;

class TwinPort final : public Port {
 public:
  explicit TwinPort(TwinChain& chain) noexcept : chain_(chain) {}

  [[nodiscard]] bool send(std::span<const std::uint8_t> frame) noexcept override;
  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into,
                                    rt::Time deadline) noexcept override;
  [[nodiscard]] bool link_up() noexcept override { return !faults_.link_down; }
  [[nodiscard]] rt::Time now() const noexcept override { return now_; }
  void sleep_until(rt::Time t) noexcept override { set_now(t); }

  // The caller's clock; going back is a no-op.
  void set_now(rt::Time t) noexcept { now_ = t > now_ ? t : now_; }
  [[nodiscard]] WireFaults& faults() noexcept { return faults_; }
  [[nodiscard]] TwinChain& chain() noexcept { return chain_; }
  // Thread CPU that the slaves took, if a CPU clock was given (twin time is no part of a budget).
  using CpuClock = std::int64_t (*)() noexcept;
  void set_cpu_clock(CpuClock clock) noexcept { cpu_clock_ = clock; }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept { return twin_cpu_ns_; }

 private:
  struct InFlight {
    std::array<std::uint8_t, kMaxFrame> bytes{};
    std::size_t size = 0;  // 0: free
    rt::Time arrives{};
    std::uint64_t order = 0;
  };
  void put(std::span<const std::uint8_t> frame, rt::Time arrives) noexcept;

  TwinChain& chain_;
  WireFaults faults_;
  bool link_lost_ = false;  // as the last send() found it
  rt::Time now_ = rt::time_from_ns(1'000'000'000);
  std::array<InFlight, 16> flight_{};
  InFlight work_;
  std::uint64_t order_ = 0;
  CpuClock cpu_clock_ = nullptr;
  std::int64_t twin_cpu_ns_ = 0;
};

}  // namespace drivers::ethercat

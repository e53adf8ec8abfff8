// A simulated CAN bus with TMCL modules on it, behind the port's seam. Time is that of the calls:
// frames take the time of their bits at the bus's rate, the lowest identifier goes first, a module
// answers after `think`. Nothing runs by itself and nothing allocates after construction.
#pragma once

#include <array>
#include <atomic>
#include <vector>

#include "drivers/can/can_port.hpp"
#include "drivers/can/socket_frames.hpp"
#include "drivers/can/twin/tmcl_module.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::can {

struct CanTwinFaults {
  int lose_replies = 0;        // the next ones vanish
  int double_replies = 0;      // the next ones come twice
  int corrupt = 0;             // the next frames meet a checksum error, and go again
  rt::Nanos delay_replies{0};  // all of them, as long as it stands
  bool cable_cut = false;      // nobody acknowledges: frames stay in the queue
  bool interface_down = false;
};

class CanTwinPort final : public CanPort {
 public:
  static constexpr std::size_t kQueue = 10;  // frames that the interface holds, as txqueuelen does

  CanTwinPort(rt::NonRealtime&, std::vector<TmclModule> modules, int rate_kbit_per_s = 1000,
              rt::Nanos think = std::chrono::microseconds{50});

  [[nodiscard]] int send(rt::Time now, std::span<const CanFrame>) noexcept override;
  [[nodiscard]] int receive(rt::Time now, std::span<Received>) noexcept override;
  void send_at_once(std::span<const CanFrame>) noexcept override {
    stop_all_.store(true, std::memory_order_release);
  }
  [[nodiscard]] PortState state() const noexcept override { return watch_.port; }
  [[nodiscard]] BusState bus_state() const noexcept override { return watch_.bus; }
  [[nodiscard]] const PortCounters& counters() const noexcept override { return watch_.counters; }

  // Brings the bus to `now`.
  void advance(rt::Time now) noexcept;
  [[nodiscard]] std::vector<TmclModule>& modules() noexcept { return modules_; }
  [[nodiscard]] CanTwinFaults& faults() noexcept { return faults_; }
  void bus_off() noexcept;  // the controller switches itself off; what it held is gone
  void restart() noexcept;  // as `ip link set can0 type can restart`
  [[nodiscard]] rt::Nanos busy() const noexcept { return busy_; }

 private:
  struct Waiting {
    CanFrame frame;
    rt::Time ready{};  // may go from here on
    bool from_module = false;
  };
  [[nodiscard]] int next_to_go(rt::Time at) const noexcept;
  void deliver(const Waiting&, rt::Time end) noexcept;
  void module_takes(const CanFrame&, rt::Time end) noexcept;
  void put_reply(const CanFrame&, rt::Time ready) noexcept;
  void tell(std::uint32_t id, std::uint8_t controller) noexcept;

  std::vector<TmclModule> modules_;
  double ns_per_bit_;
  rt::Nanos think_;
  CanTwinFaults faults_;
  BusWatch watch_;
  std::array<Waiting, 64> waiting_{};
  std::size_t count_ = 0;
  std::array<Received, 64> in_{};
  std::size_t arrived_ = 0;
  rt::Time free_at_{};  // the wire
  rt::Nanos busy_{0};
  std::atomic<bool> stop_all_{false};
};

}  // namespace drivers::can

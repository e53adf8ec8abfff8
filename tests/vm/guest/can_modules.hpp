// Four motor modules on a CAN interface of the guest, with motors that turn as they are told: what
// the product's CAN driver is held against. A thread above all others, as it stands for hardware.
// The socket is its own, written without the product's: a mistake there would hide on both ends.
// The motors have no inertia, so where they are at any instant is a product.
#pragma once

#include <linux/can.h>

#include <array>
#include <atomic>
#include <deque>
#include <string>
#include <thread>
#include <vector>

#include "drivers/can/twin/tmcl_module.hpp"

namespace vm {

inline constexpr int kModules = 4;
inline constexpr std::uint32_t kReplyId = 2;
// Module i has this request identifier and address byte.
constexpr std::uint32_t module_id(int i) { return static_cast<std::uint32_t>(2 * i + 1); }

// A raw socket on the interface; -1 with a line on stderr: none.
[[nodiscard]] int open_raw(const std::string& iface);
// An error frame, as a controller's driver would make it. vcan passes it on as it is.
void put_error(int raw, std::uint32_t classes, std::uint8_t controller = 0);

class CanModules {
 public:
  struct Faults {
    std::atomic<int> lose{0};         // the next replies vanish
    std::atomic<int> delay_ms{0};     // of every reply
    std::atomic<int> silent{-1};      // this module has no power
    std::atomic<bool> no_bus{false};  // the driver's controller is off: they hear nothing of it
  };
  explicit CanModules(const std::string& iface);
  ~CanModules();
  CanModules(const CanModules&) = delete;
  CanModules& operator=(const CanModules&) = delete;

  Faults faults;
  struct Motor {
    std::atomic<double> ticks{0}, ticks_per_ns{0};
    std::atomic<std::int64_t> at_ns{0};
    std::atomic<std::int64_t> stopped_ns{0};  // when it was told to stand, and turned
    std::atomic<std::uint64_t> speeds{0};     // requests to turn
    [[nodiscard]] bool turns() const noexcept { return ticks_per_ns.load() != 0; }
    [[nodiscard]] double ticks_at(std::int64_t ns) const noexcept {
      return ticks.load() + ticks_per_ns.load() * static_cast<double>(ns - at_ns.load());
    }
  };
  [[nodiscard]] const Motor& motor(int i) const { return motors_[static_cast<std::size_t>(i)]; }
  [[nodiscard]] bool any_turns() const;
  [[nodiscard]] std::uint64_t speeds() const;
  [[nodiscard]] std::uint64_t replies() const { return replies_.load(); }

 private:
  void live();
  void take(const can_frame&, std::int64_t now);
  void send_due(std::int64_t now);
  void move(std::size_t i, std::int64_t now);

  struct Due {
    std::int64_t at_ns;
    can_frame frame;
  };
  int raw_ = -1;
  std::array<drivers::can::TmclModule, kModules> modules_{};
  std::array<Motor, kModules> motors_{};
  std::deque<Due> due_;
  std::atomic<std::uint64_t> replies_{0};
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

}  // namespace vm

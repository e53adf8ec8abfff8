// Decides when the operator asks for the device's forces again. Forces never come back by
// themselves: a person presses and releases the clutch while the forces are off. A simulated person
// (of a twin) notices that the device is limp and presses the button on its base.
#pragma once

#include <chrono>
#include <utility>

#include "drivers/haptic/haptic_device.hpp"
#include "rt/time.hpp"

namespace teletact {

class ForceAct {
 public:
  explicit ForceAct(bool person_simulated) noexcept : simulated_(person_simulated) {}

  // Each tick of the haptic task, in order.
  void see(drivers::DeviceState state, bool clutch) noexcept {
    // IDLE: a device that has just been calibrated.
    off_ = state == drivers::DeviceState::kBrake || state == drivers::DeviceState::kIdle;
    if (!off_) {
      open_seen_ = pressed_ = done_ = false;
    } else if (clutch) {
      pressed_ = open_seen_;  // one that was held as the device braked is no act
    } else {
      done_ = done_ || pressed_;
      pressed_ = false;
      open_seen_ = true;
    }
  }
  // Each tick of the console. True, once an act: request_enable().
  [[nodiscard]] bool due(rt::Time now) noexcept {
    if (!simulated_) return std::exchange(done_, false);
    constexpr rt::Nanos kNotices = std::chrono::milliseconds{300};
    if (!off_) {
      since_ = rt::Time{};
    } else if (since_ == rt::Time{}) {
      since_ = now;
    } else if (now - since_ > kNotices) {
      since_ = rt::Time{};
      return true;
    }
    return false;
  }
  // The forces wait for a person's act.
  [[nodiscard]] bool waits() const noexcept { return off_ && !simulated_; }

 private:
  bool simulated_;
  bool off_ = false, open_seen_ = false, pressed_ = false, done_ = false;
  rt::Time since_{};
};

}  // namespace teletact

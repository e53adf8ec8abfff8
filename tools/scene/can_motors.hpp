// The motor bus of a scene with robot.bus.kind = "can" or "can-twin": a CAN interface, or simulated
// modules before the virtual robot.
#pragma once

#include <memory>

#include "drivers/can/twin/can_twin_bus.hpp"
#include "rt/memory/non_realtime.hpp"

namespace teletact {

struct Scene;

class CanMotors {
 public:
  // Throws std::runtime_error with one line. `robot` outlives this object.
  CanMotors(rt::NonRealtime&, const Scene&, drivers::MotorBus& robot, bool real_devices);
  [[nodiscard]] drivers::MotorBus& bus() noexcept;
  // Null: a real interface.
  [[nodiscard]] drivers::can::CanTwinBus* twin() noexcept { return twin_.get(); }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept {
    return twin_ ? twin_->twin_cpu_ns() : 0;
  }

 private:
  std::unique_ptr<drivers::can::CanPort> port_;
  std::unique_ptr<drivers::can::CanMotorBus> real_;
  std::unique_ptr<drivers::can::CanTwinBus> twin_;
};

}  // namespace teletact

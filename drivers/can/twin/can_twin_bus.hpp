// The base's wheels through a simulated CAN bus and TMCL modules to another MotorBus: the virtual
// robot. Once a job the modules' setpoints go to it, and its states to the modules.
#pragma once

#include "drivers/can/can_motor_bus.hpp"
#include "drivers/can/twin/can_twin_port.hpp"

namespace drivers::can {

class CanTwinBus final : public MotorBus {
 public:
  // `robot` outlives this object and is its.
  CanTwinBus(rt::NonRealtime&, MotorBus& robot, const CanMotorConfig& = {});

  [[nodiscard]] BusStatus sense(rt::Time now, MotorStates& states) noexcept override;
  [[nodiscard]] BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept override;
  [[nodiscard]] BusDetail detail() const noexcept override { return bus_.detail(); }
  void rearm() noexcept override;
  void make_safe() noexcept override;

  [[nodiscard]] CanTwinPort& port() noexcept { return port_; }
  [[nodiscard]] CanMotorBus& bus() noexcept { return bus_; }
  using CpuClock = std::int64_t (*)() noexcept;
  void set_cpu_clock(CpuClock clock) noexcept { cpu_clock_ = clock; }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept { return twin_cpu_ns_; }

 private:
  [[nodiscard]] static std::vector<TmclModule> modules_of(const CanMotorConfig&);
  void turn_motors(rt::Time now) noexcept;

  MotorBus& robot_;
  CanMotorConfig config_;
  CanTwinPort port_;
  CanMotorBus bus_;
  MotorStates robot_states_;
  CpuClock cpu_clock_ = nullptr;
  std::int64_t twin_cpu_ns_ = 0;
};

}  // namespace drivers::can

// The base's wheels through master, frames and virtual chain to another MotorBus: the virtual robot
// (drivers/youbot/virtual_youbot.hpp). What robot_io asks for becomes bytes, passes the virtual
// slaves and their controllers, and comes out at the other side as setpoints in rpm; its states
// come back as encoder ticks. A job reads by one frame and writes by another.
// Time is that of the calls; the chain's own clock begins with the first of them, however long
// after construction it comes. Boards that no frame reaches go on by the calls' time: their own
// watchdogs (100 ms) stop the wheels.
#pragma once

#include <memory>

#include "drivers/ethercat/twin/twin_port.hpp"
#include "drivers/youbot_bus/ethercat_motor_bus.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"

namespace drivers::youbot_bus {

class EtherCatTwinBus final : public MotorBus {
 public:
  // The chain is in OP and its flags are cleared. Throws std::runtime_error with one line. `robot`
  // outlives this object and is its.
  EtherCatTwinBus(rt::NonRealtime&, MotorBus& robot, const YoubotChainConfig& = base_alone(),
                  const MotorBusConfig& = {});
  ~EtherCatTwinBus() override;

  [[nodiscard]] BusStatus sense(rt::Time now, MotorStates& states) noexcept override;
  [[nodiscard]] BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept override;
  // Nothing of the robot's own faults.
  [[nodiscard]] BusDetail detail() const noexcept override;
  void rearm() noexcept override;
  void make_safe() noexcept override;

  [[nodiscard]] YoubotChain& chain() noexcept { return *chain_; }
  [[nodiscard]] ethercat::TwinPort& port() noexcept { return *port_; }
  [[nodiscard]] const ethercat::TwinPort& port() const noexcept { return *port_; }
  [[nodiscard]] ethercat::Master& master() noexcept { return *master_; }
  // Five slaves, commutation known.
  [[nodiscard]] static YoubotChainConfig base_alone();

 private:
  void set_clock(rt::Time now) noexcept;
  void let_boards_run() noexcept;
  class Wheels;
  class Wheel;
  std::unique_ptr<Wheels> wheels_;
  std::unique_ptr<YoubotChain> chain_;
  std::unique_ptr<ethercat::TwinPort> port_;
  std::unique_ptr<ethercat::Master> master_;
  std::unique_ptr<EtherCatMotorBus> bus_;
  bool begun_ = false;
  bool robot_ok_ = true;  // in the last half of a cycle
  rt::Nanos ahead_{};     // of the caller's clock before the chain's
};

}  // namespace drivers::youbot_bus

#include "tools/scene/can_motors.hpp"

#include "drivers/can/socket_port.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

CanMotors::CanMotors(rt::NonRealtime& nrt, const Scene& scene, drivers::MotorBus& robot,
                     bool real_devices) {
  drivers::can::CanMotorConfig config = scene.can;
  config.gear_ratio = scene.graph.robot_io.base.gear_ratio;
  if (scene.bus_kind == "can" && real_devices) {
    port_ = drivers::can::open_socket_port(
        nrt, {config.iface, drivers::can::CanMotorBus::receive_ids(config), 1 << 18});
    real_ = std::make_unique<drivers::can::CanMotorBus>(nrt, *port_, config);
    return;
  }
  twin_ = std::make_unique<drivers::can::CanTwinBus>(nrt, robot, config);
  twin_->set_cpu_clock(&rt::thread_cpu_ns);
}

drivers::MotorBus& CanMotors::bus() noexcept {
  if (real_) return *real_;
  return *twin_;
}

}  // namespace teletact

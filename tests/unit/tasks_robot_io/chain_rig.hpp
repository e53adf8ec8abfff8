// robot_io in front of the virtual robot: through the EtherCAT master and the virtual chain, over
// the simulated CAN bus, or without.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "drivers/can/twin/can_twin_bus.hpp"
#include "drivers/youbot/virtual_youbot.hpp"
#include "drivers/youbot_bus/twin/ethercat_twin_bus.hpp"
#include "rt/hash.hpp"
#include "tasks/robot_io/robot_io_task.hpp"

namespace tests {

using namespace std::chrono_literals;
using perception::Pose2;
using tasks::Mode;
namespace fault = tasks::robot_io_fault;

enum class Wire { kNone, kChain, kChainAndArm, kChainAndTwoArms, kCan };

struct Base {
  rt::Startup startup;
  tasks::RobotIoConfig config;
  drivers::VirtualYoubot robot;
  std::unique_ptr<drivers::youbot_bus::EtherCatTwinBus> wire;
  std::unique_ptr<drivers::can::CanTwinBus> can;
  drivers::MotorBus* bus = &robot;
  tasks::RobotIoTask task{startup.token(), config};
  tasks::RobotIoTask::In in;
  tasks::RobotIoTask::Out out;
  tasks::ModeMsg mode;
  drivers::RobotGoal goal;
  rt::Time now = rt::time_from_ns(1'000'000'000'000);
  rt::Hash64 hash;
  rt::Health health;
  drivers::BusStatus sent = drivers::BusStatus::kOk;
  drivers::BusDetail sent_detail;

  explicit Base(bool through_chain, const drivers::RobotPlantConfig& plant = {},
                drivers::CollisionTest collides = {})
      : Base(through_chain ? Wire::kChain : Wire::kNone, plant, std::move(collides)) {}
  explicit Base(Wire way, const drivers::RobotPlantConfig& plant = {},
                drivers::CollisionTest collides = {})
      : robot(startup.token(), {},
              drivers::RobotPlant(startup.token(), plant, {}, {}, std::move(collides))) {
    mode.mode = Mode::kEngaged;
    if (way == Wire::kChain || way == Wire::kChainAndArm || way == Wire::kChainAndTwoArms) {
      namespace yb = drivers::youbot_bus;
      yb::YoubotChainConfig chain = yb::EtherCatTwinBus::base_alone();
      yb::MotorBusConfig motors;
      if (way == Wire::kChainAndArm) {
        chain.kind = yb::ChainKind::kBaseArm;
        motors.joints = {6, 7, 8, 9, 10};
      }
      if (way == Wire::kChainAndTwoArms) {
        chain.kind = yb::ChainKind::kBaseTwoArms;
        motors.joints = {6, 7, 8, 9, 10, 12, 13, 14, 15, 16};
      }
      wire = std::make_unique<yb::EtherCatTwinBus>(startup.token(), robot, chain, motors);
      bus = wire.get();
    }
    if (way == Wire::kCan) {
      can = std::make_unique<drivers::can::CanTwinBus>(startup.token(), robot);
      bus = can.get();
    }
  }
  // As the node of robot_io does it.
  void job() {
    rt::Tick t;
    t.release = t.start = now;
    t.period = 1ms;
    in.mode = &mode;
    in.goal = goal.seq > 0 ? &goal : nullptr;
    in.link_heard = true;
    in.link_heard_at = now;
    in.sent = sent;
    in.bus = bus->sense(now, in.motors);
    const bool of_write = in.bus == drivers::BusStatus::kOk && sent != drivers::BusStatus::kOk;
    in.bus_detail = of_write ? sent_detail : bus->detail();
    health = task.step(t, in, out);
    if (out.rearm_motors) bus->rearm();
    sent = bus->act(now + 50us, out.setpoints);
    sent_detail = bus->detail();
    for (const double w : out.setpoints.wheel_rad_per_s) hash.value(w);
    for (const double w : in.motors.wheel_rad) hash.value(w);
    now += 1ms;
  }
  // A goal renewed at 10 Hz, as prediction does.
  void drive(const Pose2& p, int ms) {
    for (int i = 0; i < ms; ++i) {
      if (i % 100 == 1) send(p);
      job();
    }
  }
  void send(const Pose2& p) {
    ++goal.seq;
    goal.made = now;
    goal.valid_until = now + 300ms;
    goal.x_m = p.x;
    goal.y_m = p.y;
    goal.yaw_rad = p.yaw;
    goal.speed_limit_m_per_s = 0.5;
    goal.engaged = 1;
  }
  // The chain's own clock.
  [[nodiscard]] rt::Time twin_now() const { return wire->port().now(); }
  [[nodiscard]] const Pose2& truth() const { return robot.plant().state().X_WB; }
  [[nodiscard]] double error(const Pose2& p) const {
    return std::hypot(truth().x - p.x, truth().y - p.y);
  }
};

}  // namespace tests

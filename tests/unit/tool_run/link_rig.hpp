// Two endpoints with clocks of their own over the virtual clock's link; the robot sends states.
#pragma once

#include <gtest/gtest.h>

#include "tests/unit/drivers_link/support.hpp"
#include "tools/host/sim_link.hpp"

namespace link_rig {

using drivers::MessageId;
using teletact::SimLink;

inline constexpr std::int64_t kMs = 1'000'000;
inline constexpr std::int64_t kSecond = 1'000'000'000;

struct Rig {
  rt::Startup startup;
  drivers::LinkEndpoint op{startup.token(), rt::Box::kOperator};
  drivers::LinkEndpoint robot{startup.token(), rt::Box::kRobot};
  tasks::LinkStatus op_status, robot_status;
  rt::BoxTime op_clock, robot_clock{1000 * kSecond, 50};
  rt::Random random{3};
  std::uint64_t got = 0, bad = 0;
  SimLink link;

  explicit Rig(const drivers::LinkShapeConfig& shape = {})
      : link({&op, &op_status, {}}, {&robot, &robot_status, {1000 * kSecond, 50}}, shape, kSecond) {
    robot.add_outgoing(MessageId::kRobotState, rt::Nanos{10 * kMs}, false,
                       [this](auto out) { return encode(link_test::random_state(random), out); });
    op.add_incoming(MessageId::kRobotState, [this](auto body, rt::Time) {
      drivers::RobotState s;
      ++got;
      const bool good = decode(body, s);
      bad += good ? 0 : 1;
      return good;
    });
  }
  void run(std::int64_t to) {
    std::int64_t last = 0;
    for (std::int64_t t = link.next_host_ns(); t < to; t = link.next_host_ns()) {
      ASSERT_GE(t, last) << "an actor's time does not run back";
      last = t;
      link.act(t);
    }
  }
};

}  // namespace link_rig

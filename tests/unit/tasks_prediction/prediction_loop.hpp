// A prediction task that drives the twin of a robot across a link.
#pragma once

#include <algorithm>
#include <deque>
#include <utility>

#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/memory/section.hpp"
#include "tasks/prediction/prediction_task.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tests/unit/tasks_prediction/paths.hpp"

namespace tests {

using namespace std::chrono_literals;
using drivers::RobotGoal;
using drivers::RobotState;
using tasks::CameraPose;
using tasks::Mode;
using tasks::ModeMsg;
using tasks::PredictionConfig;
using tasks::PredictionTask;
namespace fault = tasks::prediction_fault;

// Of a desk without a camera: odometry is the world.
inline PredictionConfig wheels_alone() {
  PredictionConfig c;
  c.map_correction = false;
  return c;
}

// One desk, one robot, a link between them that takes `one_way` in each direction.
struct Loop {
  rt::Startup startup;
  PredictionConfig config;
  drivers::VirtualYoubot bus;
  tasks::RobotIoTask robot;
  PredictionTask prediction;
  tasks::RobotIoTask::In rin;
  tasks::RobotIoTask::Out rout;
  PredictionTask::In pin;
  PredictionTask::Out pout;
  ModeMsg mode;
  RobotState state;
  RobotGoal goal;
  Path path;
  CameraPose camera;
  rt::Nanos one_way;
  rt::Time now = rt::time_from_ns(3'000'000'000);
  std::deque<std::pair<rt::Time, RobotState>> up;
  std::deque<std::pair<rt::Time, RobotGoal>> down;
  rt::Health health;
  int ms = 0;
  double worst_off_path = 0, worst_tracking = 0;

  bool desk_hangs = false;  // its goals stop, the link goes on

  explicit Loop(rt::Nanos delay = 20ms, const PredictionConfig& c = wheels_alone(),
                const drivers::RobotPlantConfig& plant = {})
      : config(c),
        bus(startup.token(), {}, drivers::RobotPlant(startup.token(), plant, {}, {})),
        robot(startup.token(), {}),
        prediction(startup.token(), c),
        one_way(delay) {
    mode.mode = Mode::kEngaged;
    rin.mode = pin.mode = &mode;
    pin.delay_known = true;
    pin.round_trip = 2 * delay;
    pin.round_trip_uncertainty = 1ms;
  }
  void tick() {
    rt::Tick t;
    t.release = t.start = now;
    t.period = 1ms;
    while (!down.empty() && down.front().first <= now) {
      goal = down.front().second;
      rin.goal = &goal;
      rin.link_heard = true;
      down.pop_front();
    }
    rin.link_heard_at = now;  // an end with nothing to say says that it is alive
    {
      rt::Section section;
      rin.bus = bus.sense(now, rin.motors);
      (void)robot.step(t, rin, rout);
      rin.sent = bus.act(now, rout.setpoints);
    }
    if (ms % 20 == 0) up.emplace_back(now + one_way, rout.state);
    while (!up.empty() && up.front().first <= now) {
      state = up.front().second;
      pin.robot = &state;
      up.pop_front();
    }
    if (ms % 100 == 50 && !desk_hangs) {
      t.period = 100ms;
      {
        rt::Section section;
        health = prediction.step(t, pin, pout);
      }
      down.emplace_back(now + one_way, pout.goal);
    }
    if (path.size > 0 && rout.telemetry.driving) {
      const Pose2& x = bus.plant().state().X_WB;
      worst_off_path = std::max(worst_off_path, distance_to(path, x.x, x.y));
      worst_tracking = std::max(worst_tracking, rout.telemetry.tracking_error_m);
    }
    now += 1ms;
    ++ms;
  }
  void run(int n) {
    for (int i = 0; i < n; ++i) tick();
  }
  [[nodiscard]] const drivers::PlantState& truth() const { return bus.plant().state(); }
};

}  // namespace tests

// A fault of the motor bus, held against what every one of them has to show.
#pragma once

#include <functional>

#include "tests/unit/tasks_robot_io/chain_rig.hpp"

namespace tests {

using drivers::MotorMode;
using rt::Severity;

struct Fault {
  const char* name;
  std::function<void(Base&)> begin, end;
  rt::FaultId id;
  int within_jobs;  // until it is named
  int slave = 0, wheel = -1;
  bool lasts = true;  // it shows while the wheels are off
};

[[nodiscard]] inline bool named(const Base& b, const Fault& f) {
  return b.health.fault == f.id && b.out.bus.fault == f.id &&
         (f.slave == 0 || b.out.bus.detail.slave == f.slave) && b.out.bus.wheel == f.wheel;
}

// As supervision and the operator do it: seen, cleared while pressed, engaged.
inline void recover(Base& b, const Fault& f) {
  b.mode.mode = Mode::kSafeStop;
  for (int i = 0; i < 20; ++i) b.job();
  EXPECT_EQ(b.health.severity == Severity::kSafeStop, f.lasts) << f.name;
  f.end(b);
  b.mode.clear = true;
  int jobs = 0;
  for (; jobs < 3000 && (jobs < 20 || b.health.severity == Severity::kSafeStop); ++jobs) {
    b.job();
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kStop) << f.name;
  }
  std::printf("%-28s held again after %d ms of clear\n", f.name, jobs);
  ASSERT_LT(b.health.severity, Severity::kSafeStop) << f.name << ", fault " << b.health.fault;
  b.mode.clear = false;
  for (int i = 0; i < 100; ++i) b.job();
  b.mode.mode = Mode::kEngaged;
  b.job();
  ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity) << f.name;
  for (std::size_t w = 0; w < 4; ++w)
    EXPECT_EQ(b.out.setpoints.wheel_rad_per_s[w], b.in.motors.wheel_rad_per_s[w])
        << f.name << ": the first setpoint is no step";
  b.drive({b.out.state.x_m + 2, b.out.state.y_m, b.out.state.yaw_rad}, 1500);
  EXPECT_GT(b.robot.plant().state().v_B.vx, 0.3) << f.name << ": it drives again";
}

// While the base drives: named within its bound, wheels off in that job; motion only after an act.
inline void named_stopped_recovered(Base& b, const Fault& f) {
  b.drive({6, 0, 0}, 1500);
  ASSERT_EQ(b.health.severity, Severity::kOk) << f.name;
  f.begin(b);
  int jobs = 0, until_stop = 0;
  for (; jobs < 300 && !named(b, f); ++jobs) {
    b.job();
    if (b.out.setpoints.mode == MotorMode::kVelocity) ++until_stop;
  }
  EXPECT_LE(jobs, f.within_jobs) << f.name;
  EXPECT_EQ(b.health.severity, Severity::kSafeStop) << f.name;
  EXPECT_EQ(b.out.setpoints.mode, MotorMode::kStop) << f.name << ": in the job that names it";
  std::printf("%-28s named after %d jobs, wheels off after %d\n", f.name, jobs, until_stop + 1);
  if (!f.lasts) {
    EXPECT_GE(jobs, 100) << f.name << ": not before its time";
  }
  recover(b, f);
}

}  // namespace tests

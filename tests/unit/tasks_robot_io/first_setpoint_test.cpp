// After a stop the first setpoint that counts is what the wheels do then: judged on the wire, where
// a bus that still clears its latches takes none.
#include "drivers/youbot/motor_flags.hpp"
#include "rt/random.hpp"
#include "tests/unit/tasks_robot_io/bus_fault_rig.hpp"

namespace tests {
namespace {

using drivers::youbot_bus::ControllerMode;
using drivers::youbot_bus::DriveInputs;
using drivers::youbot_bus::DriveOutputs;

enum class Kind { kMode, kLostBus, kWheelTimeout, kSlaveFell };
constexpr int kKinds = 4;

void begin(Base& b, Kind k, rt::Random& random) {
  const auto slave = static_cast<std::size_t>(random.integer(1, 4));
  switch (k) {
    case Kind::kMode:
      b.mode.mode = Mode::kSafeStop;
      break;
    case Kind::kLostBus:
      b.wire->port().faults().lose_out = 2 * 120;
      break;
    case Kind::kWheelTimeout:
      b.wire->chain().drive(slave)->time_out(b.twin_now());
      break;
    case Kind::kSlaveFell:
      b.wire->chain().wire().slave(slave).fall(0x0050, b.twin_now());
      break;
  }
}

// The largest step of the wheels' first setpoints in this job, in rpm; negative: none takes one.
double step_rpm(Base& b) {
  double most = -1;
  for (std::size_t w = 0; w < 4; ++w) {
    DriveOutputs o;
    DriveInputs in;
    EXPECT_TRUE(decode(b.wire->master().outputs(w + 1), o));
    EXPECT_TRUE(decode(b.wire->master().inputs(w + 1), in));
    if (o.mode == ControllerMode::kVelocity)
      most = std::max(most, std::abs(static_cast<double>(o.value) - in.velocity_rpm));
  }
  return most;
}

// One stop at a random moment, cleared and engaged as fast as a person's script might. The step on
// the wire, and how long it took.
double first_step_rpm(Base& b, Kind k, rt::Random& random, int& jobs) {
  begin(b, k, random);
  const bool lost = k == Kind::kLostBus;
  for (int i = 0; i < (lost ? 130 : 2); ++i) b.job();
  EXPECT_EQ(b.out.setpoints.mode, MotorMode::kStop);
  b.mode.mode = Mode::kSafeStop;
  for (std::int64_t i = random.integer(1, 60); i > 0; --i) b.job();
  b.mode.clear = true;
  for (std::int64_t i = random.integer(1, 3); i > 0; --i) b.job();
  b.mode.clear = false;
  b.mode.mode = random.integer(0, 1) == 1 ? Mode::kHold : Mode::kEngaged;
  double step = -1;
  for (jobs = 0; jobs < 3000 && step < 0; ++jobs) {
    if (jobs % 100 == 1) b.send({random.uniform(-3, 3), random.uniform(-3, 3), 0});
    b.job();
    step = step_rpm(b);
  }
  b.mode.mode = Mode::kEngaged;
  return step;
}

TEST(RobotIoFirstSetpoint, IsNoStepOnTheWireOfAnyChain) {
  constexpr std::uint64_t kSeed = 2207;
  constexpr std::array wires{Wire::kChain, Wire::kChainAndArm, Wire::kChainAndTwoArms};
  constexpr std::array stops{500, 300, 200};  // a thousand in all
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  for (std::size_t c = 0; c < wires.size(); ++c) {
    Base b(wires[c]);
    int most_jobs = 0;
    for (int n = 0; n < stops[c]; ++n) {
      b.drive({random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3)},
              static_cast<int>(random.integer(50, 500)));
      ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity) << n;
      const auto kind = static_cast<Kind>(random.integer(0, kKinds - 1));
      int jobs = 0;
      const double step = first_step_rpm(b, kind, random, jobs);
      ASSERT_GE(step, 0) << n << ": it does not drive again, kind " << static_cast<int>(kind);
      // A word of the wire is a whole rpm.
      ASSERT_LE(step, 1) << n << ", kind " << static_cast<int>(kind) << ", after " << jobs;
      most_jobs = std::max(most_jobs, jobs);
    }
    std::printf("chain %zu: the longest way back took %d jobs\n", c, most_jobs);
  }
}

}  // namespace
}  // namespace tests

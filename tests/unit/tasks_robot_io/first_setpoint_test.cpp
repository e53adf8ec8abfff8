// After a stop the first setpoint that counts is what the wheels do then: judged on the wire, where
// a bus that still clears its latches takes none.
#include <numbers>

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

// Pressed until supervision would let the box go on, which may be while the bus still clears.
void clear(Base& b, rt::Random& random) {
  b.mode.clear = true;
  const auto least = static_cast<int>(random.integer(1, 3));
  for (int i = 0; i < least || (i < 3000 && b.health.severity == Severity::kSafeStop); ++i) b.job();
  b.mode.clear = false;
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
  clear(b, random);
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

// On CAN a module is told in its turn, by a speed that was read up to 16 jobs before; wheels that
// are off slow down by 4 m/s2 meanwhile.
TEST(RobotIoFirstSetpoint, IsNoStepOfACanModuleThatHadLatchedItsTimeout) {
  constexpr std::uint64_t kSeed = 2208;
  constexpr double kRadius_m = 0.0475, kMost_rad_per_s = 16e-3 * 4 / kRadius_m;
  constexpr double kMost_rpm = kMost_rad_per_s * 60 / (2 * std::numbers::pi) * 9405.0 / 364.0;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  Base b(Wire::kCan);
  double worst_rpm = 0;
  for (int n = 0; n < 200; ++n) {
    b.drive({b.out.state.x_m + 3, b.out.state.y_m, b.out.state.yaw_rad},
            static_cast<int>(random.integer(300, 900)));
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity) << n;
    b.can->port().modules()[static_cast<std::size_t>(random.integer(0, 3))].timed_out = true;
    for (int i = 0; i < 120 && b.health.severity != Severity::kSafeStop; ++i) b.job();
    ASSERT_EQ(b.health.severity, Severity::kSafeStop) << n;
    b.mode.mode = Mode::kSafeStop;
    for (std::int64_t i = random.integer(1, 30); i > 0; --i) b.job();
    clear(b, random);
    b.mode.mode = Mode::kEngaged;
    // Of the module that is told first: the others' wheels are dragged from then on.
    std::array<bool, 4> turned{};
    for (int i = 0; i < 400; ++i) {
      if (i % 100 == 1) b.send({b.out.state.x_m + 3, b.out.state.y_m, b.out.state.yaw_rad});
      b.job();
      const bool first = turned == std::array<bool, 4>{};
      for (std::size_t w = 0; w < 4; ++w) {
        const auto& m = b.can->port().modules()[w];
        if (m.turning && first)
          worst_rpm = std::max(worst_rpm, std::abs(static_cast<double>(m.target_rpm) - m.rpm));
        turned[w] = turned[w] || m.turning;
      }
    }
    ASSERT_TRUE(turned[0] && turned[1] && turned[2] && turned[3]) << n << ": it drives again";
  }
  std::printf("the first setpoint is at most %.0f rpm of the motor off\n", worst_rpm);
  EXPECT_LE(worst_rpm, kMost_rpm);
}

}  // namespace
}  // namespace tests

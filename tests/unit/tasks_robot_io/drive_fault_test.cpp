// Faults of the drives and of their power, and what a wire does to single frames, through robot_io.
#include "drivers/youbot/motor_flags.hpp"
#include "rt/random.hpp"
#include "tests/unit/tasks_robot_io/bus_fault_rig.hpp"

namespace tests {
namespace {

namespace flag = drivers::motor_flag;

// Over-current, under- and over-voltage, over-temperature, hall sensor, encoder, commutation,
// emergency stop: each bit by itself, at each wheel.
TEST(RobotIoDriveFault, EachFaultBitOfAMotorIsNamedWithItsWheel) {
  int bits = 0;
  for (unsigned bit = 0; bit < 16; ++bit) {
    const std::uint32_t word = 1U << bit;
    if ((word & flag::kFaults) == 0) continue;
    const int wheel = bits++ % 4;
    const auto slave = static_cast<std::size_t>(wheel + 1);
    const std::string name = "bit " + std::to_string(bit);
    const Fault f{name.c_str(),
                  [&](Base& b) { b.wire->chain().drive(slave)->set_faults(word, b.twin_now()); },
                  [&](Base& b) { b.wire->chain().drive(slave)->set_faults(0, b.twin_now()); },
                  fault::kMotorFault,
                  1,
                  0,
                  wheel};
    Base b(true);
    named_stopped_recovered(b, f);
    if (HasFatalFailure()) return;
    EXPECT_EQ(b.out.bus.fault, rt::kNoFault) << name;
  }
  EXPECT_EQ(bits, 8);
}

TEST(RobotIoDriveFault, TheWordOfTheFaultIsTold) {
  constexpr std::uint32_t kHeatAndHall = 1U << 3U | 1U << 5U;
  Base b(true);
  b.drive({6, 0, 0}, 500);
  b.wire->chain().drive(2)->set_faults(kHeatAndHall, b.twin_now());
  b.job();
  EXPECT_EQ(b.out.bus.fault, fault::kMotorFault);
  EXPECT_EQ(b.out.bus.flags & flag::kFaults, kHeatAndHall);
}

// On a robot the commutation comes back by `teletact youbot setup`, as finding it moves the wheel.
TEST(RobotIoDriveFault, LostCommutationIsNamedWithItsSlave) {
  const Fault f{"lost commutation",
                [](Base& b) { b.wire->chain().drive(4)->set_commutated(false, b.twin_now()); },
                [](Base& b) { b.wire->chain().drive(4)->set_commutated(true, b.twin_now()); },
                fault::kNotCommutated,
                1,
                5};
  Base b(true);
  named_stopped_recovered(b, f);
}

// No clear brings it back, and no setpoint makes the wheel look for it.
TEST(RobotIoDriveFault, AClearDoesNotFindTheCommutation) {
  Base b(true);
  b.drive({6, 0, 0}, 500);
  b.wire->chain().drive(4)->set_commutated(false, b.twin_now());
  b.job();
  b.mode.mode = Mode::kSafeStop;
  b.mode.clear = true;
  for (int i = 0; i < 1000; ++i) {
    b.job();
    ASSERT_EQ(b.health, rt::Health::of(Severity::kSafeStop, fault::kNotCommutated)) << i;
    ASSERT_EQ(b.out.setpoints.mode, MotorMode::kStop) << i;
  }
}

TEST(RobotIoDriveFault, ATimeoutOfOneMotorIsNamedWithItsWheel) {
  const Fault f{"timeout of one drive",
                [](Base& b) { b.wire->chain().drive(3)->time_out(b.twin_now()); },
                [](Base&) {},
                fault::kMotorTimeout,
                1,
                0,
                2};
  Base b(true);
  named_stopped_recovered(b, f);
}

// The emergency stop of the platform takes the drives' power: behind the first board nobody
// answers. When it is released they begin anew, with encoders that count from 0.
TEST(RobotIoDriveFault, TheEmergencyStopOfTheChain) {
  const Fault f{"emergency stop of the chain",
                [](Base& b) { b.wire->chain().emergency_stop(); },
                [](Base& b) { b.wire->chain().release_emergency_stop(b.twin_now()); },
                fault::kSlavesMissing,
                1,
                2};
  Base b(true);
  named_stopped_recovered(b, f);
}

// Released, and nothing else: no motion.
TEST(RobotIoDriveFault, AReleasedEmergencyStopIsNoAct) {
  Base b(true);
  b.drive({6, 0, 0}, 1500);
  b.wire->chain().emergency_stop();
  for (int i = 0; i < 300; ++i) b.job();
  b.wire->chain().release_emergency_stop(b.twin_now());
  b.drive({6, 0, 0}, 2000);
  EXPECT_EQ(b.health.severity, Severity::kSafeStop);
  EXPECT_EQ(b.out.setpoints.mode, MotorMode::kStop);
  EXPECT_LT(std::abs(b.robot.plant().state().v_B.vx), 1e-3);
}

// ---- single frames

enum class Harm { kDelayed, kDoubled, kDamaged };

void harm(Base& b, Harm what, int frames) {
  auto& f = b.wire->port().faults();
  (what == Harm::kDelayed ? f.delay : what == Harm::kDoubled ? f.duplicate : f.corrupt) = frames;
}

// One frame that is late or damaged: counted in its job, by name, and the base drives on. A frame
// that comes twice is known by its number, and no fault.
TEST(RobotIoFrames, ALateADoubledADamagedFrameIsCountedInItsJob) {
  for (const Harm what : {Harm::kDelayed, Harm::kDoubled, Harm::kDamaged}) {
    int told = 0;
    Base b(true);
    b.drive({6, 0, 0}, 500);
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
      b.wire->port().faults().seed = seed;
      harm(b, what, 1);
      b.drive({6, 0, 0}, 1);
      const bool single =
          b.health.fault == fault::kFrameLost || b.health.fault == fault::kWorkingCounter;
      ASSERT_LE(b.health.severity, Severity::kCounted) << "fault " << b.health.fault;
      told += single ? 1 : 0;
      ASSERT_EQ(b.out.setpoints.mode, MotorMode::kVelocity);
      b.drive({6, 0, 0}, 20);
      ASSERT_EQ(b.health.severity, Severity::kOk) << "seed " << seed;
    }
    std::printf("kind %d: %d of 40 told\n", static_cast<int>(what), told);
    // Some bytes of a frame's heads mean nothing to its reader: then nothing is wrong.
    if (what == Harm::kDamaged)
      EXPECT_GE(told, 35);
    else
      EXPECT_EQ(told, what == Harm::kDoubled ? 0 : 40);
    EXPECT_EQ(b.out.telemetry.frames_lost, static_cast<std::uint64_t>(told));
    EXPECT_NEAR(b.out.state.x_m, b.truth().x, 1e-3);
  }
}

// As many of them as are a bus that is down.
TEST(RobotIoFrames, ManyLateOrDamagedFramesInARowStop) {
  for (const Harm what : {Harm::kDelayed, Harm::kDamaged}) {
    Base b(true);
    b.drive({6, 0, 0}, 1000);
    harm(b, what, 1000);
    int jobs = 0;
    for (; jobs < 150 && b.health.severity != Severity::kSafeStop; ++jobs) b.job();
    EXPECT_EQ(jobs, b.config.frames_lost_limit);
    EXPECT_EQ(b.health.fault, fault::kBusDown);
    EXPECT_EQ(b.out.setpoints.mode, MotorMode::kStop);
  }
}

// A wire that doubles every frame costs nothing.
TEST(RobotIoFrames, AWireThatDoublesEveryFrame) {
  Base b(true);
  harm(b, Harm::kDoubled, 100'000);
  b.drive({1, 0, 0}, 5000);
  EXPECT_EQ(b.out.telemetry.frames_lost, 0U);
  EXPECT_LE(b.error({1, 0, 0}), 0.005);
}

}  // namespace
}  // namespace tests

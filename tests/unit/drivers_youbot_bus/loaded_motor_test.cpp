// One virtual motor with its load against closed forms. Units SI, at the motor's shaft.
#include "drivers/youbot_bus/twin/loaded_motors.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tests {
namespace {

using namespace std::chrono_literals;
namespace yb = drivers::youbot_bus;

constexpr double kRpm = 2 * std::numbers::pi / 60;  // rad/s
constexpr double kTorque = 0.0335;                  // Nm/A

yb::LoadedDriveConfig free_motor() {
  yb::LoadedDriveConfig c;
  c.rotor_kg_m2 = 4e-5;
  c.torque_Nm_per_A = kTorque;
  c.gear = 100;
  c.control.velocity_limit_rpm = 20000;
  return c;
}

struct OneMotor {
  explicit OneMotor(const yb::LoadedDriveConfig& c) : all(startup.token(), {c}, std::nullopt) {
    (void)all.motion(0, now);
  }
  void tell(yb::ControllerMode mode, double value) { all.command(0, {mode, value}, now); }
  yb::MotorMotion after(rt::Nanos t) { return all.motion(0, now += t); }
  double speed(rt::Nanos t) { return after(t).velocity_rpm * kRpm; }
  double output() { return all.output_rad(0, now); }
  rt::Startup startup;
  yb::LoadedMotors all;
  rt::Time now = rt::time_from_ns(5'000'000'000);
};

TEST(LoadedMotor, FreeAcceleration) {
  auto c = free_motor();
  c.load_kg_m2 = 0.2;
  OneMotor m(c);
  m.tell(yb::ControllerMode::kCurrent, 1000);
  const double a = kTorque / (4e-5 + 0.2 / 1e4);
  for (int i = 1; i <= 10; ++i) {
    const auto at = m.after(50ms);
    const double t = 0.05 * i;
    EXPECT_NEAR(at.velocity_rpm * kRpm, a * t, 1e-9 * a);
    EXPECT_NEAR(at.position_ticks * 2 * std::numbers::pi / 4000, a * t * t / 2, 1e-9 * a);
    EXPECT_EQ(at.current_mA, 1000);
  }
}

TEST(LoadedMotor, TheCurrentComesByALag) {
  auto c = free_motor();
  c.current_loop_s = 0.01;
  OneMotor m(c);
  m.tell(yb::ControllerMode::kCurrent, 1000);
  const double a = kTorque / 4e-5;
  for (int i = 1; i <= 10; ++i) {
    const auto at = m.after(5ms);
    const double t = 0.005 * i, fall = std::exp(-t / 0.01);
    EXPECT_NEAR(at.current_mA, 1000 * (1 - fall), 1e-6);
    // The current of a step's end drives the whole step: half a step ahead.
    EXPECT_NEAR(at.velocity_rpm * kRpm, a * (t - 0.01 * (1 - fall)), a * 1e-4);
  }
}

TEST(LoadedMotor, TheSpeedThatALimitedCurrentHolds) {
  auto c = free_motor();
  c.current_limit_A = 0.5;
  c.viscous_Nm_s = 1e-4;
  OneMotor m(c);
  m.tell(yb::ControllerMode::kVelocity, 10000);
  const double top = kTorque * 0.5 / 1e-4;
  double t = 0;
  for (int i = 0; i < 20; ++i) {
    const auto at = m.after(100ms);
    t += 0.1;
    EXPECT_NEAR(at.velocity_rpm * kRpm, top * (1 - std::exp(-t * 1e-4 / 4e-5)), 2e-4 * top);
    EXPECT_NEAR(at.current_mA, 500, 1e-9);
  }
  // A speed within its reach is held, by the current that friction takes.
  m.tell(yb::ControllerMode::kVelocity, 600);
  const auto held = m.after(2s);
  EXPECT_NEAR(held.velocity_rpm, 600, 0.01);
  EXPECT_NEAR(held.current_mA, 1e3 * 600 * kRpm * 1e-4 / kTorque, 0.1);
}

TEST(LoadedMotor, FrictionSlowsItDownAndHoldsIt) {
  auto c = free_motor();
  c.coulomb_Nm = 0.004;
  c.viscous_Nm_s = 5e-5;
  OneMotor m(c);
  // Below the friction nothing moves.
  m.tell(yb::ControllerMode::kCurrent, 1e3 * 0.0039 / kTorque);
  EXPECT_EQ(m.after(1s).position_ticks, 0);
  m.tell(yb::ControllerMode::kCurrent, 2000);
  const double w0 = m.speed(200ms);
  m.tell(yb::ControllerMode::kStop, 0);
  const double b = 5e-5, cf = 0.004, J = 4e-5;
  const double stands = J / b * std::log(1 + w0 * b / cf);
  double t = 0;
  while (t + 0.01 < stands) {
    const double w = m.speed(10ms);
    t += 0.01;
    ASSERT_NEAR(w, (w0 + cf / b) * std::exp(-b * t / J) - cf / b, 2e-4 * w0) << t;
  }
  const auto at_rest = m.after(20ms);
  EXPECT_EQ(at_rest.velocity_rpm, 0);
  EXPECT_EQ(m.after(5s).position_ticks, at_rest.position_ticks);
  EXPECT_EQ(at_rest.current_mA, 0);
}

TEST(LoadedMotor, MotorStopCoastsOrBrakes) {
  for (const bool brakes : {false, true}) {
    auto c = free_motor();
    c.brakes = brakes;
    OneMotor m(c);
    m.tell(yb::ControllerMode::kVelocity, 1000);
    EXPECT_NEAR(m.after(1s).velocity_rpm, 1000, 0.01);
    m.tell(yb::ControllerMode::kStop, 0);
    EXPECT_NEAR(m.after(1s).velocity_rpm, brakes ? 0 : 1000, 0.01);
  }
}

TEST(LoadedMotor, PlayMakesTheOutputLagByTheGapOnReversal) {
  auto c = free_motor();
  c.load_kg_m2 = 0.05;
  c.gap_rad = 0.01;
  c.load_coulomb_Nm = 0.5;
  OneMotor m(c);
  const auto shaft = [&] {  // of the rotor, at the output
    return m.all.motion(0, m.now).position_ticks * 2 * std::numbers::pi / 4000 / 100;
  };
  m.tell(yb::ControllerMode::kVelocity, 10);  // 0.0105 rad/s at the output
  (void)m.after(3s);
  EXPECT_NEAR(m.output(), shaft() - 0.005, 1e-12) << "the load follows the forward flank";
  m.tell(yb::ControllerMode::kVelocity, -10);
  (void)m.after(50ms);  // the loop turns round
  const double turned = shaft(), left = m.output();
  double crossed = 0;
  while (turned - shaft() < 0.0098) {
    (void)m.after(1ms);
    if (shaft() > m.output() - 0.0049) crossed = std::abs(m.output() - left);
  }
  EXPECT_LT(crossed, 1e-5) << "it stands while the gap is crossed";
  (void)m.after(1s);
  EXPECT_NEAR(m.output(), shaft() + 0.005, 1e-12) << "and follows the other flank";
}

TEST(LoadedMotor, TimeToTripAndCoolingDown) {
  auto c = free_motor();
  c.rated_A = 1;
  c.thermal_s = 2;
  c.viscous_Nm_s = 1e-3;
  for (const double amps : {-2.0, 1.5, 3.0}) {
    OneMotor m(c);
    m.tell(yb::ControllerMode::kCurrent, 1e3 * amps);
    const double limit = -2 * std::log(1 - 1 / (amps * amps));
    const rt::Time begin = m.now;
    rt::Time when{};
    EXPECT_FALSE(m.all.take_trip(0, begin + rt::nanos_from_seconds(limit - 0.001), when));
    ASSERT_TRUE(m.all.take_trip(0, begin + rt::nanos_from_seconds(limit + 0.001), when));
    EXPECT_NEAR(rt::seconds(when - begin), limit, 1.1e-4);
    EXPECT_FALSE(m.all.take_trip(0, begin + 5s, when)) << "once";
    m.now = begin + 5s;
    EXPECT_EQ(m.after(1ms).current_mA, 0);
    EXPECT_NEAR(m.all.heat_A2(0), std::exp(-(5.001 - limit) / 2), 1e-3);
  }
  OneMotor m(c);
  m.tell(yb::ControllerMode::kCurrent, 999);
  rt::Time when{};
  for (int i = 0; i < 60; ++i) EXPECT_FALSE(m.all.take_trip(0, m.now += 1s, when));
}

TEST(LoadedMotor, EndsOfTravelStopTheLoad) {
  for (const double gap : {0.0, 0.002}) {
    auto c = free_motor();
    c.gap_rad = gap;
    c.high_stop_rad = 0.5;
    c.low_stop_rad = -0.1;
    c.current_limit_A = 3;
    OneMotor m(c);
    m.tell(yb::ControllerMode::kVelocity, 500);
    const auto stalled = m.after(3s);
    EXPECT_NEAR(m.output(), 0.5, 1e-12);
    EXPECT_EQ(stalled.velocity_rpm, 0);
    EXPECT_EQ(stalled.current_mA, 3000);
    m.tell(yb::ControllerMode::kVelocity, -500);
    (void)m.after(3s);
    EXPECT_NEAR(m.output(), -0.1, 1e-12);
  }
}

// Who asks, and how often, changes nothing.
TEST(LoadedMotor, MotionDoesNotDependOnWhoAsks) {
  auto c = free_motor();
  c.gap_rad = 0.001;
  c.coulomb_Nm = 0.002;
  c.current_loop_s = 0.0005;
  OneMotor often(c), seldom(c);
  for (int i = 0; i < 200; ++i) {
    const double rpm = 100 * std::sin(0.1 * i);
    often.tell(yb::ControllerMode::kVelocity, rpm);
    seldom.tell(yb::ControllerMode::kVelocity, rpm);
    for (int k = 0; k < 37; ++k) (void)often.after(rt::Nanos{100'000});
    (void)often.after(rt::Nanos{1'300'000});
    const auto b = seldom.after(5ms);
    EXPECT_EQ(often.after(0ms).position_ticks, b.position_ticks);
  }
}

}  // namespace
}  // namespace tests

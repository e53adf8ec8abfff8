// Set-up of a youBot: what a check reads, commutation, the arm's homing, a joint's limits.
#include "drivers/youbot_bus/youbot_setup.hpp"

#include <cmath>
#include <numbers>

#include "tests/unit/drivers_youbot_bus/bus_rig.hpp"

namespace tests {
namespace {

// The truth at the motors themselves, which the boards never say.
struct SetupRig : BusRig {
  explicit SetupRig(yb::ChainKind kind, yb::Generation g = yb::Generation::kNew)
      : BusRig(config(kind, g)), session(startup.token(), master, port, kind) {
    bring_up();
  }
  static yb::YoubotChainConfig config(yb::ChainKind kind, yb::Generation g) {
    yb::YoubotChainConfig c;
    c.kind = kind;
    c.generation = g;
    c.end_stops = true;
    return c;
  }
  double true_ticks(std::size_t i) {
    return chain.drive(i)->motor().motion(port.now()).position_ticks;
  }
  double travelled() {
    double sum = 0;
    for (const std::size_t i : session.drives()) sum += std::abs(true_ticks(i) - before[i]);
    return sum;
  }
  void remember() {
    before.assign(session.boards().size(), 0);
    for (const std::size_t i : session.drives()) before[i] = true_ticks(i);
  }
  yb::DriveSession session;
  std::vector<double> before;
  std::vector<std::string> said;
  yb::Progress say = [this](const std::string& s) { said.push_back(s); };
};

// Where each stop of the virtual arm is (twin/youbot_chain.cpp).
double stop_ticks(int joint) { return 1234.0 * joint; }
constexpr std::array<double, 5> kGear{156, 156, 100, 71, 71};

TEST(YoubotSetup, CheckReadsAndMovesNothing) {
  for (const auto kind : yb::kChainKinds) {
    SetupRig rig(kind);
    rig.remember();
    const auto reports = yb::check(rig.session);
    ASSERT_TRUE(reports) << reports.error();
    EXPECT_EQ(reports.value().size(), rig.session.drives().size());
    for (const auto& r : reports.value()) {
      EXPECT_FALSE(r.commutated);
      EXPECT_NE(r.wrong.find("no commutation"), std::string::npos);
      EXPECT_NEAR(r.supply_V, 24, 1e-9);
      EXPECT_NEAR(r.temperature_C, 25, 1);
      EXPECT_EQ(r.firmware.version, 200);
    }
    EXPECT_EQ(rig.travelled(), 0);
  }
}

TEST(YoubotSetup, HomingFindsEachStopToATenthOfADegree) {
  for (const auto g : {yb::Generation::kOld, yb::Generation::kNew}) {
    SetupRig rig(yb::ChainKind::kBaseArm, g);
    const auto found = yb::commutate(rig.session, rig.say);
    ASSERT_TRUE(found) << found.error();
    const auto homed = yb::home_arm(rig.session, 1, rig.say);
    ASSERT_TRUE(homed) << homed.error();
    EXPECT_EQ(rig.said.size(), 6U);
    for (int j = 1; j <= 5; ++j) {
      const auto i = static_cast<std::size_t>(5 + j);
      const double zero = rig.true_ticks(i) - rig.session.inputs(i).position_ticks;
      const double off_deg =
          360 * (zero - stop_ticks(j)) / 4000 / kGear[static_cast<std::size_t>(j - 1)];
      EXPECT_LE(std::abs(off_deg), 0.1) << "joint " << j;
    }
    const auto after = yb::check(rig.session);
    ASSERT_TRUE(after) << after.error();
    for (const auto& r : after.value()) EXPECT_EQ(r.wrong, "") << r.name;
    // A second commutation moves nothing: every drive knows it.
    rig.remember();
    ASSERT_TRUE(yb::commutate(rig.session, rig.say));
    EXPECT_LT(rig.travelled(), 5);
  }
}

// A joint that finds no stop is named, and the arm holds.
TEST(YoubotSetup, AStuckEncoderOrALostBusEndsHomingByName) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  ASSERT_TRUE(yb::commutate(rig.session, rig.say));
  rig.port.faults().lose_out = 1'000'000;
  const auto lost = yb::home_arm(rig.session, 1, rig.say);
  ASSERT_FALSE(lost);
  EXPECT_NE(lost.error().find("the bus has failed"), std::string::npos) << lost.error();
  EXPECT_FALSE(yb::home_arm(rig.session, 2, rig.say));
}

TEST(YoubotSetup, JogMovesOneDriveAndAJointStopsAtItsLimit) {
  SetupRig rig(yb::ChainKind::kBaseArm);
  ASSERT_TRUE(yb::commutate(rig.session, rig.say));
  const auto early = yb::jog(rig.session, 6, 0.1, 1);
  ASSERT_FALSE(early);
  EXPECT_NE(early.error().find("not homed"), std::string::npos);
  ASSERT_TRUE(yb::home_arm(rig.session, 1, rig.say));
  rig.remember();
  const auto wheel = yb::jog(rig.session, 1, 2.0, 1.0);
  ASSERT_TRUE(wheel) << wheel.error();
  const double turned = (rig.true_ticks(1) - rig.before[1]) / 4000 * 2 * std::numbers::pi / 25.838;
  EXPECT_NEAR(turned, 2.0, 0.02);
  EXPECT_LT(rig.travelled() - std::abs(rig.true_ticks(1) - rig.before[1]), 50) << "nobody else";
  // Joint 4 away from its stop: positive angles are negative ticks.
  const auto away = yb::jog(rig.session, 9, 0.5, 1.0);
  ASSERT_TRUE(away) << away.error();
  EXPECT_NEAR(rig.session.inputs(9).position_ticks, -0.5 / (2 * std::numbers::pi) * 71 * 4000, 300);
  const auto back = yb::jog(rig.session, 9, -0.5, 5.0);
  ASSERT_FALSE(back);
  EXPECT_NE(back.error().find("limit"), std::string::npos);
  EXPECT_LE(rig.session.inputs(9).position_ticks, yb::joint_facts(4).high_ticks + 20);
  EXPECT_LT(rig.true_ticks(9), stop_ticks(4)) << "it never saw the stop";
}

}  // namespace
}  // namespace tests

// The device's motion made smaller and turned while the haptic task runs: the hand in the scene
// does not leap, the force has no step, and afterwards both are as they were asked for.
#include "tools/desk/page_hand.hpp"

#include <gtest/gtest.h>

#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace {

using perception::Vec3;
using teletact::PageHand;

class Stick final : public drivers::HapticDevice {
 public:
  [[nodiscard]] drivers::DeviceProperties properties() const noexcept override { return {}; }
  [[nodiscard]] bool sense(rt::Time, drivers::StylusSample& out) noexcept override {
    out.p_DH = p_D;
    out.clutch = false;
    out.state = state;
    return true;
  }
  void act(rt::Time, const drivers::ForceCommand& command) noexcept override {
    f_D = command.f_H_D;
  }
  void request_enable() noexcept override {}
  void make_safe() noexcept override {}
  Vec3 p_D{0, 0, 0}, f_D{0, 0, 0};
  drivers::DeviceState state = drivers::DeviceState::kForce;
};

// Device, page's hand and task at 1 kHz over a floor at z = 0.
class Loop {
 public:
  explicit Loop(rig::Scene scene) : rig_(std::move(scene)), hand(startup_.token(), stick) {
    hand.bind(rig_.task());
  }
  struct Tick {
    Vec3 p_WH, f_D;  // the hand in the scene, the force at the device
    bool clutch = false;
  };
  Tick tick(const Vec3& p_D) {
    const rt::Time now = rig_.now();
    stick.p_D = p_D;
    drivers::StylusSample sample;
    EXPECT_TRUE(hand.sense(now, sample));
    rig_.in().clutch = sample.clutch;
    static_cast<void>(rig_.tick(sample.p_DH));
    hand.act(now, rig_.out().force);
    return {rig_.out().state.p_WH, stick.f_D, sample.clutch};
  }
  [[nodiscard]] rt::Time now() const { return rig_.now(); }

 private:
  rt::Startup startup_;
  rig::Rig rig_;

 public:
  Stick stick;
  PageHand hand;
};

rig::Scene floor_scene(double scale) {
  rig::Scene s;
  s.solid = [](const Vec3& p, double) { return solids::floor(p); };
  s.config.scale = scale;
  return s;
}

// Slow circles in the air, 8 cm above the floor of a scene of scale 2.
Vec3 in_the_air(int k) {
  const double t = 1e-3 * k;
  return {0.03 * std::cos(2 * t), 0.03 * std::sin(2 * t), 0.04};
}

TEST(PageHand, WithNothingAskedForAllPassesAsItIs) {
  Loop loop(floor_scene(1));
  for (int k = 0; k < 300; ++k) {
    const Vec3 p = Vec3(0.01, 0.02, 0.01 - 6e-5 * k);
    const auto t = loop.tick(p);
    EXPECT_EQ(t.p_WH, p);
    EXPECT_FALSE(t.clutch);
  }
  EXPECT_GT(loop.stick.f_D.z(), 1.0) << "it is pressed, and the force reaches the device";
}

TEST(PageHand, AnotherScaleAndTurnNeverMakeTheHandLeap) {
  constexpr double kScale = 2;
  Loop loop(floor_scene(kScale));
  int k = 0;
  auto last = loop.tick(in_the_air(k));
  for (; k < 200; ++k) last = loop.tick(in_the_air(k));
  ASSERT_TRUE(loop.hand.map({0.5, 0.7}, loop.now()));
  int clutched = 0;
  for (const int end = k + 2000; k < end; ++k) {
    const auto t = loop.tick(in_the_air(k));
    const Vec3 moved_W = t.p_WH - last.p_WH;
    const double way_m = (in_the_air(k) - in_the_air(k - 1)).norm();
    if (t.clutch) {
      EXPECT_LE(moved_W.norm(), 1e-12) << k;
    } else {
      EXPECT_NEAR(moved_W.norm(), loop.hand.share() * kScale * way_m, 1e-12) << k;
    }
    EXPECT_EQ(t.f_D, Vec3(0, 0, 0));
    clutched += t.clutch ? 1 : 0;
    last = t;
  }
  EXPECT_EQ(loop.hand.share(), 0.5);
  EXPECT_GT(clutched, 100) << "the force had time to fade";
  EXPECT_LT(clutched, 1500) << "and then it is let go";
  EXPECT_FALSE(last.clutch);
  // A metre ahead at the device: half of scale 2, to where the page looks.
  const auto from = loop.tick(Vec3(0, 0, 0.04)), to = loop.tick(Vec3(1e-4, 0, 0.04));
  const Vec3 ahead_W = to.p_WH - from.p_WH;
  EXPECT_NEAR(ahead_W.x(), 1e-4 * std::cos(0.7), 1e-12);
  EXPECT_NEAR(ahead_W.y(), 1e-4 * std::sin(0.7), 1e-12);
}

// Pressed into the floor with 6 N: the force fades, the mapping changes, the force comes back.
TEST(PageHand, InContactTheForceHasNoStep) {
  Loop loop(floor_scene(1));
  const Vec3 pressed(0.02, 0, -0.006);
  for (int k = 0; k < 260; ++k)
    static_cast<void>(loop.tick(Vec3(0.02, 0, std::max(-0.006, 0.01 - 1e-4 * k))));
  Vec3 force_D = loop.stick.f_D;
  ASSERT_NEAR(force_D.norm(), 6, 0.1);
  const Vec3 hand_W = loop.tick(pressed).p_WH;
  ASSERT_TRUE(loop.hand.map({0.25, 1.5}, loop.now()));
  bool off = false;
  for (int k = 0; k < 1500; ++k) {
    const auto t = loop.tick(pressed);
    EXPECT_LE((t.p_WH - hand_W).norm(), 1e-12) << k;
    EXPECT_LE((t.f_D - force_D).norm(), 0.3 + 1e-9) << k;
    EXPECT_LE(t.f_D.norm(), 12.0);
    // What changes the mapping finds no force.
    if (loop.hand.share() != 1 && !off) {
      off = true;
      EXPECT_LT(force_D.norm(), 0.02);
    }
    force_D = t.f_D;
  }
  EXPECT_TRUE(off);
  EXPECT_NEAR(force_D.norm(), 6, 0.1) << "as deep as before in the scene";
  EXPECT_GT(force_D.z(), 5.9) << "up is up, however the hand is turned";
}

// The force of a surface that stands is felt against the way into it, at the device as well.
TEST(PageHand, TheForceIsTurnedBackToTheDevice) {
  rig::Scene wall = floor_scene(1);
  wall.solid = [](const Vec3& p, double) { return -p.x(); };  // free at x < 0
  wall.config.workspace_W_m = {-0.02, 0, 0};
  Loop loop(std::move(wall));
  for (int k = 0; k < 50; ++k) static_cast<void>(loop.tick(Vec3::Zero()));
  ASSERT_TRUE(loop.hand.map({1.0, std::numbers::pi / 2}, loop.now()));
  for (int k = 0; k < 1000; ++k) static_cast<void>(loop.tick(Vec3::Zero()));
  // "Ahead" at the device is y of W now; x of W is to the right, -y.
  for (int k = 0; k < 400; ++k)
    static_cast<void>(loop.tick(Vec3(0, std::max(-0.024, -1e-4 * k), 0)));
  EXPECT_NEAR(loop.stick.f_D.y(), 4, 0.2) << loop.stick.f_D.transpose();
  EXPECT_NEAR(loop.stick.f_D.x(), 0, 0.05);
}

// A press of the clutch while the forces are off asks for them: never from the page.
TEST(PageHand, WithTheForcesOffNoPressBegins) {
  Loop loop(floor_scene(1));
  loop.stick.state = drivers::DeviceState::kBrake;
  loop.hand.hold_clutch(true);
  ASSERT_TRUE(loop.hand.map({0.5, {}}, loop.now()));
  for (int k = 0; k < 300; ++k) EXPECT_FALSE(loop.tick(in_the_air(k)).clutch);
  loop.hand.hold_clutch(false);
  for (int k = 300; k < 310; ++k) EXPECT_FALSE(loop.tick(in_the_air(k)).clutch);
  EXPECT_EQ(loop.hand.share(), 1);
  // The person has asked for them again.
  loop.stick.state = drivers::DeviceState::kForce;
  EXPECT_TRUE(loop.tick(in_the_air(310)).clutch);
  // Braked in the midst: it is held to the end of the change, and let go.
  loop.stick.state = drivers::DeviceState::kBrake;
  bool clutch = true;
  for (int k = 311; k < 2000; ++k) {
    const bool now = loop.tick(in_the_air(k)).clutch;
    EXPECT_FALSE(now && !clutch) << "no second press";
    clutch = now;
  }
  EXPECT_FALSE(clutch);
  EXPECT_EQ(loop.hand.share(), 0.5);
}

TEST(PageHand, OutOfRangeNothingChanges) {
  Loop loop(floor_scene(1));
  EXPECT_FALSE(loop.hand.map({1.01, {}}, loop.now()));
  EXPECT_FALSE(loop.hand.map({0.1, {}}, loop.now()));
  EXPECT_FALSE(loop.hand.map({std::numeric_limits<double>::quiet_NaN(), {}}, loop.now()));
  EXPECT_FALSE(loop.hand.map({0.5, std::numeric_limits<double>::infinity()}, loop.now()));
  for (int k = 0; k < 500; ++k) EXPECT_FALSE(loop.tick(in_the_air(k)).clutch);
  EXPECT_EQ(loop.hand.share(), 1);
}

}  // namespace

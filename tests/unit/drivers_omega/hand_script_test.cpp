#include "drivers/haptic/hand_script.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "drivers/omega/omega_twin.hpp"
#include "rt/memory/section.hpp"
#include "rt/random.hpp"

namespace {

using namespace std::chrono_literals;
using drivers::HandScript;
using drivers::HandScriptConfig;
using drivers::HandTarget;
using drivers::WorkspaceMap;
using perception::Vec3;

HandScriptConfig load(const std::string& text) {
  HandScriptConfig c;
  config::Section root;
  c.describe(root.section("hand"));
  const auto ok = config::load_text(text, "test.toml", root);
  EXPECT_TRUE(ok.has_value()) << (ok ? "" : ok.error());
  return c;
}

const char* const kTour = R"(
[hand]
start_after_s = 0.5
start_m = [0, 0, 0.05]
[[hand.segment]]
kind = "move"
point_m = [0.1, 0, 0]
normal = [0, 0, 0.5]
standoff_m = 0.03
time_s = 1.0
[[hand.segment]]
kind = "press"
source = "last"
depth_m = 0.01
time_s = 0.5
[[hand.segment]]
kind = "button_down"
time_s = 0.0
[[hand.segment]]
kind = "slide"
point_m = [0.1, 0.2, 0]
time_s = 2.0
[[hand.segment]]
kind = "button_up"
time_s = 0.0
[[hand.segment]]
kind = "move"
source = "last"
standoff_m = 0.04
time_s = 0.5
[[hand.segment]]
kind = "hold"
time_s = 1.0
)";

TEST(HandScript, GoesWhereTheFileSays) {
  rt::Startup startup;
  HandScript s(startup.token(), load(kTour), WorkspaceMap({1, 2, 3}, 1, 0));
  ASSERT_EQ(s.size(), 7U);
  EXPECT_EQ(s.duration(), 5500ms);
  const auto at = [&](double t) { return s.target(rt::nanos_from_seconds(t)); };
  EXPECT_EQ(at(0).p_WT, Vec3(1, 2, 3.05));
  EXPECT_EQ(at(0.4).segment, -1);
  EXPECT_EQ(at(1.0).segment, 0);
  EXPECT_LT((at(1.5).p_WT - Vec3(0.1, 0, 0.03)).norm(), 1e-12);
  EXPECT_FALSE(at(1.9).button);
  EXPECT_LT((at(2.0).p_WT - Vec3(0.1, 0, -0.01)).norm(), 1e-12);
  EXPECT_TRUE(at(2.0).button);
  EXPECT_LT((at(3.0).p_WT - Vec3(0.1, 0.1, -0.01)).norm(), 1e-12);  // half of the slide
  EXPECT_TRUE(at(3.9).button);
  EXPECT_FALSE(at(4.0).button);
  EXPECT_LT((at(4.5).p_WT - Vec3(0.1, 0.2, 0.04)).norm(), 1e-12);
  EXPECT_EQ(at(100).segment, 7);
  EXPECT_LT((at(100).p_WT - Vec3(0.1, 0.2, 0.04)).norm(), 1e-12);
}

TEST(HandScript, HoldsTheClutchWhereTheFileSays) {
  rt::Startup startup;
  HandScript s(startup.token(),
               load("[[hand.segment]]\nkind = \"clutch_down\"\ntime_s = 0.5\n[[hand.segment]]\n"
                    "kind = \"clutch_up\"\ntime_s = 0.5\n"),
               WorkspaceMap({1, 2, 3}, 1, 0));
  EXPECT_TRUE(s.target(rt::nanos_from_seconds(0.1)).clutch);
  EXPECT_FALSE(s.target(rt::nanos_from_seconds(0.1)).button);
  EXPECT_FALSE(s.target(rt::nanos_from_seconds(0.6)).clutch);
}

// Position continuous everywhere, velocity is its derivative, and a reach is at most 1.875 times
// its mean speed (the minimum-jerk peak).
TEST(HandScript, IsSmooth) {
  rt::Startup startup;
  HandScript s(startup.token(), load(kTour), {});
  HandTarget last = s.target(0ns);
  const double h = 1e-4;
  double peak = 0;
  for (int i = 1; i < 56000; ++i) {
    const HandTarget t = s.target(rt::Nanos{i * 100'000LL});
    const Vec3 v = (t.p_WT - last.p_WT) / h;
    ASSERT_LT((v - 0.5 * (t.v_WT + last.v_WT)).norm(), 2e-3) << i;
    ASSERT_LT((t.v_WT - last.v_WT).norm(), 2e-3) << i;
    if (t.segment == 0) peak = std::max(peak, t.v_WT.norm());
    last = t;
  }
  const double way = (Vec3(0.1, 0, 0.03) - Vec3(0, 0, 0.05)).norm();
  EXPECT_NEAR(peak, 1.875 * way, 1e-4 * way);
}

TEST(HandScript, PixelPointsArriveWhileRunning) {
  rt::Startup startup;
  const char* const text = R"(
[[hand.segment]]
kind = "move"
source = "pixel"
pixel = [320, 240]
standoff_m = 0.1
[[hand.segment]]
kind = "press"
source = "pixel"
pixel = [100, 100]
)";
  HandScript s(startup.token(), load(text), {});
  EXPECT_EQ(s.segment(0).pixel[0], 320);
  EXPECT_FALSE(s.set_point(5, Vec3::Zero(), Vec3::UnitZ()));
  EXPECT_FALSE(s.set_point(0, Vec3::Zero(), Vec3::Zero()));
  EXPECT_FALSE(s.set_point(0, Vec3(std::nan(""), 0, 0), Vec3::UnitZ()));
  EXPECT_TRUE(s.set_point(0, Vec3(1, 0, 0), Vec3(0, 3, 0)));
  EXPECT_FALSE(s.set_point(0, Vec3(2, 0, 0), Vec3::UnitZ()));  // once only
  EXPECT_LT((s.target(999'999'999ns).p_WT - Vec3(1, 0.1, 0)).norm(), 1e-6);
  EXPECT_EQ(s.unresolved(), 0U);
  // The second has not arrived when it starts: held, counted, and later delivery has no effect.
  EXPECT_LT((s.target(1500ms).p_WT - Vec3(1, 0.1, 0)).norm(), 1e-12);
  EXPECT_EQ(s.unresolved(), 1U);
  EXPECT_TRUE(s.set_point(1, Vec3(9, 9, 9), Vec3::UnitZ()));
  EXPECT_LT((s.target(1900ms).p_WT - Vec3(1, 0.1, 0)).norm(), 1e-12);
}

TEST(HandScript, EvaluationTimesDoNotMatter) {
  rt::Startup startup;
  HandScript a(startup.token(), load(kTour), {}), b(startup.token(), load(kTour), {});
  rt::Random random(7);
  std::int64_t ns = 0;
  while (ns < 6'000'000'000) {
    for (const std::int64_t next = ns + random.integer(1, 300'000'000); ns < next;
         ns += random.integer(1, 20'000'000)) {
      (void)b.target(rt::Nanos{ns});  // a is not asked here
    }
    ASSERT_EQ(a.target(rt::Nanos{ns}).p_WT, b.target(rt::Nanos{ns}).p_WT);
  }
}

TEST(HandScript, RefusesBadSegments) {
  rt::Startup startup;
  for (const char* text : {"[[hand.segment]]\nkind='move'\ntime_s=0\n",
                           "[[hand.segment]]\nkind='press'\nnormal=[0,0,0]\n"}) {
    const HandScriptConfig c = load(text);
    try {
      HandScript s(startup.token(), c, {});
      FAIL() << text;
    } catch (const std::invalid_argument& e) {
      EXPECT_NE(std::string(e.what()).find("hand.segment[0]"), std::string::npos);
    }
  }
  HandScriptConfig c;
  config::Section root;
  c.describe(root.section("hand"));
  EXPECT_FALSE(config::load_text("[[hand.segment]]\nkind='wave'\n", "t", root).has_value());
}

TEST(WorkspaceMap, RoundTripAndScale) {
  rt::Random random(9);
  for (int i = 0; i < 100; ++i) {
    const WorkspaceMap m({random.uniform(-3, 3), random.uniform(-3, 3), 1}, random.uniform(0.1, 10),
                         random.uniform(-3, 3));
    const Vec3 p(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    EXPECT_LT((m.to_device(m.to_world(p)) - p).norm(), 1e-12);
    EXPECT_NEAR((m.to_world(p) - m.to_world(Vec3::Zero())).norm(), m.scale() * p.norm(), 1e-12);
  }
  const WorkspaceMap turned({0, 0, 0}, 2, M_PI / 2);
  EXPECT_LT((turned.to_world({1, 0, 0}) - Vec3(0, 2, 0)).norm(), 1e-12);
}

// Hand against a wall at the device: the penetration balances hand spring and wall spring.
TEST(HandScript, PressingOnAWallBalancesTheSprings) {
  rt::Startup startup;
  const char* const text = R"(
[[hand.segment]]
kind = "move"
point_m = [0, 0, 0]
standoff_m = 0.02
[[hand.segment]]
kind = "press"
source = "last"
depth_m = 0.014
[[hand.segment]]
kind = "hold"
time_s = 2
)";
  HandScript hand(startup.token(), load(text), {});
  drivers::OmegaTwinConfig c;
  c.coulomb_N = 0;
  drivers::OmegaTwin twin(startup.token(), c, &hand, Vec3(0, 0, 0.03));
  drivers::StylusSample s;
  rt::Time now{};
  for (int i = 0; i < 4000; ++i) {
    rt::Section section;
    ASSERT_TRUE(twin.sense(now, s));
    twin.act(now, {Vec3(0, 0, s.p_DH.z() < 0 ? -1000 * s.p_DH.z() : 0.0)});
    now += 1ms;
  }
  EXPECT_EQ(s.state, drivers::DeviceState::kForce);
  EXPECT_NEAR(s.p_DH.z(), -0.014 * 400 / 1400, 2e-5);
}

}  // namespace

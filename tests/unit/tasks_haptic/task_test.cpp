// The task round the proxy: ports, modes, ramps, guards, energy, events, cost.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>

#include "rt/hash.hpp"
#include "rt/random.hpp"
#include "tests/unit/tasks_haptic/floor.hpp"
#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_score.hpp"
#include "tools/measure/support/haptic_solids.hpp"
#include "tools/measure/support/rt_guard.hpp"

namespace {

using rig::floor_scene;
using rig::Path;
using rig::press;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;
using tasks::Mode;
using Kind = tasks::TouchEvent::Kind;

TEST(HapticTask, RefusesStiffnessAboveTheDeviceNamingBoth) {
  rt::Startup startup;
  tasks::HapticConfig config;
  config.stiffness_N_per_m = 5000;
  drivers::DeviceProperties device;  // b = 2: 3200 N/m at 1 kHz
  try {
    tasks::HapticTask task(startup.token(), config, device, 1e-3);
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("5000"), std::string::npos);
    EXPECT_NE(std::string(e.what()).find("3200"), std::string::npos);
  }
  EXPECT_NO_THROW(tasks::HapticTask(startup.token(), config, device, 0.25e-3));
  device.delay_s = 1e-3;
  config.stiffness_N_per_m = 1100;  // b / (1.5 T) x 0.8 = 1067
  EXPECT_THROW(tasks::HapticTask(startup.token(), config, device, 1e-3), std::runtime_error);
}

TEST(HapticTask, RefusesAWindowThatAHandLeavesTooSoon) {
  rt::Startup startup;
  tasks::HapticConfig config;
  drivers::DeviceProperties device;
  EXPECT_NO_THROW(tasks::HapticTask(startup.token(), config, device, 1e-3, 0.15));
  EXPECT_THROW(tasks::HapticTask(startup.token(), config, device, 1e-3, 0.14), std::runtime_error);
  config.scale = 3;
  EXPECT_THROW(tasks::HapticTask(startup.token(), config, device, 1e-3, 0.32), std::runtime_error);
  config.scale = 1;
  config.method = "magic";
  EXPECT_THROW(tasks::HapticTask(startup.token(), config, device, 1e-3), std::runtime_error);
}

TEST(HapticTask, ZeroBeforeEveryHardPortWasValid) {
  for (int missing = 0; missing < 3; ++missing) {
    Rig r(floor_scene());
    if (missing == 0) r.publish(false);
    if (missing == 1) r.in().mode.seq = 0;
    if (missing == 2) r.in().stylus_ok = false;
    for (int i = 0; i < 300; ++i) {
      EXPECT_EQ(r.tick({0, 0, i < 100 ? 0.01 : -0.005}).f.norm(), 0) << missing;
    }
  }
}

TEST(HapticTask, InitIsZeroAndHoldTouches) {
  Rig r(floor_scene());
  r.in().mode.mode = Mode::kInit;
  press(r);
  EXPECT_EQ(r.tick({0, 0, -0.008}).f.norm(), 0);
  r.in().mode.mode = Mode::kHold;
  for (int i = 0; i < 100; ++i) r.tick({0, 0, -0.008});
  EXPECT_NEAR(r.tick({0, 0, -0.008}).f.z(), 8, 0.01);
}

TEST(HapticTask, SafeStopIsZeroInTheSameTickAndReturnsFading) {
  Rig r(floor_scene());
  press(r);
  EXPECT_NEAR(r.tick({0, 0, -0.008}).f.z(), 8, 0.01);
  r.in().mode.mode = Mode::kSafeStop;
  EXPECT_EQ(r.tick({0, 0, -0.008}).f.norm(), 0);
  r.in().mode.mode = Mode::kEngaged;
  double before = 0;
  for (int i = 0; i < 100; ++i) {
    const double f = r.tick({0, 0, -0.008}).f.norm();
    EXPECT_LE(f - before, 0.3);
    before = f;
  }
  EXPECT_NEAR(before, 8, 0.01);
}

TEST(HapticTask, RampDownTakesTheRampTime) {
  Rig r(floor_scene());
  press(r);
  r.in().mode.mode = Mode::kRampDown;
  double at_half = 0;
  int ticks = 0;
  for (; ticks < 300; ++ticks) {
    const double f = r.tick({0, 0, -0.008}).f.norm();
    if (ticks == 49) at_half = f;
    if (f == 0) break;
  }
  EXPECT_NEAR(at_half, 4, 0.2);
  EXPECT_NEAR(ticks, 100, 2);
}

TEST(HapticTask, StalePatchRampsToZeroAndReturns) {
  Rig r(floor_scene());
  press(r);
  r.publish(false);
  double zero_after = -1;
  rt::Health worst;
  for (int i = 0; i < 400; ++i) {
    const Row row = r.tick({0, 0, -0.008});
    worst = rt::worst(worst, row.health);
    if (zero_after < 0 && row.f.norm() == 0) zero_after = i;
    if (i < 60) {
      EXPECT_NEAR(row.f.norm(), 8, 0.01);
    }
  }
  // The last publication is up to 33 ms old here: 100 ms of liveness, 100 ms of ramp.
  EXPECT_GE(zero_after, 165);
  EXPECT_LE(zero_after, 202);
  EXPECT_EQ(worst.fault, tasks::kFaultHapticPatchStale);
  r.publish(true);
  double before = 0;
  for (int i = 0; i < 200; ++i) {
    const double f = r.tick({0, 0, -0.008}).f.norm();
    EXPECT_LE(std::abs(f - before), 0.3 + 1e-9);
    before = f;
  }
  EXPECT_NEAR(before, 8, 0.01);
}

TEST(HapticTask, NotANumberGivesZeroForceAndAFault) {
  const double bad[] = {std::numeric_limits<double>::quiet_NaN(),
                        std::numeric_limits<double>::infinity(), 1e300, -50};
  for (const double value : bad) {
    for (int axis = 0; axis < 3; ++axis) {
      Rig r(floor_scene());
      press(r);
      Vec3 p(0, 0, -0.008);
      p[axis] = value;
      rt::Tick tick;
      tick.release = rt::time_from_ns(500000000);
      r.in().stylus.p_DH = p;
      r.in().patch_newest = nullptr;
      const rt::Health h = r.task().step(tick, r.in(), r.out());
      EXPECT_EQ(h.fault, tasks::kFaultHapticNotFinite);
      EXPECT_EQ(r.out().force.f_H_D.norm(), 0);
      EXPECT_TRUE(r.out().state.p_WH.allFinite());
      EXPECT_TRUE(r.out().state.p_WP.allFinite());
      EXPECT_TRUE(r.out().state.v_WH.allFinite());
    }
  }
}

TEST(HapticTask, MalformedPatchIsRefused) {
  Rig r(floor_scene());
  press(r);
  auto patch = std::make_unique<perception::SurfacePatch>();
  const auto spoil = [&](auto change) {
    r.fill(*patch, Vec3::Zero(), 0.3, 100);
    change(*patch);
    while (!r.task().wants_patch()) r.tick({0, 0, -0.008});
    r.publish(false);
    rt::Tick tick;
    tick.release = rt::time_from_ns(300000000);
    r.in().patch_newest = patch.get();
    const rt::Health h = r.task().step(tick, r.in(), r.out());
    r.in().patch_newest = nullptr;
    return h.fault;
  };
  EXPECT_EQ(spoil([](auto& p) { p.nodes = 7; }), tasks::kFaultHapticBadPatch);
  EXPECT_EQ(spoil([](auto& p) { p.nodes = 68; }), tasks::kFaultHapticBadPatch);
  EXPECT_EQ(spoil([](auto& p) { p.voxel_size = std::nan(""); }), tasks::kFaultHapticBadPatch);
  EXPECT_EQ(spoil([](auto& p) { p.voxel_size = 0; }), tasks::kFaultHapticBadPatch);
  EXPECT_EQ(spoil([](auto& p) { p.metres_per_unit = -1; }), tasks::kFaultHapticBadPatch);
}

TEST(HapticTask, DeviceLossHoldsThenLetsGo) {
  Rig r(floor_scene());
  press(r);
  r.in().stylus_ok = false;
  for (int i = 0; i < 10; ++i) {
    const Row row = r.tick({0, 0, -0.008});
    EXPECT_NEAR(row.f.z(), 8, 0.01);
    EXPECT_EQ(row.health.fault, rt::kNoFault);
  }
  for (int i = 0; i < 50; ++i) {
    const Row row = r.tick({0, 0, -0.008});
    EXPECT_EQ(row.f.norm(), 0);
    EXPECT_EQ(row.health.fault, tasks::kFaultHapticDeviceLost);
  }
  r.in().stylus_ok = true;
  EXPECT_LE(r.tick({0, 0, -0.008}).f.norm(), 0.3);
  for (int i = 0; i < 100; ++i) r.tick({0, 0, -0.008});
  EXPECT_NEAR(r.tick({0, 0, -0.008}).f.z(), 8, 0.01);
}

TEST(HapticTask, ASafeStopWithoutASampleIsZeroInTheSameTick) {
  for (const Mode mode : {Mode::kSafeStop, Mode::kInit}) {
    Rig r(floor_scene());
    press(r);
    r.in().stylus_ok = false;
    EXPECT_NEAR(r.tick({0, 0, -0.008}).f.z(), 8, 0.01);
    const Mode before = r.in().mode.mode;
    r.in().mode.mode = mode;
    for (int i = 0; i < 5; ++i) {
      const Row row = r.tick({0, 0, -0.008});
      EXPECT_EQ(row.f.norm(), 0) << i;
      EXPECT_EQ(row.health.fault, rt::kNoFault) << "the device's liveness is not over";
    }
    r.in().mode.mode = before;
    EXPECT_EQ(r.tick({0, 0, -0.008}).f.norm(), 0) << "what was held does not come back";
    r.in().stylus_ok = true;
    EXPECT_LE(r.tick({0, 0, -0.008}).f.norm(), 0.3);
  }
}

TEST(HapticTask, EventsFollowTheHandInOrder) {
  Rig r(floor_scene());
  std::vector<tasks::TouchEvent> events;
  const auto collect = [&](const Vec3& p) {
    r.tick(p);
    for (int i = 0; i < r.out().event_count; ++i) {
      events.push_back(r.out().events[static_cast<std::size_t>(i)]);
    }
  };
  for (int i = 0; i < 150; ++i) collect({0, 0, 0.01 - 1e-4 * i});
  r.in().stylus.button = true;
  for (int i = 0; i < 500; ++i) collect({1.6e-4 * i, 0, -0.005});  // 80 mm in 0.5 s
  for (int i = 0; i < 250; ++i) collect({0.08, 0, -0.005});
  r.in().stylus.button = false;
  for (int i = 0; i < 50; ++i) collect({0.08, 0, -0.005});
  r.in().stylus.button = true;  // a mark that ends by leaving
  for (int i = 0; i < 30; ++i) collect({0.08, 0, -0.005});
  for (int i = 0; i < 200; ++i) collect({0.08, 0, -0.005 + 1e-4 * i});
  std::string order;
  for (std::size_t i = 0; i < events.size(); ++i) {
    EXPECT_EQ(events[i].seq, i + 1);
    order += "CcBpE"[static_cast<int>(events[i].kind)];
    EXPECT_NEAR(events[i].p_W.z(), events[i].kind == Kind::kContactEnd ? events[i].p_W.z() : 0,
                1e-3);
  }
  // 80 mm at 160 mm/s: 20 mm take 125 ms, so the 100 ms rule comes first: 5 points; 2 while still.
  EXPECT_EQ(order, "CBpppppppEBEc");
  EXPECT_NEAR(events[1].force_N, 5, 0.2);
  EXPECT_NEAR(events[1].normal_W.z(), 1, 1e-3);
}

TEST(HapticTask, MarksKeepTheirSpacingWhenFast) {
  Rig r(floor_scene());
  std::vector<Vec3> points;
  for (int i = 0; i < 150; ++i) r.tick({-0.1, 0, 0.01 - 1e-4 * i});
  r.in().stylus.button = true;
  for (int i = 0; i < 200; ++i) {
    r.tick({-0.1 + 1e-3 * i, 0, -0.005});
    for (int k = 0; k < r.out().event_count; ++k) {
      points.push_back(r.out().events[static_cast<std::size_t>(k)].p_W);
    }
  }
  ASSERT_GE(points.size(), 10U);
  for (std::size_t i = 1; i < points.size(); ++i) {
    EXPECT_NEAR((points[i] - points[i - 1]).norm(), 0.02, 1.1e-3);
  }
}

TEST(HapticTask, HandBeyondTheWindowHoldsTheLastFrame) {
  Scene s = floor_scene();
  s.nodes = 16;
  Rig r(s);
  press(r, 0.005);
  r.publish(false);
  const double most = 1e-3 * 90;  // the window reaches 80 mm
  double lateral = 0;
  bool edge = false;
  for (int i = 0; i < 90; ++i) {
    const Row row = r.tick({most * i / 90, 0, -0.005});
    lateral = std::max(lateral, std::abs(row.f.x()));
    edge = edge || row.telemetry.near_edge;
    if (!row.telemetry.stale) {
      EXPECT_NEAR(row.f.z(), 5, 0.05);
    }
  }
  EXPECT_TRUE(edge);
  EXPECT_LE(lateral, 0.05);
}

TEST(HapticTask, SameInputSameBytes) {
  std::uint64_t digest[2] = {0, 0};
  for (auto& d : digest) {
    Scene s;
    s.solid = [](const Vec3& p, double) { return solids::room_corner(p); };
    Rig r(s);
    rt::Hash64 hash;
    rt::Random random(5);
    Vec3 p(-0.02, -0.02, 0.02);
    for (int i = 0; i < 3000; ++i) {
      p += 2e-4 * Vec3(random.normal(), random.normal(), random.normal()) -
           2e-3 * (p - Vec3(0, 0, 0));
      const Row row = r.tick(p);
      for (int a = 0; a < 3; ++a) {
        hash.value(row.f[a]);
        hash.value(row.p[a]);
      }
    }
    d = hash.digest();
  }
  EXPECT_EQ(digest[0], digest[1]);
}

// Random hands in random noisy fields with holes: whatever happens, the rules that protect the hand
// hold.
TEST(HapticTask, ProtectsTheHandWhateverTheFieldIs) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Scene s;
    s.solid = [seed](const Vec3& p, double t) {
      return solids::sphere(p, 0.03 + 0.01 * std::sin(7 * t + static_cast<double>(seed)));
    };
    s.extra = [seed](int x, int y, int z, int frame) {
      return 0.01 * rt::Random(rt::mix64(seed, static_cast<std::uint64_t>(frame)),
                               static_cast<std::uint64_t>((x * 512 + y) * 512 + z))
                        .normal();
    };
    s.seen = [seed](const Vec3& p) {
      const auto key =
          static_cast<std::uint64_t>(std::lround(p.x() * 100) * 7919 +
                                     std::lround(p.y() * 100) * 104729 + std::lround(p.z() * 100));
      return rt::Random(seed, key).uniform() > 0.02;
    };
    s.config.tip_radius_m = seed % 2 == 0 ? 0.003 : 0.0;
    Rig r(s);
    rt::Random random(seed, 99);
    Vec3 p(0, 0, 0.06), v = Vec3::Zero(), f = Vec3::Zero();
    Vec3 before = p;
    std::uint32_t work = 0;
    for (int i = 0; i < 2000; ++i) {
      v += 0.02 * Vec3(random.normal(), random.normal(), random.normal()) - 0.02 * v - 0.05 * p;
      p += 1e-3 * v;
      const Row row = r.tick(p);
      ASSERT_TRUE(row.f.allFinite() && row.p.allFinite());
      ASSERT_LE(row.f.norm(), 12 + 1e-9);
      ASSERT_LE((row.f - f).norm(), std::max(0.3, 1.1 * 1000 * (p - before).norm()) + 1e-9);
      work = std::max(work, row.telemetry.work);
      f = row.f;
      before = p;
    }
    std::printf("seed %llu: most field samples in a tick %u\n",
                static_cast<unsigned long long>(seed), work);
    EXPECT_LE(work, 600U);
  }
}

TEST(HapticTask, AStepAllocatesNothingAndWaitsForNothing) {
  if (!rt_guard::linked()) GTEST_SKIP() << "guard not linked";
  Scene s;
  s.solid = [](const Vec3& p, double) { return solids::room_corner(p); };
  Rig r(s);
  rt_guard::reset();
  const Path path({{-0.03, -0.03, 0.02}, {0.006, 0.006, -0.006}, {-0.03, 0, 0.02}}, 0.1);
  r.run(path, 0, path.duration());  // tick() opens a section round step() only
  EXPECT_EQ(rt_guard::counts().total(), 0U);
}

}  // namespace

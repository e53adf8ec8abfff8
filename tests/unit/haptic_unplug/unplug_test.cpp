// The haptic task on the real Omega driver on the twin library: what the hand feels when the plug
// is pulled while it presses, when it comes back, and when the button on the base is pressed.
#include <gtest/gtest.h>

#include <algorithm>

#include "perception/patch/surface_patch.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tests/unit/drivers_omega/twin_rig.hpp"

namespace {

using namespace twin_rig;
using perception::SurfacePatch;

// A floor at z = 0, seen from above, 10 mm voxels.
std::unique_ptr<SurfacePatch> floor_patch() {
  auto p = std::make_unique<SurfacePatch>();
  constexpr double kTruncation = 0.05;
  p->map_id = 1;
  p->seq = 1;
  p->voxel_size = 0.01;
  p->metres_per_unit = static_cast<float>(kTruncation / 32767);
  p->nodes = 32;
  p->origin_node = {-16, -16, -16};
  p->free.fill(~std::uint64_t{0});
  for (int x = 0; x < 32; ++x) {
    for (int y = 0; y < 32; ++y) {
      for (int z = 0; z < 32; ++z) {
        const double d = std::clamp((z - 16) * 0.01, -kTruncation, kTruncation);
        const auto i = p->index(x, y, z);
        p->distance[i] = static_cast<std::int16_t>(std::lround(d / kTruncation * 32767));
        p->material[i] = 1;
        if (d <= 0) p->free[i / 64] &= ~(std::uint64_t{1} << (i % 64));
      }
    }
  }
  return p;
}

struct TouchRig {
  Rig rig{"manual_clock = true\n[twin]\nhand_stiffness_N_per_m = 0\nhand_mass_kg = 0\n"};
  std::unique_ptr<SurfacePatch> patch = floor_patch();
  tasks::HapticTask task;
  tasks::HapticTask::In in;
  tasks::HapticTask::Out out;
  std::uint64_t k = 0;

  TouchRig() : task(rig.twin.token(), config(), rig.device->properties(), 1e-3) {
    in.mode.seq = 1;
    in.mode.mode = tasks::Mode::kEngaged;
    rig.device->request_enable();
  }
  static tasks::HapticConfig config() {
    tasks::HapticConfig c;
    c.stiffness_N_per_m = 1000;
    c.workspace_W_m = {0, 0, 0.01};
    return c;
  }
  void tick() {
    rig.now += std::chrono::milliseconds{1};
    rig.twin.control().advance(1e-3);
    in.stylus_ok = rig.device->sense(rig.now, in.stylus);
    patch->fused = rig.now;
    in.patch_newest = patch.get();
    rt::Tick tick;
    tick.k = k++;
    tick.release = tick.start = rig.now;
    (void)task.step(tick, in, out);
    rig.device->act(rig.now, out.force);
  }
  void ticks(int n) {
    for (int i = 0; i < n; ++i) tick();
  }
  // Down onto the floor, 3 N.
  void press() {
    rig.twin.set("external_z_N", -3.0);
    ticks(2500);
    ASSERT_NEAR(rig.twin.motor().z(), 3.0, 0.2);
    ASSERT_TRUE(out.telemetry.in_contact);
  }
  // Force on: from nothing, and never faster than a still hand allows plus what its motion
  // explains.
  void comes_back_softly(int n) {
    double before = 0, most = 0;
    Vec3 h = in.stylus.p_DH;
    for (int i = 0; i < n; ++i) {
      tick();
      const double f = out.force.f_H_D.norm();
      const double dh = (in.stylus.p_DH - h).norm();
      ASSERT_LE(f - before, std::max(0.3, 1.1 * 1000 * dh) + 1e-9) << i;
      before = f;
      h = in.stylus.p_DH;
      most = std::max(most, f);
    }
    EXPECT_EQ(in.stylus.state, DeviceState::kForce);
    EXPECT_GT(most, 0.5);
  }
  template <class Done>
  bool wait_until(Done done) {
    for (int i = 0; i < 5000 && !done(); ++i) {
      tick();
      std::this_thread::sleep_for(std::chrono::milliseconds{1});
    }
    return done();
  }
};

TEST(HapticUnplug, ForceIsZeroNothingCrashesAndItComesBack) {
  TouchRig t;
  t.press();
  for (int round = 0; round < 3; ++round) {
    t.rig.twin.set("unplugged", 1);
    t.rig.twin.set("external_z_N", 0);  // startled, the hand stays where it is, inside
    t.tick();
    EXPECT_EQ(t.rig.twin.motor(), Vec3::Zero());  // the device itself, at once
    t.ticks(12);
    EXPECT_EQ(t.out.force.f_H_D, Vec3::Zero());  // and the task, after the device's liveness
    t.rig.twin.set("unplugged", 0);
    ASSERT_TRUE(t.wait_until([&] { return t.in.stylus_ok; }));
    for (int i = 0; i < 100; ++i) {  // forces wait for an act
      t.tick();
      ASSERT_EQ(t.rig.twin.motor(), Vec3::Zero());
    }
    t.rig.device->request_enable();
    t.comes_back_softly(300);
    t.press();
  }
}

TEST(HapticUnplug, ForceButtonInContactFadesInAgain) {
  TouchRig t;
  t.press();
  t.rig.twin.set("force_button", 1);
  t.ticks(50);
  EXPECT_EQ(t.rig.twin.motor(), Vec3::Zero());
  EXPECT_EQ(t.in.stylus.state, DeviceState::kBrake);
  t.rig.device->request_enable();
  t.comes_back_softly(300);
  t.press();
}

}  // namespace

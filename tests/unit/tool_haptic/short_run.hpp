// A short haptic run in memory: a hand over the corner of two walls, windows of a solid at 30 Hz.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "tools/measure/support/haptic_rig.hpp"
#include "tools/measure/support/haptic_solids.hpp"
#include "tools/touch/tick_rerun.hpp"

namespace tests {

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

inline File reading(const std::string& bytes) {
  // fmemopen takes no empty buffer; a file of no bytes is read from the null device.
  if (bytes.empty()) return {std::fopen("/dev/null", "rb"), &std::fclose};
  return {::fmemopen(const_cast<char*>(bytes.data()), bytes.size(), "rb"), &std::fclose};
}

// `ticks` of a slide into a concave corner. Everything that a run may hold is in it: a clutch, a
// tick without a sample, friction.
inline std::string short_run(int ticks, const std::string& method = "constrained",
                             double friction = 0.3) {
  char* bytes = nullptr;
  std::size_t size = 0;
  File file(::open_memstream(&bytes, &size), &std::fclose);
  rig::Scene scene;
  scene.solid = [](const rig::Vec3& p, double) { return solids::concave_edge(p); };
  scene.still = true;
  scene.nodes = 24;
  scene.config.method = method;
  scene.config.friction_static = friction;
  scene.config.friction_dynamic = 0.8 * friction;
  rig::Rig r(scene);
  teletact::HapticRunHeader header;
  header.config = scene.config;
  header.device = scene.device;
  teletact::HapticRunWriter writer(file.get(), header);
  const rig::Path path(
      {{-0.03, 0, 0.004}, {-0.03, 0, -0.006}, {0.006, 0, -0.006}, {0.006, 0, 0.03}}, 0.1);
  rt::Startup startup;
  tasks::HapticTask task(startup.token(), scene.config, scene.device, 1e-3);
  std::vector<std::unique_ptr<rig::SurfacePatch>> windows;
  tasks::HapticTask::In in;
  tasks::HapticTask::Out out;
  in.mode.seq = 1;
  in.mode.mode = tasks::Mode::kHold;
  in.stylus.state = drivers::DeviceState::kForce;
  for (int k = 0; k < ticks; ++k) {
    const double t = 1e-3 * k;
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(k);
    tick.release = tick.start = rt::time_from_ns(1000000LL * k);
    tick.period = rt::Nanos{1000000};
    const rig::Vec3 h = path(t);
    if (k % 33 == 0) {
      windows.push_back(std::make_unique<rig::SurfacePatch>());
      r.fill(*windows.back(), h, t, static_cast<int>(windows.size()) - 1);
      writer.window(*windows.back());
    }
    in.patch_newest = task.wants_patch() ? windows.back().get() : nullptr;
    in.stylus.seq = static_cast<std::uint64_t>(k) + 1;
    in.stylus.taken = tick.release;
    in.stylus.p_DH = h;
    in.stylus_ok = k % 50 != 49;
    in.clutch = k >= 300 && k < 340;
    (void)task.step(tick, in, out);
    writer.tick(teletact::run_tick(tick, in, out));
  }
  writer.finish();
  file.reset();
  std::string all(bytes, size);
  std::free(bytes);
  return all;
}

}  // namespace tests

#include "tools/touch/touch_rerun.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include "rt/memory/non_realtime.hpp"
#include "rt/quantile.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/touch/tick_rerun.hpp"
#include "tools/touch/view_cast.hpp"

namespace teletact {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

// The window as a field of its own, node (0,0,0) at its corner.
DenseField field_of(const SurfacePatch& w) {
  DenseField f;
  f.size = {w.nodes, w.nodes, w.nodes};
  f.distance.reserve(w.cells());
  for (int x = 0; x < w.nodes; ++x) {
    for (int y = 0; y < w.nodes; ++y) {
      for (int z = 0; z < w.nodes; ++z) {
        const std::size_t i = w.index(x, y, z);
        float d = std::numeric_limits<float>::quiet_NaN();
        if (w.material[i] != 0) {
          d = static_cast<float>(w.distance[i]) * w.metres_per_unit;
        } else if (w.free_at(i)) {
          d = w.truncation();
        }
        f.distance.push_back(d);
      }
    }
  }
  return f;
}

// The published method's view of a run that has none: 1 m off the first contact, over the window.
HapticRerun::Caster caster_of(const std::string& path) {
  OpenHapticRun run(path);
  Vec3 p = Vec3::Zero(), n = Vec3::UnitZ();
  if (!first_touch(*run.reader, p, n)) return nullptr;
  return [p, n](const SurfacePatch& w, tasks::SurfacePoints& out) {
    const Vec3 corner = w.node_W(0, 0, 0);
    View view;
    view.eye = p + n - corner;
    view.look = p - corner;
    if (cast_view(field_of(w), w.voxel_size, view, out) == 0) return false;
    for (std::size_t i = 0; i < out.count; ++i) {
      if (out.x[i] < 0.5F * tasks::SurfacePoints::kFar) {
        out.set(i, out.point(i) + corner, out.normal(i));
      }
    }
    return true;
  };
}

struct ReplayTally {
  std::size_t ticks = 0, contact = 0, equal = 0;
  double force_N = 0, step_N = 0, step_raw_N = 0, apart_N = 0;
  std::vector<double> cpu_us;
  void add(const HapticRerun& r) {
    const auto& out = r.out();
    ++ticks;
    equal += r.equal() ? 1 : 0;
    force_N = std::max(force_N, out.force.f_H_D.norm());
    step_N = std::max(step_N, out.telemetry.step_N);
    step_raw_N = std::max(step_raw_N, out.telemetry.step_raw_N);
    apart_N = std::max(apart_N, (out.force.f_H_D - r.recorded().f_D).norm());
    if (!out.telemetry.in_contact) return;
    ++contact;
    cpu_us.push_back(r.cpu_us());
  }
  [[nodiscard]] Metrics metrics(bool as_it_was) const {
    Metrics m("touch");
    const auto all = static_cast<double>(std::max<std::size_t>(1, ticks));
    m.add("touch.ticks", static_cast<double>(ticks), "1");
    m.add("touch.contact_share", static_cast<double>(contact) / all, "1");
    m.add("touch.force_max_N", force_N, "N");
    m.add("touch.force_step_max_N", step_N, "N");
    m.add("touch.force_step_raw_max_N", step_raw_N, "N");
    m.add("touch.replay_apart_max_N", apart_N, "N");
    if (as_it_was) m.add("touch.replay_equal", static_cast<double>(equal), "1");
    if (cpu_us.empty()) return m;
    m.add("touch.cpu_p50_us", rt::quantile(cpu_us, 0.5), "us");
    m.add("touch.cpu_p99_us", rt::quantile(cpu_us, 0.99), "us");
    return m;
  }
};

}  // namespace

int rerun_touch(const TouchRerunOptions& o) {
  OpenHapticRun run(o.run);
  tasks::HapticConfig config = run.reader->header().config;
  const bool as_it_was = o.method.empty() || o.method == config.method;
  if (!o.method.empty()) config.method = o.method;
  HapticRerun::Caster caster;
  if (config.method == "force_shading" && !as_it_was) caster = caster_of(o.run);
  const Vec3 origin = run.reader->header().origin;
  rt::Startup startup;
  HapticRerun replay(startup.token(), *run.reader, config, caster);
  std::unique_ptr<WholeFile> trace;
  if (!o.out.empty()) {
    trace = std::make_unique<WholeFile>(o.out);
    std::fprintf(trace->get(), "t_s,hx,hy,hz,px,py,pz,fx,fy,fz,contacts,cpu_ns\n");
  }
  ReplayTally tally;
  while (replay.next()) {
    tally.add(replay);
    if (!trace) continue;
    const auto& out = replay.out();
    const Vec3 h = out.state.p_WH + origin, p = out.state.p_WP + origin;
    const Vec3& f = out.force.f_H_D;
    std::fprintf(trace->get(), "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%d,%lld\n",
                 rt::seconds(replay.recorded().tick.release.time_since_epoch()), h.x(), h.y(),
                 h.z(), p.x(), p.y(), p.z(), f.x(), f.y(), f.z(), out.state.contacts,
                 static_cast<long long>(1e3 * replay.cpu_us()));
  }
  if (as_it_was) {
    std::printf("%zu of %zu ticks answered as recorded, byte by byte\n", tally.equal, tally.ticks);
  } else {
    std::printf("%zu ticks through %s; force at most %.3f N from the recorded one\n", tally.ticks,
                config.method.c_str(), tally.apart_N);
  }
  write_outputs({{o.out, [&](const auto&) { trace->finish(); }},
                 {o.json, [&](const auto& path) { tally.metrics(as_it_was).write(path); }}});
  return as_it_was && tally.equal != tally.ticks ? 1 : 0;
}

}  // namespace teletact

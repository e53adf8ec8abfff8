// Every column of the trace repeats byte by byte on the same input, except cpu_ns, which is
// measured.
#include "tools/touch/touch_run.hpp"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/clock/box_time.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/quantile.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/cli/options.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/touch/tick_file.hpp"
#include "tools/touch/touch_input.hpp"
#include "tools/touch/touch_sources.hpp"

namespace teletact::touch {

using perception::Vec3;

namespace {

// Figures of a run; contact ticks only where docs/metrics.md says so.
class Tally {
 public:
  void add(const tasks::HapticTask::Out& out, std::int64_t cpu_ns) {
    const auto& m = out.telemetry;
    ++ticks_;
    force_N_ = std::max(force_N_, out.force.f_H_D.norm());
    step_N_ = std::max(step_N_, m.step_N);
    step_raw_N_ = std::max(step_raw_N_, m.step_raw_N);
    if (!m.in_contact) return;
    contact_cpu_us_.push_back(static_cast<double>(cpu_ns) * 1e-3);
    guarded_ += m.guard_use ? 1 : 0;
  }
  [[nodiscard]] Metrics metrics() const {
    Metrics m("touch");
    const auto contact = static_cast<double>(contact_cpu_us_.size());
    m.add("touch.ticks", static_cast<double>(ticks_), "1");
    m.add("touch.contact_share", contact / static_cast<double>(std::max<std::size_t>(1, ticks_)),
          "1");
    m.add("touch.force_max_N", force_N_, "N");
    m.add("touch.force_step_max_N", step_N_, "N");
    m.add("touch.force_step_raw_max_N", step_raw_N_, "N");
    if (contact_cpu_us_.empty()) return m;
    m.add("touch.guard_share", static_cast<double>(guarded_) / contact, "1");
    m.add("touch.cpu_p50_us", rt::quantile(contact_cpu_us_, 0.5), "us");
    m.add("touch.cpu_p99_us", rt::quantile(contact_cpu_us_, 0.99), "us");
    return m;
  }

 private:
  std::size_t ticks_ = 0, guarded_ = 0;
  double force_N_ = 0, step_N_ = 0, step_raw_N_ = 0;
  std::vector<double> contact_cpu_us_;
};

tasks::HapticConfig config_of(const Options& o, const Vec3& origin, const HandPath& path) {
  tasks::HapticConfig config;
  config.method = o.method;
  config.stiffness_N_per_m = o.stiffness;
  config.tip_radius_m = o.tip_radius_m;
  config.force_limit_N = o.force_limit_N;
  // A base at the world's origin, as long as the hand is in reach of it, whatever the scale.
  Vec3 centre = -origin;
  if (path.base != Vec3::Zero()) centre += o.scale * path.base;
  config.workspace_W_m = {centre.x(), centre.y(), centre.z()};
  config.passivity_controller = on_off(o.passivity, "--passivity");
  config.credit_N_s_per_m = 2;  // of an ordinary device: there is none here
  config.guard = on_off(o.guard, "--guard");
  config.friction_static = o.friction_static;
  config.friction_dynamic = std::min(o.friction_dynamic, o.friction_static);
  config.paper_friction = o.paper_friction;
  config.texture_amplitude_m = o.texture_m;
  config.texture_period_m = o.texture_period_m;
  config.bump_normal = o.bump_normal;
  config.materials = !o.palette.empty();
  config.viscosity_N_s_per_m = o.viscosity;
  config.scale = o.scale;
  config.border_m = o.border_m;
  config.border_rate_per_s = o.border_rate_per_s;
  if (!on_off(o.blend, "--blend")) config.blend_s = 0;
  config.patch_liveness_s = std::max(config.patch_liveness_s, 4 * path.period_s);
  return config;
}

// The trace, and with --debug a second table beside it.
class TraceFiles {
 public:
  explicit TraceFiles(const Options& o) : trace_(o.out) {
    std::fprintf(trace_.get(), "t_s,hx,hy,hz,px,py,pz,fx,fy,fz,contacts,cpu_ns\n");
    if (o.debug.empty()) return;
    debug_ = std::make_unique<WholeFile>(o.debug);
    std::fprintf(
        debug_->get(),
        "t_s,raw_fx,raw_fy,raw_fz,raw_step_N,step_N,in_contact,constraints,guard_active,"
        "guard_use,limit_active,held,near_edge,unresolved,field_samples,gain,blend,energy_J,"
        "booked_J,credit_J,controller_N\n");
  }
  void row(double t, const Vec3& h, const Vec3& p, const tasks::HapticTask::Out& out,
           std::int64_t cpu_ns) {
    const Vec3& f = out.force.f_H_D;
    std::fprintf(trace_.get(), "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%d,%lld\n", t,
                 h.x(), h.y(), h.z(), p.x(), p.y(), p.z(), f.x(), f.y(), f.z(), out.state.contacts,
                 static_cast<long long>(cpu_ns));
    if (debug_) write_debug(debug_->get(), t, out, out.state.contacts);
  }
  void finish_trace() { trace_.finish(); }
  void finish_debug() { debug_->finish(); }

 private:
  static void write_debug(std::FILE* f, double t, const tasks::HapticTask::Out& out,
                          int constraints) {
    const auto& m = out.telemetry;
    std::fprintf(
        f,
        "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%d,%d,%d,%d,%d,%d,%d,%d,%u,%.9g,%.9g,%.9g,%.9g,%.9g,%."
        "9g\n",
        t, m.f_raw_D.x(), m.f_raw_D.y(), m.f_raw_D.z(), m.step_raw_N, m.step_N,
        m.in_contact ? 1 : 0, constraints, m.guard_active ? 1 : 0, m.guard_use ? 1 : 0,
        m.limit_active ? 1 : 0, m.held ? 1 : 0, m.near_edge ? 1 : 0, m.unresolved ? 1 : 0, m.work,
        m.gain, m.blend, m.energy_J, m.booked_J, m.credit_J, m.controller_N);
  }

  WholeFile trace_;
  std::unique_ptr<WholeFile> debug_;
};

// With --record: what went into the task and what came out.
class RunFile {
 public:
  RunFile(const std::string& path, const HapticRunHeader& header) {
    if (path.empty()) return;
    file_ = std::make_unique<WholeFile>(path);
    writer_ = std::make_unique<HapticRunWriter>(file_->get(), header);
  }
  void before(const tasks::HapticTask::In& in) {
    if (!writer_) return;
    if (in.patch_newest != nullptr && in.patch_newest->seq != window_) {
      window_ = in.patch_newest->seq;
      writer_->window(*in.patch_newest);
    }
    if (in.surface != nullptr) writer_->surface(*in.surface);
  }
  void after(const rt::Tick& tick, const tasks::HapticTask::In& in,
             const tasks::HapticTask::Out& out) {
    if (writer_) writer_->tick(run_tick(tick, in, out));
  }
  void end() {
    if (writer_) writer_->finish();
  }
  void finish() { file_->finish(); }

 private:
  std::unique_ptr<WholeFile> file_;
  std::unique_ptr<HapticRunWriter> writer_;
  std::uint64_t window_ = 0;
};

// The last of a hand that the task gives up on are zeros: no trace.
void check_health(const Options& o, double t, const rt::Health& health) {
  if (health.severity < rt::Severity::kRampDown) return;
  char at[48];
  std::snprintf(at, sizeof at, ": t_s %.6g: ", t);
  throw std::runtime_error(o.path + at + "the haptic task gave up, fault " +
                           std::to_string(health.fault) + " of docs/faults.md");
}

// What a tick gets besides the hand: held and engaged by nobody, forces on.
tasks::HapticTask::In first_input() {
  tasks::HapticTask::In in;
  in.mode.seq = 1;
  in.mode.mode = tasks::Mode::kHold;
  in.stylus_ok = true;
  in.stylus.state = drivers::DeviceState::kForce;
  return in;
}

rt::Tick tick_at(std::uint64_t k, rt::Time now, double period_s) {
  rt::Tick tick;
  tick.k = k;
  tick.release = tick.start = now;
  tick.period = rt::nanos_from_seconds(period_s);
  return tick;
}

}  // namespace

void run(const Options& o) {
  const Vec3 origin = parse_origin(o.origin);
  const HandPath walk = load_hand(o);
  const std::vector<HandRow>& hand = walk.rows;
  const double period_s = walk.period_s;
  const FieldList fields = load_fields(o);
  const tasks::HapticConfig config = config_of(o, origin, walk);
  // No device here: nothing bounds the stiffness.
  drivers::DeviceProperties device;
  device.damping_N_s_per_m = 1e12;
  device.force_limit_N = o.force_limit_N;

  rt::Startup startup;
  tasks::HapticTask task(startup.token(), config, device, period_s);
  WindowSource windows(fields, o, origin);
  SurfaceSource surface(fields, o, origin, hand);
  TraceFiles trace(o);
  RunFile record(o.record, {config, device, period_s, origin});
  // The path is the device's; where the scene's hand is, the workspace says.
  const bool mapped = o.scale != 1 || o.border_m > 0 ||
                      std::any_of(hand.begin(), hand.end(), [](const auto& r) { return r.clutch; });
  Vec3 scene_before = Vec3::Zero();
  Tally tally;
  bool touched = false;
  tasks::HapticTask::In in = first_input();
  tasks::HapticTask::Out out;
  for (std::size_t k = 0; k < hand.size(); ++k) {
    const HandRow& row = hand[k];
    const rt::Time now{rt::nanos_from_seconds(row.t - hand.front().t)};
    const Vec3 scene = mapped ? Vec3(task.to_world(row.p - walk.base) + origin) : row.p;
    const Vec3 velocity =
        k > 0 ? Vec3((scene - scene_before) / (row.t - hand[k - 1].t)) : Vec3::Zero();
    scene_before = scene;
    in.patch_newest = windows.at(row.t, now, scene, velocity, task.wants_patch());
    in.surface = surface.at(windows.visible());
    in.clutch = row.clutch;
    record.before(in);
    in.stylus.seq = k + 1;
    in.stylus.taken = now;
    in.stylus.p_DH = row.p - walk.base;
    const rt::Tick tick = tick_at(k, now, period_s);
    const std::int64_t before = rt::thread_cpu_ns();
    const rt::Health health = task.step(tick, in, out);
    const std::int64_t cpu_ns = rt::thread_cpu_ns() - before;
    check_health(o, row.t, health);
    tally.add(out, cpu_ns);
    touched = touched || out.telemetry.in_contact;
    record.after(tick, in, out);
    trace.row(row.t, mapped ? Vec3(out.state.p_WH + origin) : row.p, out.state.p_WP + origin, out,
              cpu_ns);
  }
  windows.check_met(hand, touched);
  surface.check_seen();
  record.end();
  write_outputs({{o.debug, [&](const auto&) { trace.finish_debug(); }},
                 {o.record, [&](const auto&) { record.finish(); }},
                 {o.out, [&](const auto&) { trace.finish_trace(); }},
                 {o.json, [&](const auto& path) { tally.metrics().write(path); }}});
}

}  // namespace teletact::touch

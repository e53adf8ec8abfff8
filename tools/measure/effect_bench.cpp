#include "tools/measure/effect_bench.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/scene/effect_catalogue.hpp"

namespace teletact {

namespace {

using tasks::TaskId;

constexpr const char* kScene = "default_room";
using Keys = std::vector<std::string>;

// How an effect is switched in the default scene. What that asks for is switched off.
struct Switch {
  const char* name;
  Keys base;  // the other side of the comparison, beyond the scene
  Keys keys;  // and with these on top
  bool off = false;
};

const Keys kArm{"robot.arm.description=\"youbot\"",
                "robot.arm.key=[{time_s=1, angles_deg=[169, 10, -10, 10, 167.5]}]"};

// A scene has a shape or a network.
const Keys kNoShape{"link.shape.delay_ms=0", "link.shape.jitter_ms=0",
                    "link.shape.rate_Mbit_per_s=0"};

Keys with(Keys a, const std::string& b) {
  a.push_back(b);
  return a;
}

std::vector<Switch> switches() {
  return {
      {"camera noise: axial", {}, {"camera.noise.axial=0"}, true},
      {"camera noise: lateral_px", {}, {"camera.noise.lateral_px=0"}, true},
      {"camera noise: edge_dropout", {}, {"camera.noise.edge_dropout=0"}, true},
      {"camera noise: flying", {}, {"camera.noise.flying=0"}, true},
      {"camera: true_mount", {}, {"camera.true_mount.differs=true"}},
      {"world: things that move",
       {},
       {"world.mover=[{name=\"slide\", shapes=\"ball\", kind=\"shuttle\", way_m=[0.3, 0, 0]}]"}},
      {"robot: an arm before the camera", {}, kArm},
      {"robot: joints reported late", kArm, with(kArm, "robot.arm.joint_delay_ms=20")},
      {"robot: joints reported wrong", kArm, with(kArm, "robot.arm.joint_error_deg=0.5")},
      {"robot: motor_dynamics", {}, {"robot.plant.speed_loop_order=0"}, true},
      {"robot: slip", {}, {"robot.plant.slip_ratio=0.05"}},
      {"robot: wheel_slip", {}, {"robot.plant.wheel_slip_max=0"}, true},
      {"robot: wheel_radius", {}, {"robot.plant.wheel_radius_error=[0, 0, 0, 0]"}, true},
      {"robot: encoder_quantisation", {}, {"robot.plant.encoder_ticks_per_motor_turn=0"}, true},
      {"robot: dead_time", {}, {"robot.plant.dead_time_s=0.005"}},
      {"robot: gear_friction", {}, {"robot.plant.gear_friction_Nm=0.3"}},
      {"device: device_friction", {}, {"device.coulomb_N=0"}, true},
      {"device: position_quantum", {}, {"device.quantum_m=0"}, true},
      {"device: device_delay", {}, {"device.delay_s=0.0005"}},
      {"device: time_guard", {}, {"device.time_guard_s=0.0005"}},
      {"device: gravity", {}, {"device.gravity_mass_kg=0.2"}},
      {"link shape", {}, kNoShape, true},
      {"link network", kNoShape,
       with(kNoShape, "link.network={delay_ms=15, jitter_ms=2, rate_Mbit_per_s=100}")},
      {"touch: friction", {}, {"haptic.friction_static=0.3"}},
      {"touch: texture", {}, {"haptic.texture_amplitude_m=0.0002"}},
      {"touch: viscosity", {}, {"haptic.viscosity_N_s_per_m=1"}},
      {"touch: materials", {}, {"haptic.materials=true"}},
      {"touch: force shading", {}, {"haptic.method=\"force_shading\""}},
      {"objects in the map", {}, {"fusion.objects.enabled=true"}},
      {"mesh for the console", {}, {"fusion.mesh_blocks=100"}},
  };
}

// Who pays, as what is timed of it.
struct Payer {
  TaskId task;
  bool twin;  // the device simulated inside its jobs
  const char* job;
};
Payer payer_of(const EffectRow& row) {
  const std::string by = row.paid_by;
  if (by == "camera's twin") return {TaskId::kCapture, true, "a job of capture"};
  if (by == "base's twin") return {TaskId::kRobotIo, true, "a job of robot_io"};
  if (by == "device's twin") return {TaskId::kHaptic, true, "a job of haptic"};
  if (by == "haptic") return {TaskId::kHaptic, false, "a job of haptic"};
  if (by == "fusion") return {TaskId::kFusion, false, "a job of fusion"};
  return {TaskId::kRobotIo, true, ""};
}

// Of each job in its order, ns.
struct JobTimes {
  std::vector<std::int64_t> own, twin;
};
using RunTimes = std::array<JobTimes, tasks::kTaskCount + 1>;  // the last: the link, per look
constexpr std::size_t kLink = tasks::kTaskCount;

class TimedBody final : public rt::TaskBody {
 public:
  TimedBody(rt::TaskBody& body, JobTimes& times) : body_(body), times_(times) {}
  void latch(const rt::Tick& tick, rt::JobRecord& record) noexcept override {
    twin_before_ = body_.twin_cpu_ns();
    const std::int64_t from = rt::thread_cpu_ns();
    body_.latch(tick, record);
    spent_ = rt::thread_cpu_ns() - from;
  }
  rt::Health step(const rt::Tick& tick, rt::JobRecord& record) noexcept override {
    const std::int64_t from = rt::thread_cpu_ns();
    const rt::Health health = body_.step(tick, record);
    spent_ += rt::thread_cpu_ns() - from;
    return health;
  }
  void commit(const rt::Tick& tick, rt::JobRecord& record) noexcept override {
    const std::int64_t from = rt::thread_cpu_ns();
    body_.commit(tick, record);
    spent_ += rt::thread_cpu_ns() - from;
    const std::int64_t twin = body_.twin_cpu_ns() - twin_before_;
    times_.own.push_back(spent_ - twin);
    times_.twin.push_back(twin);
  }
  void abandon(const rt::Tick& tick) noexcept override { body_.abandon(tick); }
  void use(rt::ForkJoin& crew) noexcept override { body_.use(crew); }
  void make_safe() noexcept override { body_.make_safe(); }
  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept override { return body_.twin_cpu_ns(); }

 private:
  rt::TaskBody& body_;
  JobTimes& times_;
  std::int64_t spent_ = 0, twin_before_ = 0;
};

class TimedActor final : public rt::Actor {
 public:
  TimedActor(rt::Actor& actor, JobTimes& times) : actor_(actor), times_(times) {}
  [[nodiscard]] std::int64_t next_host_ns() const noexcept override {
    return actor_.next_host_ns();
  }
  void act(std::int64_t host_ns) override {
    const std::int64_t from = rt::thread_cpu_ns();
    actor_.act(host_ns);
    times_.own.push_back(rt::thread_cpu_ns() - from);
    times_.twin.push_back(0);
  }

 private:
  rt::Actor& actor_;
  JobTimes& times_;
};

RunTimes run_once(rt::NonRealtime& nrt, const Keys& keys, double seconds) {
  const auto scene = load_scene(find_config("scenes", kScene), keys);
  auto times = std::make_unique<RunTimes>();
  std::vector<std::unique_ptr<TimedBody>> bodies;
  std::unique_ptr<TimedActor> link;
  DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.wrap_body = [&](TaskId id, rt::TaskBody& body) -> rt::TaskBody* {
    bodies.push_back(std::make_unique<TimedBody>(body, (*times)[tasks::index_of(id)]));
    return bodies.back().get();
  };
  options.wrap_link = [&](rt::Actor& actor) -> rt::Actor* {
    link = std::make_unique<TimedActor>(actor, (*times)[kLink]);
    return link.get();
  };
  (void)run_virtual(nrt, *scene, options, reference_calibration());
  return *times;
}

// Of each job the least of all rounds. The same keys give the same jobs.
void keep_least(RunTimes& least, const RunTimes& round) {
  for (std::size_t t = 0; t < least.size(); ++t) {
    const auto keep = [](std::vector<std::int64_t>& a, const std::vector<std::int64_t>& b) {
      if (a.empty()) {
        a = b;
        return;
      }
      if (a.size() != b.size())
        throw std::runtime_error("bench effects: the same run twice was not the same");
      for (std::size_t i = 0; i < a.size(); ++i) a[i] = std::min(a[i], b[i]);
    };
    keep(least[t].own, round[t].own);
    keep(least[t].twin, round[t].twin);
  }
}

double mean_us(const std::vector<std::int64_t>& ns) {
  double sum = 0;
  for (const std::int64_t v : ns) sum += static_cast<double>(v);
  return ns.empty() ? 0 : 1e-3 * sum / static_cast<double>(ns.size());
}

// Of one job; of the link of a millisecond, in which it looks about once.
double cost_us(const RunTimes& times, const EffectRow& row, double seconds) {
  if (row.paid_by == std::string("link's thread")) {
    const auto& looks = times[kLink].own;
    return mean_us(looks) * static_cast<double>(looks.size()) / (1e3 * seconds);
  }
  const Payer p = payer_of(row);
  const JobTimes& t = times[tasks::index_of(p.task)];
  return mean_us(p.twin ? t.twin : t.own);
}

// How far a payer's cost is off in runs that change what somebody else pays for: four of five are
// no farther than this. With them the two runs of the same keys.
double floor_us(const std::vector<Switch>& all, const EffectRow& row,
                const std::map<Keys, RunTimes>& least, double base, double twice, double seconds) {
  std::vector<double> off{std::abs(base - twice)};
  for (const Switch& s : all) {
    const EffectRow* other = effect_named(s.name);
    if (std::string(other->paid_by) == row.paid_by || !s.base.empty() || !least.contains(s.keys))
      continue;
    off.push_back(std::abs(cost_us(least.at(s.keys), row, seconds) - 0.5 * (base + twice)));
  }
  return rt::quantile_in_place(std::span(off), 0.8);
}

}  // namespace

EffectCosts measure_effects(rt::NonRealtime& nrt, std::ostream& progress, double seconds,
                            int rounds, const std::string& only) {
  if (!only.empty() && effect_named(only) == nullptr)
    throw std::runtime_error("bench effects: no effect is called '" + only + "'");
  EffectCosts out;
  out.scene = kScene;
  out.seconds = seconds;
  out.rounds = rounds;
  const auto all = switches();
  // Each set of keys once a round, so that what the machine does meets all alike; what is compared
  // with twice.
  std::map<Keys, RunTimes> least, again;
  for (int round = 0; round < rounds; ++round) {
    progress << "round " << round + 1 << " of " << rounds << "\n";
    const auto take = [&](std::map<Keys, RunTimes>& into, const Keys& keys) {
      keep_least(into[keys], run_once(nrt, keys, seconds));
    };
    std::map<Keys, bool> done;
    for (const Switch& s : all) {
      if (!only.empty() && only != s.name) continue;
      if (!std::exchange(done[s.base], true)) {
        take(least, s.base);
        take(again, s.base);
      }
      take(least, s.keys);
    }
  }
  for (const EffectRow& row : effect_catalogue()) {
    const std::string name = row.name;
    if (!only.empty() && only != name) continue;
    const auto s =
        std::find_if(all.begin(), all.end(), [&](const Switch& x) { return name == x.name; });
    if (s == all.end()) {
      out.not_measured.push_back(name + ": without it nothing else of the run is the same");
      continue;
    }
    const double base = cost_us(least.at(s->base), row, seconds),
                 twice = cost_us(again.at(s->base), row, seconds),
                 changed = cost_us(least.at(s->keys), row, seconds);
    EffectCost e;
    e.name = name;
    const bool link = row.paid_by == std::string("link's thread");
    e.job = link ? "a millisecond of the link" : payer_of(row).job;
    e.us = s->off ? 0.5 * (base + twice) - changed : changed - 0.5 * (base + twice);
    // Of one effect alone there are no others to judge by.
    e.floor_us =
        only.empty() ? floor_us(all, row, least, base, twice, seconds) : 2 * std::abs(base - twice);
    out.rows.push_back(e);
  }
  return out;
}

}  // namespace teletact

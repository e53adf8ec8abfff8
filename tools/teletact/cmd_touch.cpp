// teletact touch: the haptic task on plain files. The field is cut into the windows fusion would
// publish, the hand is played from a table, and the very code of the 1 kHz task makes the force.
//
// Every column of the trace repeats byte by byte on the same input, except cpu_ns, which is
// measured.
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "rt/memory/non_realtime.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/haptic/run_file.hpp"
#include "tools/teletact/commands.hpp"
#include "tools/teletact/csv.hpp"
#include "tools/teletact/field_window.hpp"
#include "tools/teletact/metrics_json.hpp"
#include "tools/teletact/npy.hpp"
#include "tools/teletact/options.hpp"
#include "tools/teletact/touch_replay.hpp"
#include "tools/teletact/view_cast.hpp"
#include "tools/teletact/whole_file.hpp"

namespace teletact {

namespace {

using perception::Vec3;

struct TouchOptions {
  std::string field, fields, path, out, debug, json, origin = "0,0,0", method = "constrained";
  std::string view, passivity = "off", guard = "on", blend = "on", record, replay;
  std::string labels, palette;
  bool bump_normal = false;
  double voxel_m = 0, stiffness = 1000, tip_radius_m = 0, force_limit_N = 12, rate_hz = 0;
  double truncation_m = 0.05;
  double friction_static = 0, friction_dynamic = 0, viscosity = 0, paper_friction = 0;
  double texture_m = 0, texture_period_m = 0.002;
  double scale = 1, border_m = 0, border_rate_per_s = 2;
  int window_nodes = perception::SurfacePatch::kMaxNodes;
};

struct HandRow {
  double t = 0;
  Vec3 p = Vec3::Zero();
  bool clutch = false;
};

template <class T>
T must(rt::Result<T> result) {
  if (!result) throw std::runtime_error(result.error());
  return std::move(result).value();
}

Vec3 parse_origin(const std::string& text) {
  Vec3 out;
  int used = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf%n", &out.x(), &out.y(), &out.z(), &used) != 3 ||
      static_cast<std::size_t>(used) != text.size() || !out.allFinite() || out.norm() > 1e6) {
    throw std::runtime_error("--origin '" + text + "': three finite numbers x,y,z in metres");
  }
  return out;
}

void check(bool ok, const std::string& what) {
  if (!ok) throw std::runtime_error(what);
}

bool on_off(const std::string& value, const std::string& option) {
  check(value == "on" || value == "off", option + " '" + value + "': allowed are on, off");
  return value == "on";
}

using Palette = std::array<perception::Material, perception::SurfacePatch::kMaxMaterials>;

// The fields and from when each of them is visible; their labels and what these mean.
struct FieldList {
  std::vector<double> from;
  std::vector<DenseField> fields;
  Palette palette{};

  // Those that are visible at t, of which the last one counts.
  [[nodiscard]] std::size_t visible(double t, std::size_t at_least) const {
    while (at_least < from.size() && t >= from[at_least] - 1e-9) ++at_least;
    return at_least;
  }
};

// A row a label: label, stiffness, friction, friction_dynamic, texture_m, texture_period_m. What is not named has the
// label 0's ordinary surface. True for the labels that have a row.
std::array<bool, 256> load_palette(const std::string& path, Palette& palette) {
  const CsvTable table = must(read_csv(path));
  struct Column {
    const char* name;
    double lo, hi;
    float perception::Material::*to;
  };
  using M = perception::Material;
  constexpr std::array kColumns{Column{"stiffness", 0.01, 1, &M::stiffness_scale},
                                Column{"friction", 0, 2, &M::friction_static},
                                Column{"friction_dynamic", 0, 2, &M::friction_dynamic},
                                Column{"texture_m", 0, 0.002, &M::texture_amplitude_m},
                                Column{"texture_period_m", 0.0004, 0.1, &M::texture_period_m}};
  std::array<bool, 256> named{};
  const int label = table.column("label");
  check(label >= 0, path + ": a column 'label' is needed");
  for (const std::string& name : table.header) {
    const bool known =
        name == "label" || std::any_of(kColumns.begin(), kColumns.end(),
                                       [&](const auto& c) { return name == c.name; });
    check(known, path + ": column '" + name +
                     "'; allowed are label, stiffness, friction, friction_dynamic, texture_m, "
                     "texture_period_m");
  }
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const std::string where = path + ":" + std::to_string(table.lines[i]) + ": ";
    const double id = must(table.number(i, static_cast<std::size_t>(label)));
    check(id >= 0 && id < static_cast<double>(palette.size()) && id == std::floor(id),
          where + "label " + table.rows[i][static_cast<std::size_t>(label)] +
              ": allowed are 0 to " + std::to_string(palette.size() - 1));
    const auto slot = static_cast<std::size_t>(id);
    check(!named[slot], where + "label " + std::to_string(slot) + " has a row already");
    named[slot] = true;
    M& m = palette[slot];
    m.texture_period_m = 0.002F;
    for (const Column& c : kColumns) {
      const int at = table.column(c.name);
      if (at < 0) continue;
      const double value = must(table.number(i, static_cast<std::size_t>(at)));
      std::ostringstream text;
      text << where << c.name << " " << value << ": allowed are " << c.lo << " to " << c.hi;
      check(value >= c.lo && value <= c.hi, text.str());
      m.*c.to = static_cast<float>(value);
    }
    if (table.column("friction_dynamic") < 0) m.friction_dynamic = 0.8F * m.friction_static;
    check(m.friction_dynamic <= m.friction_static, where + "friction_dynamic is above friction");
  }
  return named;
}

void load_materials(const TouchOptions& o, FieldList& out) {
  if (o.palette.empty()) return;
  const std::array<bool, 256> named = load_palette(o.palette, out.palette);
  if (o.labels.empty()) return;
  NpyLabels labels = must(read_npy_labels(o.labels));
  const auto stray = std::find_if(labels.values.begin(), labels.values.end(),
                                  [&](const std::uint8_t label) { return !named[label]; });
  check(stray == labels.values.end(),
        o.labels + ": label " +
            (stray == labels.values.end() ? std::string() : std::to_string(*stray)) +
            " has no row in " + o.palette + " (allowed are 0 to 15)");
  for (DenseField& field : out.fields) {
    bool same = labels.shape.size() == 3;
    for (std::size_t a = 0; a < 3 && same; ++a) {
      same = labels.shape[a] == static_cast<std::size_t>(field.size[a]);
    }
    check(same, o.labels + ": its shape is not the field's");
    field.label = labels.values;
  }
}

FieldList load_distances(const TouchOptions& o) {
  FieldList out;
  if (!o.field.empty()) {
    out.from.push_back(-HUGE_VAL);
    out.fields.push_back(must(to_field(must(read_npy(o.field)), o.field)));
    return out;
  }
  const CsvTable table = must(read_csv(o.fields));
  check((table.header.empty() ? table.rows.front().size() : table.header.size()) == 2,
        o.fields + ": two columns t_s,file are needed");
  const auto folder = std::filesystem::path(o.fields).parent_path();
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const double t = must(table.number(i, 0));
    check(out.from.empty() || t > out.from.back(),
          o.fields + ":" + std::to_string(table.lines[i]) + ": t_s must rise from row to row");
    const std::filesystem::path file(table.rows[i][1]);
    const std::string path = file.is_absolute() ? file.string() : (folder / file).string();
    out.from.push_back(t);
    out.fields.push_back(must(to_field(must(read_npy(path)), path)));
  }
  return out;
}

FieldList load_fields(const TouchOptions& o) {
  FieldList out = load_distances(o);
  load_materials(o, out);
  return out;
}

// The hand at every tick: the rows themselves, or the rows interpolated to another rate.
std::vector<HandRow> load_hand(const TouchOptions& o, double& period_s) {
  const CsvTable table = must(read_csv(o.path));
  const auto rows = must(numeric_rows(table, {"t_s", "x", "y", "z"}));
  const int clutch = table.column("clutch");
  std::vector<HandRow> hand;
  hand.reserve(rows.size());
  for (const auto& r : rows) {
    hand.push_back({r[0], Vec3(r[1], r[2], r[3])});
    if (clutch >= 0) {
      const double held = must(table.number(hand.size() - 1, static_cast<std::size_t>(clutch)));
      check(held == 0 || held == 1, o.path + ": clutch is 0 or 1");
      hand.back().clutch = held == 1;
    }
    check(hand.back().p.norm() < 1000, o.path + ": a position more than 1000 m away");
  }
  const double spacing =
      hand.size() > 1 ? (hand.back().t - hand.front().t) / static_cast<double>(hand.size() - 1)
                      : 1e-3;
  period_s = o.rate_hz > 0 ? 1.0 / o.rate_hz : spacing;
  check(
      period_s >= 1e-5 && period_s <= 0.1,
      o.path + ": row spacing of " + std::to_string(period_s) + " s; allowed are 10 us to 100 ms");
  check((hand.back().t - hand.front().t) / period_s < 1e8, o.path + ": too long a time");
  if (o.rate_hz <= 0 || std::abs(spacing - period_s) <= 1e-3 * period_s) {
    for (std::size_t i = 1; i < hand.size(); ++i) {
      const double gap = hand[i].t - hand[i - 1].t;
      check(std::abs(gap - period_s) <= 0.5 * period_s,
            o.path + ": row " + std::to_string(i + 1) + " is " + std::to_string(gap) +
                " s after the one before; rows are ticks, " + std::to_string(period_s) +
                " s apart: give --rate to have them interpolated");
    }
    return hand;
  }
  std::vector<HandRow> out;
  std::size_t i = 0;
  for (std::size_t k = 0;; ++k) {
    const double t = hand.front().t + static_cast<double>(k) * period_s;
    if (t > hand.back().t + 1e-9) break;
    while (i + 2 < hand.size() && hand[i + 1].t <= t) ++i;
    const HandRow &a = hand[i], &b = hand[std::min(i + 1, hand.size() - 1)];
    const double s = b.t > a.t ? std::clamp((t - a.t) / (b.t - a.t), 0.0, 1.0) : 0.0;
    out.push_back({t, (1 - s) * a.p + s * b.p, a.clutch});
  }
  return out;
}

std::int64_t thread_cpu_ns() noexcept {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<std::int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec;
}

// Publishes windows as fusion does: every 1/30 s, and at once when another field becomes visible. The newest one waits
// until the task takes it, so what the task still blends is never written over, however fast the fields change.
class WindowSource {
 public:
  WindowSource(const FieldList& fields, const TouchOptions& o, const Vec3& origin)
      : fields_(fields), options_(o), origin_(origin) {
    for (auto& slot : slots_) slot = std::make_unique<perception::SurfacePatch>();
  }
  // The newest window at time t for a task that takes one (`wanted`); null: none.
  const perception::SurfacePatch* at(double t, rt::Time now, const Vec3& hand, const Vec3& velocity,
                                     bool wanted) {
    const std::size_t field = fields_.visible(t, visible_);
    if (field == 0) return nullptr;
    const bool other = field != visible_;
    if (other || t >= next_ - 1e-9) {
      visible_ = field;
      constexpr double kPeriod_s = 1.0 / 30.0;
      next_ = (other || seq_ == 0 ? t : next_) + kPeriod_s;
      ++seq_;
      fused_ = now;
      centre_ = hand + velocity * (2 * kPeriod_s) - origin_;
    }
    if (!wanted) return nullptr;
    if (slots_[current_]->seq != seq_) {
      current_ = (current_ + 1) % slots_.size();
      perception::SurfacePatch& patch = *slots_[current_];
      patch.seq = seq_;
      patch.fused = patch.exposure = fused_;
      patch.palette = fields_.palette;
      fill_window(fields_.fields[visible_ - 1], centre_, options_.voxel_m, options_.truncation_m,
                  options_.window_nodes, patch);
    }
    return slots_[current_].get();
  }
  // Fields that were visible so far.
  [[nodiscard]] std::size_t visible() const { return visible_; }

 private:
  const FieldList& fields_;
  const TouchOptions& options_;
  const Vec3 origin_;
  // The task holds two at most, and one is filled only when it holds a single one.
  std::array<std::unique_ptr<perception::SurfacePatch>, 3> slots_;
  std::size_t visible_ = 0, current_ = 0;
  std::uint64_t seq_ = 0;
  double next_ = 0;
  rt::Time fused_{};  // of the newest
  Vec3 centre_ = Vec3::Zero();
};

// The points that force_shading reduces over: one full ray cast of each field, when it becomes
// visible.
class SurfaceSource {
 public:
  SurfaceSource(const FieldList& fields, const TouchOptions& o, const Vec3& origin,
                const std::vector<HandRow>& hand)
      : fields_(fields), options_(o) {
    wanted_ = o.method == "force_shading";
    check(wanted_ || o.view.empty(), "--view: only the method force_shading has a view");
    if (!wanted_) return;
    if (!o.view.empty()) {
      view_ = parse_view(o.view);
      view_.eye -= origin;
      view_.look -= origin;
      return;
    }
    FirstContact first;
    std::size_t visible = 0;
    for (const HandRow& row : hand) {
      visible = fields.visible(row.t, visible);
      if (visible == 0) continue;
      const auto view = first.at(fields.fields[visible - 1], o.voxel_m, row.p - origin);
      if (!view) continue;
      view_ = *view;
      break;
    }
  }
  // Null: as before.
  const tasks::SurfacePoints* at(std::size_t visible) {
    if (!wanted_ || visible == 0 || visible == cast_) return nullptr;
    cast_ = visible;
    current_ = 1 - current_;
    cast_view(fields_.fields[visible - 1], options_.voxel_m, view_, points_[current_]);
    return &points_[current_];
  }

 private:
  static View parse_view(const std::string& text) {
    View out;
    Vec3 &e = out.eye, &l = out.look;
    int used = 0;
    const int n = std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf%n", &e.x(), &e.y(), &e.z(),
                              &l.x(), &l.y(), &l.z(), &used);
    check(n == 6 && static_cast<std::size_t>(used) == text.size() && e.allFinite() &&
              l.allFinite() && e.norm() < 1e6 && l.norm() < 1e6 && (e - l).norm() > 1e-6,
          "--view '" + text + "': six finite numbers, eye x,y,z and look x,y,z in metres, apart");
    return out;
  }

  const FieldList& fields_;
  const TouchOptions& options_;
  bool wanted_ = false;
  View view_;
  std::array<tasks::SurfacePoints, 2> points_;
  std::size_t cast_ = 0, current_ = 0;
};

void write_debug(std::FILE* f, double t, const tasks::HapticTask::Out& out, int constraints) {
  const auto& m = out.telemetry;
  std::fprintf(f, "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%d,%d,%d,%d,%d,%d,%d,%d,%u,%.9g,%.9g,%.9g,%.9g\n",
               t, m.f_raw_D.x(), m.f_raw_D.y(), m.f_raw_D.z(), m.step_raw_N, m.step_N,
               m.in_contact ? 1 : 0, constraints, m.guard_active ? 1 : 0, m.guard_use ? 1 : 0,
               m.limit_active ? 1 : 0, m.held ? 1 : 0, m.near_edge ? 1 : 0, m.unresolved ? 1 : 0,
               m.work, m.gain, m.blend, m.energy_J, m.booked_J);
}

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
  [[nodiscard]] Metrics metrics() {
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
    std::sort(contact_cpu_us_.begin(), contact_cpu_us_.end());
    const auto at = [&](double q) {
      return contact_cpu_us_[static_cast<std::size_t>(q * (contact - 1) + 0.5)];
    };
    m.add("touch.cpu_p50_us", at(0.5), "us");
    m.add("touch.cpu_p99_us", at(0.99), "us");
    return m;
  }

 private:
  std::size_t ticks_ = 0, guarded_ = 0;
  double force_N_ = 0, step_N_ = 0, step_raw_N_ = 0;
  std::vector<double> contact_cpu_us_;
};

void run(const TouchOptions& o) {
  const Vec3 origin = parse_origin(o.origin);
  double period_s = 1e-3;
  const std::vector<HandRow> hand = load_hand(o, period_s);
  const FieldList fields = load_fields(o);

  tasks::HapticConfig config;
  config.method = o.method;
  config.stiffness_N_per_m = o.stiffness;
  config.tip_radius_m = o.tip_radius_m;
  config.force_limit_N = o.force_limit_N;
  config.workspace_W_m = {-origin.x(), -origin.y(), -origin.z()};
  config.passivity_controller = on_off(o.passivity, "--passivity");
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
  config.patch_liveness_s = std::max(config.patch_liveness_s, 4 * period_s);
  // No device here: nothing bounds the stiffness.
  drivers::DeviceProperties device;
  device.damping_N_s_per_m = 1e12;
  device.force_limit_N = o.force_limit_N;

  rt::Startup startup;
  tasks::HapticTask task(startup.token(), config, device, period_s);
  WindowSource windows(fields, o, origin);
  SurfaceSource surface(fields, o, origin, hand);
  WholeFile trace(o.out);
  std::unique_ptr<WholeFile> debug;
  if (!o.debug.empty()) debug = std::make_unique<WholeFile>(o.debug);
  std::fprintf(trace.get(), "t_s,hx,hy,hz,px,py,pz,fx,fy,fz,contacts,cpu_ns\n");
  if (debug) {
    std::fprintf(
        debug->get(),
        "t_s,raw_fx,raw_fy,raw_fz,raw_step_N,step_N,in_contact,constraints,guard_active,"
        "guard_use,limit_active,held,near_edge,unresolved,field_samples,gain,blend,energy_J,"
        "booked_J\n");
  }
  std::unique_ptr<WholeFile> run_file;
  std::unique_ptr<HapticRunWriter> writer;
  if (!o.record.empty()) {
    run_file = std::make_unique<WholeFile>(o.record);
    writer = std::make_unique<HapticRunWriter>(run_file->get(),
                                               HapticRunHeader{config, device, period_s, origin});
  }
  // The path is the device's; where the scene's hand is, the workspace says.
  const bool mapped = o.scale != 1 || o.border_m > 0 ||
                      std::any_of(hand.begin(), hand.end(), [](const auto& r) { return r.clutch; });
  Vec3 scene_before = Vec3::Zero();
  std::uint64_t recorded_window = 0;
  Tally tally;
  tasks::HapticTask::In in;
  tasks::HapticTask::Out out;
  in.mode.seq = 1;
  in.mode.mode = tasks::Mode::kHold;
  in.stylus_ok = true;
  in.stylus.state = drivers::DeviceState::kForce;
  for (std::size_t k = 0; k < hand.size(); ++k) {
    const HandRow& row = hand[k];
    const rt::Time now{rt::nanos_from_seconds(row.t - hand.front().t)};
    const Vec3 scene = mapped ? Vec3(task.to_world(row.p) + origin) : row.p;
    const Vec3 velocity =
        k > 0 ? Vec3((scene - scene_before) / (row.t - hand[k - 1].t)) : Vec3::Zero();
    scene_before = scene;
    const auto* newest = windows.at(row.t, now, scene, velocity, task.wants_patch());
    in.patch_newest = newest;
    in.surface = surface.at(windows.visible());
    in.clutch = row.clutch;
    if (writer && newest != nullptr && newest->seq != recorded_window) {
      recorded_window = newest->seq;
      writer->window(*newest);
    }
    if (writer && in.surface != nullptr) writer->surface(*in.surface);
    in.stylus.seq = k + 1;
    in.stylus.taken = now;
    in.stylus.p_DH = row.p;
    rt::Tick tick;
    tick.k = k;
    tick.release = tick.start = now;
    tick.period = rt::nanos_from_seconds(period_s);
    const std::int64_t before = thread_cpu_ns();
    (void)task.step(tick, in, out);
    const std::int64_t cpu_ns = thread_cpu_ns() - before;
    tally.add(out, cpu_ns);
    if (writer) writer->tick(run_tick(tick, in, out));
    const Vec3 p = out.state.p_WP + origin;
    const Vec3 h = mapped ? Vec3(out.state.p_WH + origin) : row.p;
    const Vec3& f = out.force.f_H_D;
    std::fprintf(trace.get(), "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%d,%lld\n", row.t,
                 h.x(), h.y(), h.z(), p.x(), p.y(), p.z(), f.x(), f.y(), f.z(), out.state.contacts,
                 static_cast<long long>(cpu_ns));
    if (debug) write_debug(debug->get(), row.t, out, out.state.contacts);
  }
  if (writer) writer->finish();
  write_outputs({{o.debug, [&](const auto&) { debug->finish(); }},
                 {o.record, [&](const auto&) { run_file->finish(); }},
                 {o.out, [&](const auto&) { trace.finish(); }},
                 {o.json, [&](const auto& path) { tally.metrics().write(path); }}});
}

}  // namespace

int cmd_touch(int argc, char** argv) {
  TouchOptions o;
  CLI::App app("teletact touch: renders a distance field along a hand path", "teletact touch");
  app.add_option("--field", o.field,
                 "NPY, float32, signed distance in m, positive outside, NaN = "
                 "unobserved, C order x,y,z");
  app.add_option("--fields", o.fields, "CSV t_s,file: fields that replace each other");
  app.add_option("--voxel", o.voxel_m, "node distance, m");
  app.add_option("--origin", o.origin, "x,y,z of node (0,0,0), m")->capture_default_str();
  app.add_option("--path", o.path,
                 "CSV t_s,x,y,z of the hand, m; a column clutch of 0 and 1 may follow");
  app.add_option("--method", o.method, std::string(tasks::kProxyMethods))->capture_default_str();
  app.add_option("--view", o.view,
                 "eye,look: six numbers x,y,z,x,y,z in m; the camera that force_shading casts from "
                 "(default: 1 m off the first contact)");
  app.add_option("--out", o.out, "trace CSV to write")->required();
  app.add_option("--debug", o.debug, "CSV with raw force, guards, constraints per tick");
  app.add_option("--json", o.json, "write the figures to this file");
  app.add_option("--stiffness", o.stiffness, "N/m")->capture_default_str();
  app.add_option("--tip-radius", o.tip_radius_m, "m")->capture_default_str();
  app.add_option("--force-limit", o.force_limit_N, "N")->capture_default_str();
  app.add_option("--rate", o.rate_hz, "ticks a second; default: one tick a row");
  app.add_option("--truncation", o.truncation_m, "m")->capture_default_str();
  app.add_option("--window", o.window_nodes, "nodes along an edge of the window")
      ->capture_default_str();
  app.add_option("--passivity", o.passivity, "on or off")->capture_default_str();
  app.add_option("--guard", o.guard, "slew guard, on or off")->capture_default_str();
  app.add_option("--blend", o.blend, "blend of windows, on or off")->capture_default_str();
  app.add_option("--friction", o.friction_static, "mu of rest; 0: none")->capture_default_str();
  app.add_option("--friction-dynamic", o.friction_dynamic,
                 "mu of slip; default: 0.8 of --friction");
  app.add_option("--paper-friction", o.paper_friction, "mu of the circle of force_shading");
  app.add_option("--texture", o.texture_m, "height of the bumps, m; 0: smooth");
  app.add_option("--texture-period", o.texture_period_m, "m")->capture_default_str();
  app.add_flag("--bump-normal", o.bump_normal,
               "bumps as a perturbed normal, as published, instead of a height");
  app.add_option("--palette", o.palette,
                 "CSV label,stiffness,friction,friction_dynamic,texture_m,texture_period_m: the "
                 "surface of each label, 0 to 15; stiffness is a share of --stiffness");
  app.add_option("--labels", o.labels, "NPY, uint8, the field's shape: the label of each node");
  app.add_option("--viscosity", o.viscosity, "drag of the hand, N s/m");
  app.add_option("--scale", o.scale, "scene metres per metre of the path")->capture_default_str();
  app.add_option("--border", o.border_m,
                 "rate control beyond this distance from the path's origin, m");
  app.add_option("--border-rate", o.border_rate_per_s, "m/s per m beyond the border")
      ->capture_default_str();
  app.add_option("--record", o.record, "haptic run to write: windows, hand, forces");
  app.add_option(
      "--replay", o.replay,
      "haptic run to touch again instead of --field and --path: as it was, to the last bit, "
      "or with another --method");
  if (!parse_options(app, argc, argv)) return 0;
  if (!o.replay.empty()) {
    for (const char* other : {"--field", "--fields", "--voxel", "--path", "--record", "--rate"}) {
      check(app.count(other) == 0, std::string(other) + " has no meaning with --replay");
    }
    check_outputs({{"--out", o.out}, {"--json", o.json}}, {o.replay});
    return replay_touch({o.replay, app.count("--method") > 0 ? o.method : "", o.out, o.json});
  }
  check(!o.path.empty(), "--path is required");
  check(app.count("--voxel") > 0, "--voxel is required");
  check(o.field.empty() != o.fields.empty(), "one of --field and --fields is needed");
  const auto within = [](double v, double lo, double hi, const char* option) {
    std::ostringstream text;
    text << option << " " << v << ": allowed are " << lo << " to " << hi;
    check(v >= lo && v <= hi, text.str());
  };
  within(o.voxel_m, 1e-4, 1, "--voxel");
  within(o.stiffness, 1, 1e5, "--stiffness");
  within(o.truncation_m, 1e-3, 1, "--truncation");
  within(o.tip_radius_m, 0, 0.8 * o.truncation_m, "--tip-radius");
  within(o.force_limit_N, 0.01, 1000, "--force-limit");
  if (app.count("--friction-dynamic") == 0) o.friction_dynamic = 0.8 * o.friction_static;
  within(o.friction_static, 0, 2, "--friction");
  within(o.friction_dynamic, 0, std::max(o.friction_static, 1e-9), "--friction-dynamic");
  within(o.paper_friction, 0, 2, "--paper-friction");
  within(o.texture_m, 0, 0.002, "--texture");
  within(o.texture_period_m, 0.0004, 0.1, "--texture-period");
  within(o.viscosity, 0, 5, "--viscosity");
  within(o.window_nodes, 8, perception::SurfacePatch::kMaxNodes, "--window");
  within(o.scale, 0.01, 100, "--scale");
  within(o.border_m, 0, 1, "--border");
  within(o.border_rate_per_s, 0, 20, "--border-rate");
  if (app.count("--rate") > 0) within(o.rate_hz, 10, 1e5, "--rate");
  check(o.labels.empty() || !o.palette.empty(), "--labels needs --palette");
  if (!o.palette.empty()) {
    for (const char* other :
         {"--friction", "--friction-dynamic", "--texture", "--texture-period"}) {
      check(app.count(other) == 0,
            std::string(other) + " has no meaning with --palette: the surface is the label's");
    }
  }
  check(!o.bump_normal || o.texture_m > 0 || !o.palette.empty(),
        "--bump-normal needs --texture or --palette");
  check(o.window_nodes % 4 == 0, "--window must be a multiple of 4");
  check_outputs(
      {{"--out", o.out}, {"--debug", o.debug}, {"--json", o.json}, {"--record", o.record}},
      {o.field, o.fields, o.path, o.labels, o.palette});
  run(o);
  return 0;
}

}  // namespace teletact

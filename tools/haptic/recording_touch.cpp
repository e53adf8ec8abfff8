#include "tools/haptic/recording_touch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>

#include "perception/raycast/raycast.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/bench/fusion_sequence.hpp"
#include "tools/haptic/pop_checker.hpp"
#include "tools/plot/svg.hpp"

namespace teletact {

using perception::Pose;
using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr double kFrame_s = 1.0 / 30;

// Frame of the recording that plays as number i: forward, back, forward.
int played(int i, int count) {
  const int round = 2 * (count - 1), k = i % round;
  return k < count ? k : round - k;
}

// The recording through fusion, frame by frame, in virtual time.
class Player {
 public:
  Player(rt::NonRealtime& nrt, const FusionSequence& sequence)
      : sequence_(sequence), frame_(std::make_unique<perception::RgbdFrame>()) {
    tasks::FusionConfig config;
    config.view_period_frames = 0;
    config.patch_checksums = false;
    config.objects.enabled = false;
    tasks::FusionSetup setup;
    setup.camera = sequence.intrinsics;
    task_ = std::make_unique<tasks::FusionTask>(nrt, config, setup);
  }
  // The next frame; fills `patch`, if there is one, with the window at the hand.
  void next(const Vec3& p_WH, const Vec3& v_WH, SurfacePatch* patch) {
    sequence_.frame(played(count_, sequence_.size()), *frame_);
    const rt::Time now = rt::time_from_ns(0) + rt::Nanos{std::llround(1e9 * kFrame_s * count_)};
    frame_->exposure = now;
    frame_->seq = static_cast<std::uint64_t>(count_);
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(count_);
    tick.release = tick.start = now;
    tasks::FusionTask::In in;
    in.frame = frame_.get();
    in.frame_fresh = true;
    in.hand.seq = static_cast<std::uint64_t>(count_) + 1;
    in.hand.p_WH = p_WH;
    in.hand.v_WH = v_WH;
    tasks::FusionTask::Out out;
    out.patch = patch;
    (void)task_->step(tick, in, out);
    integrated_ += out.integrated ? 1 : 0;
    ++count_;
  }
  [[nodiscard]] const tasks::FusionTask& task() const { return *task_; }
  [[nodiscard]] int integrated() const { return integrated_; }
  [[nodiscard]] int count() const { return count_; }

 private:
  const FusionSequence& sequence_;
  std::unique_ptr<perception::RgbdFrame> frame_;
  std::unique_ptr<tasks::FusionTask> task_;
  int count_ = 0, integrated_ = 0;
};

// One method on the trace.
class Toucher {
 public:
  Toucher(rt::NonRealtime& nrt, const std::string& method, std::size_t places)
      : task_(nrt, config_of(method), device(), 1e-3) {
    row_.method = method;
    row_.place_contact_s.resize(places);
    in_.mode.seq = 1;
    in_.mode.mode = tasks::Mode::kHold;
    in_.stylus_ok = true;
    in_.stylus.state = drivers::DeviceState::kForce;
  }
  void tick(std::uint64_t k, const Vec3& p_DH, const SurfacePatch* newest,
            const tasks::SurfacePoints* surface, int place) {
    tick_.k = k;
    tick_.release = tick_.start =
        rt::time_from_ns(0) + rt::Nanos{1000000 * static_cast<std::int64_t>(k)};
    tick_.period = rt::Nanos{1000000};
    in_.patch_newest = task_.wants_patch() ? newest : nullptr;
    in_.surface = surface;
    in_.stylus.seq = k + 1;
    in_.stylus.taken = tick_.release;
    const double moved = k > 0 ? (p_DH - in_.stylus.p_DH).norm() : 0;
    in_.stylus.p_DH = p_DH;
    pops_.offer(in_.patch_newest);
    (void)task_.step(tick_, in_, out_);
    count(moved, place);
  }
  [[nodiscard]] HapticRunTick recorded() const { return run_tick(tick_, in_, out_); }
  [[nodiscard]] const tasks::HapticConfig& config() const { return task_.config(); }
  static drivers::DeviceProperties device() {
    drivers::DeviceProperties d;
    d.damping_N_s_per_m = 1e12;  // no device: nothing bounds the stiffness
    return d;
  }
  TouchedRow finish() {
    row_.sunk = pops_.sunk();
    row_.flipped = pops_.flipped();
    row_.unknown = pops_.unknown();
    row_.deepest_mm = 1e3 * pops_.deepest_m();
    return std::move(row_);
  }

 private:
  static tasks::HapticConfig config_of(const std::string& method) {
    tasks::HapticConfig c;
    c.method = method;
    return c;
  }
  void count(double moved, int place) {
    const auto& t = out_.telemetry;
    const Vec3& f = out_.force.f_H_D;
    ++row_.ticks;
    if (!f.allFinite() || !t.f_raw_D.allFinite() || !out_.state.p_WP.allFinite()) ++row_.not_finite;
    row_.force_N.push_back(static_cast<float>(f.norm()));
    row_.step_raw_N.push_back(static_cast<float>(t.step_raw_N));
    row_.force_max_N = std::max(row_.force_max_N, f.norm());
    row_.step_max_N = std::max(row_.step_max_N, t.step_N);
    const std::uint64_t sunk = pops_.sunk(), flipped = pops_.flipped();
    pops_.judge(t.in_contact, out_.state.p_WP, out_.state.p_WH, t.blend);
    if (!t.in_contact) {
      run_ = 0;
      return;
    }
    ++row_.contact;
    row_.stretch_max_mm = std::max(row_.stretch_max_mm, 1e3 * t.penetration_m);
    if (place >= 0) row_.place_contact_s[static_cast<std::size_t>(place)] += 1e-3;
    row_.step_raw_max_N = std::max(row_.step_raw_max_N, t.step_raw_N);
    const bool jump = t.step_raw_N > task_.config().stiffness_N_per_m * moved + 0.5;
    run_ = jump ? run_ + 1 : 0;
    row_.jumps += jump ? 1 : 0;
    row_.longest_jump = std::max(row_.longest_jump, run_);
    const bool fell = pops_.sunk() > sunk, turned = pops_.flipped() > flipped;
    if ((jump || fell || turned) && row_.events.size() < 20) {
      row_.events.push_back({1e-3 * static_cast<double>(tick_.k), t.step_raw_N, turned, fell,
                             out_.state.p_WH, out_.state.p_WP});
    }
  }
  tasks::HapticTask task_;
  tasks::HapticTask::In in_;
  tasks::HapticTask::Out out_;
  rt::Tick tick_;
  PopChecker pops_;
  TouchedRow row_;
  std::uint64_t run_ = 0;
};

// One full ray cast of the map from the last fused camera, as the published method takes it.
void cast_surface(const tasks::FusionTask& fusion, const perception::Intrinsics& camera,
                  perception::RaycastMaps& maps, tasks::SurfacePoints& out) {
  perception::RaycastOptions options;
  options.min_weight = 2;
  (void)perception::raycast(fusion.map(), camera, fusion.camera(), options, maps);
  out.resize(static_cast<std::size_t>(maps.width()) * static_cast<std::size_t>(maps.height()));
  ++out.seq;
  for (int v = 0; v < maps.height(); ++v) {
    for (int u = 0; u < maps.width(); ++u) {
      if (!maps.hit(u, v)) continue;
      out.set(static_cast<std::size_t>(v) * static_cast<std::size_t>(maps.width()) +
                  static_cast<std::size_t>(u),
              maps.X_WC * maps.vertex_C(u, v).cast<double>(),
              maps.X_WC.linear() * maps.normal_C(u, v).cast<double>());
    }
  }
}

MapPath path_on_final_map(std::ostream& progress, rt::NonRealtime& nrt,
                          const FusionSequence& sequence, const RecordingTouchOptions& o,
                          int frames) {
  Player player(nrt, sequence);
  std::vector<Pose> views;
  Vec3 up = Vec3::Zero();
  const int look = std::max(1, std::min(frames, sequence.size()) / 6);
  for (int i = 0; i < frames; ++i) {
    player.next(Vec3::Zero(), Vec3::Zero(), nullptr);
    if (i >= sequence.size()) continue;
    const Pose& X = player.task().camera();
    up -= X.linear().col(1);  // the camera is held upright
    if (i % look == look / 2) views.push_back(X);
    if (i % 300 == 299) progress << i + 1 << " frames fused\n";
  }
  progress << player.integrated() << " of " << frames << " frames fused: the final map\n";
  MapPathOptions options;
  options.seed = o.seed;
  options.seconds = o.seconds;
  return make_map_path(player.task().map(), sequence.intrinsics, views, up.normalized(), options);
}

}  // namespace

RecordingTouchResult touch_recording(std::ostream& progress, const RecordingTouchOptions& o) {
  rt::Startup startup;
  auto& nrt = startup.token();
  const FusionSequence sequence = recorded_sequence(progress, o.rgbd, {o.frames, 2, o.pinhole});
  const int frames = static_cast<int>(std::lround(o.seconds * 30));
  const MapPath path = path_on_final_map(progress, nrt, sequence, o, frames);

  RecordingTouchResult r;
  r.seconds = o.seconds;
  r.places = path.places;
  Player player(nrt, sequence);
  std::vector<std::unique_ptr<Toucher>> touchers;
  touchers.push_back(std::make_unique<Toucher>(nrt, "constrained", path.places.size()));
  if (o.beside) {
    for (const char* method : {"nearest", "force_shading"}) {
      touchers.push_back(std::make_unique<Toucher>(nrt, method, path.places.size()));
    }
  }
  std::unique_ptr<HapticRunWriter> writer;
  if (o.record != nullptr) {
    HapticRunHeader header;
    header.config = touchers.front()->config();
    header.device = Toucher::device();
    writer = std::make_unique<HapticRunWriter>(o.record, header);
  }
  std::array<std::unique_ptr<SurfacePatch>, 8> windows;
  for (auto& w : windows) w = std::make_unique<SurfacePatch>();
  perception::RaycastMaps maps(nrt, sequence.intrinsics.width, sequence.intrinsics.height);
  std::array<tasks::SurfacePoints, 2> surfaces;
  std::size_t window = 0, surface = 0;
  for (std::size_t k = 0; k < path.hand_W.size(); ++k) {
    const Vec3& h = path.hand_W[k];
    const Vec3 v = k > 0 ? Vec3((h - path.hand_W[k - 1]) * 1000) : Vec3::Zero();
    r.hand_speed_max_m_per_s = std::max(r.hand_speed_max_m_per_s, v.norm());
    const tasks::SurfacePoints* fresh = nullptr;
    if (static_cast<double>(k) * 1e-3 >= player.count() * kFrame_s - 1e-9) {
      window = (window + 1) % windows.size();
      player.next(h, v, windows[window].get());
      if (writer) writer->window(*windows[window]);
      if (o.beside) {
        surface = 1 - surface;
        cast_surface(player.task(), sequence.intrinsics, maps, surfaces[surface]);
        fresh = &surfaces[surface];
      }
      if (player.count() % 300 == 0) progress << player.count() << " frames touched\n";
    }
    for (auto& t : touchers) t->tick(k, h, windows[window].get(), fresh, path.place[k]);
    if (writer) writer->tick(touchers.front()->recorded());
  }
  if (writer) writer->finish();
  r.frames_played = player.count();
  r.integrated = player.integrated();
  for (auto& t : touchers) r.rows.push_back(t->finish());
  return r;
}

int RecordingTouchResult::surfaces_touched() const {
  const auto& s = rows.front().place_contact_s;
  return static_cast<int>(std::count_if(s.begin(), s.end(), [](double t) { return t >= 0.5; }));
}

std::vector<BenchMetric> RecordingTouchResult::metrics() const {
  std::vector<BenchMetric> m{{"haptic.recording.frames", static_cast<double>(frames_played), "1"},
                             {"haptic.recording.integrated", static_cast<double>(integrated), "1"},
                             {"haptic.recording.surfaces", surfaces_touched() * 1.0, "1"}};
  for (const TouchedRow& row : rows) {
    const std::string name = "haptic.recording." + row.method + ".";
    m.push_back({name + "contact_s", 1e-3 * static_cast<double>(row.contact), "s"});
    m.push_back({name + "jump_share", row.jump_share(), "1"});
    m.push_back({name + "jump_longest_ticks", static_cast<double>(row.longest_jump), "1"});
    m.push_back({name + "step_raw_max_N", row.step_raw_max_N, "N"});
    m.push_back({name + "not_finite", static_cast<double>(row.not_finite), "1"});
    m.push_back({name + "pops", static_cast<double>(row.sunk + row.flipped), "1"});
  }
  return m;
}

void RecordingTouchResult::print(std::ostream& out) const {
  char line[300];
  std::snprintf(line, sizeof line,
                "%.0f s of virtual time: %d frames played, %d integrated; hand at most %.0f mm/s\n",
                seconds, frames_played, integrated, 1e3 * hand_speed_max_m_per_s);
  out << line;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Place& p = places[i];
    std::snprintf(line, sizeof line, "  %-7s at (%.2f, %.2f, %.2f): %.1f s in contact\n",
                  name_of(p.kind), p.p_W.x(), p.p_W.y(), p.p_W.z(),
                  rows.front().place_contact_s[i]);
    out << line;
  }
  out << "                contact  raw steps over K|dh| + 0.5 N     largest step N   largest  not  "
         " "
         " through the surface\n"
         "                s        share %   longest ticks          raw     sent     force N  "
         "finite  sunk  turned  deepest mm  not judged\n";
  for (const TouchedRow& row : rows) {
    std::snprintf(
        line, sizeof line,
        "  %-13s %-8.1f %-9.3f %-22llu %-7.2f %-8.2f %-8.2f %-7llu %-5llu %-7llu %-11.2f "
        "%llu\n",
        row.method.c_str(), 1e-3 * static_cast<double>(row.contact), 100 * row.jump_share(),
        static_cast<unsigned long long>(row.longest_jump), row.step_raw_max_N, row.step_max_N,
        row.force_max_N, static_cast<unsigned long long>(row.not_finite),
        static_cast<unsigned long long>(row.sunk), static_cast<unsigned long long>(row.flipped),
        row.deepest_mm, static_cast<unsigned long long>(row.unknown));
    out << line;
  }
  std::snprintf(line, sizeof line, "  %s: the hand at most %.1f mm from the proxy\n",
                rows.front().method.c_str(), rows.front().stretch_max_mm);
  out << line;
  for (const TouchedRow::Event& e : rows.front().events) {
    std::snprintf(
        line, sizeof line,
        "  %7.3f s: raw step %.2f N%s%s, hand (%.3f, %.3f, %.3f), proxy (%.3f, %.3f, %.3f)\n",
        e.t_s, e.step_raw_N, e.flipped ? ", turned" : "", e.sunk ? ", sunk" : "", e.p_WH.x(),
        e.p_WH.y(), e.p_WH.z(), e.p_WP.x(), e.p_WP.y(), e.p_WP.z());
    out << line;
  }
}

namespace {

std::string over_time(const std::vector<TouchedRow>& rows, const char* title, const char* label,
                      std::vector<float> TouchedRow::*values) {
  plot::Figure f;
  f.title = title;
  f.x_label = "virtual time, s";
  f.y_label = label;
  f.width_px = 1100;
  f.height_px = 420;
  // The baselines below, ours on top.
  for (auto row = rows.rbegin(); row != rows.rend(); ++row) {
    plot::Series s{row->method, {}, {}, "", false, false};
    const auto& v = (*row).*values;
    for (std::size_t k = 0; k < v.size(); ++k) {
      s.x.push_back(1e-3 * static_cast<double>(k));
      s.y.push_back(static_cast<double>(v[k]));
    }
    f.series.push_back(std::move(s));
  }
  return plot::line_plot(f);
}

}  // namespace

std::string RecordingTouchResult::force_drawing() const {
  return over_time(rows, "Force on the hand, the recording forward and back", "|F|, N",
                   &TouchedRow::force_N);
}

std::string RecordingTouchResult::step_drawing() const {
  return over_time(rows, "Raw change of force a tick, the recording forward and back", "|dF|, N",
                   &TouchedRow::step_raw_N);
}

}  // namespace teletact

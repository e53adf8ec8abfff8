#include "tools/measure/haptic/recording_touch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include "perception/raycast/raycast.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/fusion/fusion_task.hpp"
#include "tasks/haptic/haptic_task.hpp"
#include "tools/measure/support/pop_checker.hpp"
#include "tools/record/fusion_feed.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

using perception::Pose;
using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr double kFrame_s = 1.0 / 30;

// Frame of the recording that plays as number i: forward, back, forward; or back first.
int played(int i, int count, bool from_end) {
  const int round = 2 * (count - 1), k = (i + (from_end ? count - 1 : 0)) % round;
  return k < count ? k : round - k;
}

// The recording through fusion, frame by frame, in virtual time.
class Player {
 public:
  Player(rt::NonRealtime& nrt, const FusionSequence& sequence, bool from_end)
      : sequence_(sequence),
        from_end_(from_end),
        task_(std::make_unique<tasks::FusionTask>(nrt, config(), setup(sequence))),
        feed_(*task_) {}
  // The next frame; no window.
  void next() {
    sequence_.frame(played(count_, sequence_.size(), from_end_), feed_.frame());
    feed_.frame().exposure = rt::time_from_ns(0) + rt::Nanos{std::llround(1e9 * kFrame_s * count_)};
    feed_.frame().seq = static_cast<std::uint64_t>(count_++);
    integrated_ += feed_.step(nullptr).integrated ? 1 : 0;
  }
  // The window at a hand, as fusion publishes it with this frame.
  void window_at(const Vec3& p_WH, const Vec3& v_WH, SurfacePatch& window) {
    feed_.in.hand.seq = static_cast<std::uint64_t>(count_);
    feed_.in.hand.p_WH = p_WH;
    feed_.in.hand.v_WH = v_WH;
    feed_.look(window);
  }
  [[nodiscard]] const tasks::FusionTask& task() const { return *task_; }
  [[nodiscard]] int integrated() const { return integrated_; }
  [[nodiscard]] int count() const { return count_; }

 private:
  static tasks::FusionConfig config() {
    tasks::FusionConfig c;
    c.view_period_frames = 0;
    c.patch_checksums = false;
    c.objects.enabled = false;
    return c;
  }
  static tasks::FusionSetup setup(const FusionSequence& sequence) {
    tasks::FusionSetup s;
    s.camera = sequence.intrinsics;
    return s;
  }
  const FusionSequence& sequence_;
  bool from_end_;
  std::unique_ptr<tasks::FusionTask> task_;
  FusionFeed feed_;
  int count_ = 0, integrated_ = 0;
};

// One method on the trace.
class Toucher {
 public:
  Toucher(rt::NonRealtime& nrt, const std::string& method, std::size_t places)
      : task_(nrt, config_of(method), device(), 1e-3) {
    row_.method = method;
    row_.places.resize(places + 1);
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
    if (optimum_ == nullptr || !optimum_->asked(k)) return;
    if (turned_) optimum_->product_turned();
    optimum_->tick(k, out_.state.p_WH, out_.telemetry.step_raw_N, pops_, out_.telemetry.blend);
  }
  // Beside the next ticks.
  void ask(RecordingOptimum* optimum) { optimum_ = optimum; }
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
    c.credit_N_s_per_m = 2;
    return c;
  }
  void count(double moved, int place) {
    const auto& t = out_.telemetry;
    const Vec3& f = out_.force.f_H_D;
    ++row_.ticks;
    row_.energy_min_J = std::min(row_.energy_min_J, t.energy_J + t.booked_J + t.credit_J);
    if (!f.allFinite() || !t.f_raw_D.allFinite() || !out_.state.p_WP.allFinite()) ++row_.not_finite;
    row_.force_N.push_back(static_cast<float>(f.norm()));
    row_.step_raw_N.push_back(static_cast<float>(t.step_raw_N));
    row_.force_max_N = std::max(row_.force_max_N, f.norm());
    row_.step_max_N = std::max(row_.step_max_N, t.step_N);
    const std::uint64_t sunk = pops_.sunk(), flipped = pops_.flipped();
    const Vec3 entry = pops_.entry_W();
    // A hand that is let go keeps the plane of its last contact, whatever has come there since.
    pops_.judge(t.in_contact && !t.leaving, out_.state.p_WP, out_.state.p_WH, t.blend);
    row_.let_go += t.leaving && !leaving_ ? 1 : 0;
    leaving_ = t.leaving;
    const Vec3 before = std::exchange(p_WP_, out_.state.p_WP);
    turned_ = pops_.flipped() > flipped;
    if (!t.in_contact) {
      run_ = 0;
      free_ = tick_.k;
      return;
    }
    ++row_.contact;
    row_.stretch_max_mm = std::max(row_.stretch_max_mm, 1e3 * t.penetration_m);
    row_.step_raw_max_N = std::max(row_.step_raw_max_N, t.step_raw_N);
    const bool jump = t.step_raw_N > task_.config().stiffness_N_per_m * moved + 0.5;
    run_ = jump ? run_ + 1 : 0;
    row_.jumps += jump ? 1 : 0;
    row_.longest_jump = std::max(row_.longest_jump, run_);
    const bool fell = pops_.sunk() > sunk;
    PlaceFigures& here =
        place < 0 ? row_.places.back() : row_.places[static_cast<std::size_t>(place)];
    here.contact_s += 1e-3;
    here.step_raw_max_N = std::max(here.step_raw_max_N, t.step_raw_N);
    here.jumps += jump ? 1 : 0;
    here.pops += fell || turned_ ? 1 : 0;
    if ((jump || fell || turned_) && row_.events.size() < 60) {
      row_.events.push_back({1e-3 * static_cast<double>(tick_.k), t.step_raw_N, t.blend, place,
                             free_, tick_.k, run_, jump, turned_, fell, out_.state.p_WH,
                             out_.state.p_WP, before, entry});
    }
  }
  tasks::HapticTask task_;
  tasks::HapticTask::In in_;
  tasks::HapticTask::Out out_;
  rt::Tick tick_;
  PopChecker pops_;
  TouchedRow row_;
  Vec3 p_WP_ = Vec3::Zero();
  std::uint64_t run_ = 0;
  std::uint64_t free_ = 0;  // last tick without contact
  bool turned_ = false;     // in this tick
  bool leaving_ = false;
  RecordingOptimum* optimum_ = nullptr;
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

std::vector<MapPath> paths_on_final_map(std::ostream& progress, rt::NonRealtime& nrt,
                                        const FusionSequence& sequence,
                                        const RecordingTouchOptions& o, int frames) {
  Player player(nrt, sequence, o.from_end);
  std::vector<Pose> views;
  Vec3 up = Vec3::Zero();
  for (int i = 0; i < frames; ++i) {
    player.next();
    if (i % 300 == 299)
      progress << i + 1 << " frames fused"
               << "\n";
    if (i >= sequence.size()) continue;
    const Pose& X_WC = player.task().camera();
    up -= X_WC.linear().col(1);  // the camera is held upright
    if (i % 10 == 5) views.push_back(X_WC);
  }
  progress << player.integrated() << " of " << frames << " frames fused: the final map"
           << "\n";
  std::vector<MapPath> paths;
  for (int i = 0; i < o.paths; ++i) {
    MapPathOptions options;
    options.seed = o.seed + static_cast<std::uint64_t>(i);
    options.seconds = o.seconds;
    options.first = o.first;
    options.pool = o.pool;
    options.seen_s = kFrame_s * o.frames;
    paths.push_back(
        make_map_path(player.task().map(), sequence.intrinsics, views, up.normalized(), options));
    const auto& of = paths.back().chosen_from;
    progress << "path of seed " << options.seed << ": of " << of[0] << " walls, " << of[1]
             << " tops, " << of[2] << " edges, " << of[3] << " corners; "
             << std::round(10 * paths.back().planned_s) / 10 << " s in contact planned\n";
  }
  return paths;
}

// A hand on its path, by every method, on its own windows.
class Hand {
 public:
  Hand(rt::NonRealtime& nrt, const MapPath& path, bool beside) : path_(path) {
    for (const char* method : {"constrained", "nearest", "force_shading"}) {
      if (!beside && !touchers_.empty()) break;
      touchers_.push_back(std::make_unique<Toucher>(nrt, method, path.places.size()));
    }
    for (auto& w : windows_) w = std::make_unique<SurfacePatch>();
  }
  void take_window(Player& player, std::size_t k) {
    const Vec3& h = path_.hand_W[k];
    const Vec3 v = k > 0 ? Vec3((h - path_.hand_W[k - 1]) * 1000) : Vec3::Zero();
    at_ = (at_ + 1) % windows_.size();
    player.window_at(h, v, *windows_[at_]);
  }
  void tick(std::size_t k, const tasks::SurfacePoints* surface) {
    const Vec3& h = path_.hand_W[k];
    if (k > 0) fastest_ = std::max(fastest_, (h - path_.hand_W[k - 1]).norm() * 1000);
    for (auto& t : touchers_) t->tick(k, h, windows_[at_].get(), surface, path_.place[k]);
  }
  [[nodiscard]] const SurfacePatch& window() const { return *windows_[at_]; }
  [[nodiscard]] const Toucher& product() const { return *touchers_.front(); }
  void ask(RecordingOptimum* optimum) { touchers_.front()->ask(optimum); }
  [[nodiscard]] TouchedPath finish(std::uint64_t seed) {
    TouchedPath p;
    p.seed = seed;
    p.seconds = 1e-3 * static_cast<double>(path_.hand_W.size());
    p.hand_speed_max_m_per_s = fastest_;
    p.way_m = path_.way_m;
    p.places = path_.places;
    for (auto& t : touchers_) p.rows.push_back(t->finish());
    return p;
  }

 private:
  const MapPath& path_;
  std::vector<std::unique_ptr<Toucher>> touchers_;
  std::array<std::unique_ptr<SurfacePatch>, 12>
      windows_;  // a task keeps two, for four periods at most each
  std::size_t at_ = 0;
  double fastest_ = 0;
};

// The contacts in which a limit was missed once more, on the same windows, with the optimum beside.
void ask_optimum(std::ostream& progress, rt::NonRealtime& nrt, const FusionSequence& sequence,
                 const RecordingTouchOptions& o, const std::vector<MapPath>& paths,
                 RecordingTouchResult& r) {
  r.optimum = true;
  Player player(nrt, sequence, o.from_end);
  std::vector<std::unique_ptr<Hand>> hands;  // all of them: the map learns sooner where a hand is
  std::vector<std::unique_ptr<RecordingOptimum>> asked(paths.size());
  std::size_t last = 0;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    hands.push_back(std::make_unique<Hand>(nrt, paths[i], false));
    auto spans = r.paths[i].missed_contacts();
    if (spans.empty()) continue;
    last = std::max(last, spans.back().second);
    asked[i] = std::make_unique<RecordingOptimum>(hands[i]->product().config(), std::move(spans));
    hands[i]->ask(asked[i].get());
  }
  if (last == 0) return;
  for (std::size_t k = 0; k <= last; ++k) {
    const bool fresh = static_cast<double>(k) * 1e-3 >= player.count() * kFrame_s - 1e-9;
    if (fresh) player.next();
    if (fresh && player.count() % 300 == 0)
      progress << player.count() << " frames touched beside the optimum\n";
    for (std::size_t i = 0; i < hands.size(); ++i) {
      if (fresh) hands[i]->take_window(player, k);
      if (asked[i] != nullptr) hands[i]->tick(k, nullptr);
    }
  }
  for (std::size_t i = 0; i < paths.size(); ++i) {
    if (asked[i] == nullptr) continue;
    r.paths[i].asked = asked[i]->product();
    r.paths[i].optimum = asked[i]->optimum();
  }
}

}  // namespace

RecordingTouchResult touch_recording(std::ostream& progress, const RecordingTouchOptions& o) {
  rt::Startup startup;
  auto& nrt = startup.token();
  const FusionSequence sequence = recorded_sequence(progress, o.rgbd, {o.frames, 2, o.pinhole});
  const int frames = static_cast<int>(std::lround(o.seconds * 30));
  const std::vector<MapPath> paths = paths_on_final_map(progress, nrt, sequence, o, frames);

  RecordingTouchResult r;
  r.seconds = o.seconds;
  Player player(nrt, sequence, o.from_end);
  std::vector<std::unique_ptr<Hand>> hands;
  for (const MapPath& path : paths) hands.push_back(std::make_unique<Hand>(nrt, path, o.beside));
  std::unique_ptr<HapticRunWriter> writer;
  if (o.record != nullptr) {
    HapticRunHeader header;
    header.config = hands.front()->product().config();
    header.device = Toucher::device();
    writer = std::make_unique<HapticRunWriter>(o.record, header);
  }
  perception::RaycastMaps maps(nrt, sequence.intrinsics.width, sequence.intrinsics.height);
  std::array<tasks::SurfacePoints, 2> surfaces;
  std::size_t surface = 0;
  const std::size_t ticks = paths.front().hand_W.size();
  for (std::size_t k = 0; k < ticks; ++k) {
    const tasks::SurfacePoints* fresh = nullptr;
    if (static_cast<double>(k) * 1e-3 >= player.count() * kFrame_s - 1e-9) {
      player.next();
      for (auto& hand : hands) hand->take_window(player, k);
      if (writer) writer->window(hands.front()->window());
      if (o.beside) {
        surface = 1 - surface;
        cast_surface(player.task(), sequence.intrinsics, maps, surfaces[surface]);
        fresh = &surfaces[surface];
      }
      if (player.count() % 300 == 0)
        progress << player.count() << " frames touched"
                 << "\n";
    }
    for (auto& hand : hands) hand->tick(k, fresh);
    if (writer) writer->tick(hands.front()->product().recorded());
  }
  if (writer) writer->finish();
  r.frames_played = player.count();
  r.integrated = player.integrated();
  for (std::size_t i = 0; i < hands.size(); ++i) {
    r.paths.push_back(hands[i]->finish(o.seed + static_cast<std::uint64_t>(i)));
  }
  if (o.optimum) ask_optimum(progress, nrt, sequence, o, paths, r);
  return r;
}

}  // namespace teletact

#include "tools/record/recording_setup.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "tasks/fusion/fusion_task.hpp"
#include "tools/scene/box_devices.hpp"
#include "tools/touch/touch_places.hpp"
#include "tools/touch/touch_script.hpp"

namespace teletact {

using perception::Vec3;

namespace {

constexpr int kLeastImages =
    12;  // the second picture that shows what has weight 4, five images apart
constexpr int kMostImages = 150;
// chosen on: kitchen 1-75, room; judged on: kitchen 1-75, 76-150 and whole backwards, turn, near, corridor, stairs backwards (docs/recordings.md)
constexpr int kEnough = 4;        // flat places, kCell_m apart, in reach
constexpr double kCell_m = 0.15;  // of two places that count as two
constexpr double kFree_m = 0.08;  // round the workspace's origin, where the hand starts
constexpr double kPress_N = 4.0;  // what the hand presses with when it holds
constexpr double kFirst_s = 1.0;  // the script does not begin sooner
constexpr double kLead_s = 0.9;   // of the recording in the run, and two pictures more
// A visit.
constexpr double kGo_s = 0.25, kCome_s = 0.30, kDown_s = 0.35, kHold_s = 1.10, kUp_s = 0.30;
constexpr double kVisit_s = kGo_s + kCome_s + kDown_s + kHold_s + kUp_s;

double hand_N_per_m(const Scene& scene) {
  return scene.device.hand_stiffness_N_per_m > 0 ? scene.device.hand_stiffness_N_per_m : 400.0;
}

// How deep the target of a hand is that then presses with kPress_N; and how deep the hand itself
// gets.
double target_depth_m(const Scene& scene) {
  const auto& h = scene.graph.haptic;
  return std::min(0.2, h.scale * kPress_N * (1 / h.stiffness_N_per_m + 1 / hand_N_per_m(scene)));
}
double hand_depth_m(const Scene& scene) {
  const auto& h = scene.graph.haptic;
  return h.scale * kPress_N / h.stiffness_N_per_m;
}

// The first images through fusion, as the run will have them.
class FirstImages {
 public:
  FirstImages(rt::NonRealtime& nrt, const Scene& scene)
      : sequence_(open_recording(scene.rgbd_dir)),
        task_(std::make_unique<tasks::FusionTask>(nrt, scene.graph.fusion, setup(sequence_))),
        frame_(std::make_unique<perception::RgbdFrame>()) {}

  // The next image; true: there is a new picture. False at the end too.
  bool next() {
    if (auto read = sequence_.read(count_, *frame_); !read) throw std::runtime_error(read.error());
    const auto pixels = static_cast<std::ptrdiff_t>(frame_->intrinsics.width) *
                        static_cast<std::ptrdiff_t>(frame_->intrinsics.height);
    readings_ += static_cast<double>(pixels - std::count(frame_->depth_mm.begin(),
                                                         frame_->depth_mm.begin() + pixels, 0)) /
                 static_cast<double>(pixels);
    rt::Tick tick;
    tick.k = static_cast<std::uint64_t>(count_++);
    tick.release = tick.start = frame_->exposure;
    tasks::FusionTask::In in;
    in.frame = frame_.get();
    in.frame_fresh = true;
    tasks::FusionTask::Out out;
    out.view = view_.get();
    out.cost_map = map_.get();
    static_cast<void>(task_->step(tick, in, out));
    return out.view_written;
  }
  [[nodiscard]] bool more() const { return count_ < std::min(sequence_.size(), kMostImages); }
  [[nodiscard]] int size() const { return sequence_.size(); }
  [[nodiscard]] int count() const { return count_; }
  [[nodiscard]] int claimed() const { return static_cast<int>(task_->frames_claimed()); }
  [[nodiscard]] double readings() const { return count_ > 0 ? readings_ / count_ : 0; }
  [[nodiscard]] const tasks::SceneView& view() const { return *view_; }
  [[nodiscard]] const perception::CostMap& map() const { return *map_; }

 private:
  static tasks::FusionSetup setup(const drivers::TumSequence& sequence) {
    tasks::FusionSetup s;
    s.camera = sequence.intrinsics();
    return s;
  }
  drivers::TumSequence sequence_;
  std::unique_ptr<tasks::FusionTask> task_;
  std::unique_ptr<perception::RgbdFrame> frame_;
  std::unique_ptr<tasks::SceneView> view_ = std::make_unique<tasks::SceneView>();
  std::unique_ptr<perception::CostMap> map_ = std::make_unique<perception::CostMap>();
  int count_ = 0;
  double readings_ = 0;
};

// What a workspace holds: places in cells of kCell_m.
struct Held {
  std::array<int, TouchPlace::kKinds> kinds{};
  [[nodiscard]] int flat() const { return kinds[0] + kinds[1] + kinds[2]; }
  // Kinds first, then how many.
  [[nodiscard]] double worth() const {
    double sum = 0;
    constexpr std::array<double, TouchPlace::kKinds> first{6, 6, 1, 4, 4},
        more{1, 1, 0.3, 0.3, 0.3};
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      if (kinds[k] > 0) sum += first[k] + more[k] * std::min(kinds[k] - 1, 4);
    }
    return sum;
  }
};

Held held(const TouchPlaces& memory, const Reach& reach) {
  std::set<std::tuple<int, long, long, long>> cells;
  Held out;
  for (const auto& known : memory.known()) {
    const TouchPlace& p = known.place;
    if (!known.sure() || !reach.holds(p)) continue;
    const auto cell = [&](double x) { return std::lround(x / kCell_m); };
    if (cells.emplace(static_cast<int>(p.kind), cell(p.p_W.x()), cell(p.p_W.y()), cell(p.p_W.z()))
            .second)
      ++out.kinds[static_cast<std::size_t>(p.kind)];
  }
  return out;
}

// Seen free, and nothing that the picture shows is within kFree_m.
bool free_round(const tasks::SceneView& view, const Vec3& c_W) {
  const Vec3 q = view.X_WV.inverse() * c_W;
  const double depth = shown_depth(view, q);
  if (!(depth > q.z() + kFree_m)) return false;
  const auto pixels = static_cast<std::size_t>(view.intrinsics.width) *
                      static_cast<std::size_t>(view.intrinsics.height);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto& p = view.points[i];
    if (!(p.depth > 0)) continue;
    const Vec3 r(static_cast<double>(p.x) - c_W.x(), static_cast<double>(p.y) - c_W.y(),
                 static_cast<double>(p.z) - c_W.z());
    if (r.squaredNorm() < kFree_m * kFree_m) return false;
  }
  return true;
}

struct Placed {
  Vec3 origin_W = Vec3::Zero();
  Held held;
};

std::optional<Placed> best_origin(const TouchPlaces& memory, const tasks::SceneView& view,
                                  Reach reach, double yaw_rad) {
  const double radius = reach.map.scale() * reach.radius_m;
  struct Origin {
    double worth;
    Placed placed;
  };
  std::vector<Origin> origins;
  for (const auto& known : memory.known()) {
    if (!known.sure() || !known.place.flat()) continue;
    for (const double off : {0.25, 0.4, 0.6}) {
      const Vec3 c = known.place.p_W + (reach.standoff_m + off * radius) * known.place.n_W;
      reach.map = drivers::WorkspaceMap(c, reach.map.scale(), yaw_rad);
      const Held h = held(memory, reach);
      if (h.flat() == 0) continue;
      // The noise of a depth camera grows with the square of the distance.
      const double far = (c - view.X_WV.translation()).norm();
      origins.push_back({h.worth() - 1.5 * far * far, {c, h}});
    }
  }
  std::stable_sort(origins.begin(), origins.end(),
                   [](const Origin& a, const Origin& b) { return a.worth > b.worth; });
  for (const Origin& o : origins) {
    if (free_round(view, o.placed.origin_W)) return o.placed;
  }
  return std::nullopt;
}

[[noreturn]] void refuse(const Scene& scene, const std::string& why) {
  throw std::runtime_error(scene.rgbd_dir + ": can not be touched: " + why);
}

// Why nothing was found.
std::string reason(const FirstImages& images, bool stated, bool seen_any) {
  char text[240];
  const int n = images.count();
  if (images.readings() < 0.05) {
    std::snprintf(text, sizeof text,
                  "only %.1f %% of the pixels of its first %d images have a reading",
                  100 * images.readings(), n);
  } else if (images.claimed() < kLeastImages && images.claimed() < n / 2) {
    std::snprintf(
        text, sizeof text,
        "of its first %d images the camera could be placed in %d: what they show does not "
        "tell how it moves",
        n, images.claimed());
  } else if (seen_any && stated) {
    std::snprintf(
        text, sizeof text,
        "no place that its first %d images show is in reach of the workspace that the scene "
        "states (haptic.workspace_W_m, haptic.scale)",
        n);
  } else {
    std::snprintf(
        text, sizeof text,
        "in its first %d images nothing from 0.3 to 3.5 m is flat for 120 mm and free above", n);
  }
  return text;
}

std::string script_text(const Scene& scene, double start_s, double run_s) {
  char text[400];
  std::snprintf(text, sizeof text, "[hand]\nstart_after_s = %.3f\n", start_s);
  std::string out = text;
  const double depth_m = target_depth_m(scene), standoff_m = reach_of(scene).standoff_m;
  const auto segment = [&](const char* kind, const char* source, double time_s) {
    std::snprintf(text, sizeof text,
                  "[[hand.segment]]\nkind = \"%s\"\nsource = \"%s\"\ntime_s = %.3f\nstandoff_m = "
                  "%.4f\ndepth_m = %.4f\n",
                  kind, source, time_s, standoff_m, depth_m);
    out += text;
  };
  for (double t = start_s; t + kVisit_s <= run_s; t += kVisit_s) {
    segment("move", "chosen", kGo_s);
    segment("move", "chosen", kCome_s);
    segment("press", "chosen", kDown_s);
    segment("hold", "last", kHold_s);
    segment("move", "last", kUp_s);
  }
  return out;
}

void put(Scene& scene, const std::string& text) {
  if (auto ok = config::load_text(text, scene.rgbd_dir, scene.schema); !ok)
    throw std::runtime_error(ok.error());
}

}  // namespace

Reach reach_of(const Scene& scene) {
  Reach r;
  r.map = scene.workspace();
  r.radius_m = scene.device.workspace_radius_m;
  r.standoff_m = std::min(0.05, 0.3 * scene.graph.haptic.scale * r.radius_m);
  r.pressed_m = 1.3 * hand_depth_m(scene);
  return r;
}

std::string RecordingSetup::text() const {
  char text[300];
  std::snprintf(
      text, sizeof text,
      "touch: in the first %d images (%d placed) %d tops, %d walls, %d slopes, %d edges, %d "
      "corners are in reach; workspace %s, %s",
      images, claimed, kinds[0], kinds[1], kinds[2], kinds[3], kinds[4],
      placed ? "placed there" : "as the scene states",
      scripted ? "the hand chooses where" : "the hand as the scene states");
  return text;
}

RecordingSetup set_up_recording(rt::NonRealtime& nrt, Scene& scene, double run_s) {
  RecordingSetup out;
  const bool stated = scene.schema.section("haptic").named("workspace_W_m");
  out.placed = !stated;
  out.scripted = scene.hand.segments.empty();
  if (stated && !out.scripted) return out;
  FirstImages images(nrt, scene);
  if (images.size() < kLeastImages) {
    refuse(scene, "too short: " + std::to_string(images.size()) + " images, and only " +
                      std::to_string(kLeastImages) + " show a surface often enough");
  }
  TouchPlaces memory;
  const Reach reach = reach_of(scene);
  const double yaw_rad = scene.graph.haptic.workspace_yaw_deg * M_PI / 180.0;
  std::optional<Placed> best;
  bool seen_any = false;
  while (images.more()) {
    if (!images.next()) continue;
    memory.see(images.view(), up_of(images.map(), memory), nullptr);
    seen_any = seen_any || std::any_of(memory.known().begin(), memory.known().end(),
                                       [](const auto& k) { return k.sure() && k.place.flat(); });
    std::optional<Placed> now;
    if (stated) {
      now = Placed{reach.map.to_world(Vec3::Zero()), held(memory, reach)};
      if (now->held.flat() == 0) now.reset();
    } else {
      now = best_origin(memory, images.view(), reach, yaw_rad);
    }
    if (now && (!best || now->held.flat() >= best->held.flat())) {
      best = now;
      out.start_s = std::max(kFirst_s, images.count() / 30.0 + kLead_s);
    }
    if (best && best->held.flat() >= kEnough && images.count() >= kLeastImages) break;
  }
  if (!best) refuse(scene, reason(images, stated, seen_any));
  out.images = images.count();
  out.claimed = images.claimed();
  out.readings = images.readings();
  out.kinds = best->held.kinds;
  if (out.placed) {
    char text[160];
    std::snprintf(text, sizeof text, "[haptic]\nworkspace_W_m = [%.3f, %.3f, %.3f]\n",
                  best->origin_W.x(), best->origin_W.y(), best->origin_W.z());
    put(scene, text);
  }
  if (out.scripted) put(scene, script_text(scene, out.start_s, run_s));
  return out;
}

}  // namespace teletact

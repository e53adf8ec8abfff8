#include "tools/host/console.hpp"

#include <algorithm>
#include <cstdio>
#include <span>
#include <stdexcept>

#include "perception/map_file/map_file.hpp"
#include "perception/motion/motion_mask.hpp"
#include "rt/audit/log_file.hpp"
#include "tools/files/mesh_file.hpp"
#include "tools/files/whole_file.hpp"
#include "tools/record/recording_setup.hpp"

namespace teletact {

using tasks::OperatorCells;

namespace {

std::unique_ptr<rt::LogDrain> drain_to(rt::NonRealtime& nrt, tasks::TaskLogs& logs, rt::Box box,
                                       rt::LogFile file) {
  auto drain =
      std::make_unique<rt::LogDrain>(nrt, logs.sites(), rt::open_log_file(nrt, std::move(file)));
  logs.attach(nrt, box, *drain);
  return drain;
}

}  // namespace

void OperatorConsole::log_to(rt::NonRealtime& nrt, const std::string& path, TakeLine also,
                             std::function<void()> refused) {
  log_ = drain_to(nrt, *box_.graph().cells().logs, rt::Box::kOperator,
                  {path, std::move(also), std::move(refused)});
}
void RobotConsole::log_to(rt::NonRealtime& nrt, const std::string& path, TakeLine also,
                          std::function<void()> refused) {
  log_ = drain_to(nrt, *box_.graph().cells().logs, rt::Box::kRobot,
                  {path, std::move(also), std::move(refused)});
}

OperatorConsole::OperatorConsole(OperatorBox& box, const Scene& scene, rt::Time epoch)
    : box_(box),
      scene_(scene),
      epoch_(epoch),
      camera_width_px_(box.camera().width),
      force_act_(box.person_simulated()),
      touch_script_(box.hand(), reach_of(scene)) {
  // What one tick may bring comes before the older half goes.
  hold_room(seen_.haptic, 2 * kWholeTicks + tasks::HapticSamples::capacity());
  hold_room(seen_.fusion, 2 * kWholeFrames + tasks::FusionSamples::capacity());
  hold_room(seen_.haptic_thin.kept, Decimated<tasks::HapticSample>::kMost);
  hold_room(seen_.arrived, 2 * kWholeArrivals + 1);
  hold_room(seen_.paths, kWholePaths + 1);
  hold_room(link_.newest, 2 * LinkSeen::kWhole + tasks::LinkSamples::capacity());
  for (std::size_t i = 0; i < tasks::kLimitTable.size(); ++i) {
    if (tasks::kLimitTable[i].reader == tasks::kConsole)
      watches_.emplace_back(i, box.graph().config(), nullptr);
  }
}

template <class View>
void OperatorConsole::judge(const View& view, tasks::EdgeId edge, rt::Time now) {
  for (auto& w : watches_) {
    if (w.row().edge != edge) continue;
    if (!w.within(view, now) && w.state() != tasks::LimitWatch::State::kGood)
      seen_.beyond.push_back(tasks::kEdgeTable[tasks::index_of(edge)].name);
  }
}

// What an edge last carried, and whether that is beyond its limits.
template <tasks::EdgeId kEdge>
auto OperatorConsole::newest(rt::Time now) {
  auto value = box_.graph().cells().read<kEdge, tasks::kConsole>();
  judge(value, kEdge, now);
  return value;
}

void OperatorConsole::drain(rt::Time now) {
  using tasks::EdgeId;
  seen_.beyond.clear();
  take_samples();
  newest<EdgeId::kFrame>(now);
  see_scene(now);
  see_world(now);
  see_task(now);
  if (const auto c = newest<EdgeId::kCameraPose>(now)) seen_.camera = *c;
  if (const auto o = newest<EdgeId::kObjects>(now)) {
    seen_.objects = *o;
    for (std::int32_t i = 0; i < o->size; ++i) {
      seen_.objects_named =
          std::max(seen_.objects_named, o->entries[static_cast<std::size_t>(i)].serial);
    }
  }
  if (const auto mode = newest<EdgeId::kMode>(now)) seen_.mode = *mode;
  if (const auto robot = newest<EdgeId::kRobotState>(now)) seen_.robot = *robot;
  newest<EdgeId::kHand>(now);
}

void OperatorConsole::take_samples() {
  auto& cells = box_.graph().cells();
  for (tasks::HapticSample h; cells.haptic_samples.try_pop(h);) {
    force_act_.see(static_cast<drivers::DeviceState>(h.device_state), h.clutched);
    seen_.haptic.push_back(h);
  }
  for (tasks::FusionSample f; cells.fusion_samples.try_pop(f);) {
    fusion_heard_ = f.stamp;
    seen_.fusion.push_back(f);
  }
}

void OperatorConsole::see_scene(rt::Time now) {
  const auto v = newest<tasks::EdgeId::kView>(now);
  if (v && v->seq != seen_.view->seq) {
    *seen_.view = *v;
    keep_what_moves();
  }
  const auto m = newest<tasks::EdgeId::kCostMap>(now);
  if (m && m->seq != seen_.map->seq) {
    *seen_.map = *m;
    if (m->moving_count > seen_.moving_map->moving_count) *seen_.moving_map = *m;
  }
}

void OperatorConsole::see_world(rt::Time now) {
  const auto w = newest<tasks::EdgeId::kOdometryFrame>(now);
  if (!w || w->seq == seen_.world.seq) return;
  // A job is a tenth of a second; where the console saw none, the next one counts for it.
  if (w->unsure && seen_.world.seq != 0)
    seen_.unsure_s += 0.1 * static_cast<double>(w->seq - seen_.world.seq);
  if (w->follows_camera && w->known) seen_.error_max_m = std::max(seen_.error_max_m, w->error_m);
  mind_held(*w);
  seen_.world = *w;
}

void OperatorConsole::see_task(rt::Time now) {
  const auto p = box_.graph().cells().read<tasks::EdgeId::kPath, tasks::kConsole>();
  if (p && p->seq != 0 && p->size > 0) {
    judge(p, tasks::EdgeId::kPath, now);
    const bool known = std::any_of(seen_.paths.begin(), seen_.paths.end(),
                                   [&](const auto& o) { return o.seq == p->seq; });
    if (!known) seen_.paths.push_back(*p);
  }
  const auto t = newest<tasks::EdgeId::kTask>(now);
  if (!t) return;
  using Phase = tasks::TaskState::Phase;
  if (t->phase == Phase::kArrived && seen_.task.phase != Phase::kArrived) {
    if (seen_.arrivals++ == 0) seen_.first_arrival = t->stamp;
    if (!seen_.paths.empty()) {
      const auto& path = seen_.paths.back();
      const auto& end = path.points[static_cast<std::size_t>(path.size - 1)];
      seen_.arrived.push_back({t->stamp, path.seq, end[0], end[1], seen_.world.error_m});
    }
  }
  seen_.task = *t;
}

// The oldest samples go; what a report says of them stays.
void OperatorConsole::fold_samples() {
  const auto& haptic = scene_.graph.haptic;
  const double touch_N_per_m = haptic.stiffness_N_per_m / haptic.scale;
  const std::int64_t epoch_ns = rt::ns_of(epoch_);
  if (seen_.haptic.size() >= 2 * kWholeTicks) {
    const auto oldest = std::span(seen_.haptic).first(kWholeTicks);
    seen_.touched_past =
        touched_places(touch_script_.visits(), oldest, epoch_ns, seen_.touched_past).visits;
  }
  fold_older(seen_.haptic, kWholeTicks, [&](const tasks::HapticSample& s) {
    seen_.haptic_past.add(s, touch_N_per_m);
    seen_.haptic_thin.add(s);
  });
  fold_older(seen_.fusion, kWholeFrames,
             [&](const tasks::FusionSample& s) { seen_.fusion_past.add(s); });
  fold_older(seen_.arrived, kWholeArrivals, [](const Arrival&) {});
  if (seen_.paths.size() > kWholePaths) seen_.paths.erase(seen_.paths.begin() + 1);
}

void OperatorConsole::keep_what_moves() {
  const auto& v = *seen_.view;
  if (!v.masked) return;
  const auto pixels = static_cast<std::ptrdiff_t>(v.intrinsics.width) *
                      static_cast<std::ptrdiff_t>(v.intrinsics.height);
  const auto moving = std::count(v.what.begin(), v.what.begin() + pixels,
                                 static_cast<std::uint8_t>(perception::PixelOf::kMoving));
  if (moving <= most_moving_px_) return;
  most_moving_px_ = moving;
  *seen_.moving_view = v;
}

// What the newest picture shows at a pixel, or so many of the picture's pixels beside it. False:
// nothing.
bool OperatorConsole::surface_at(const std::array<double, 2>& pixel, int du, int dv,
                                 perception::Vec3& p_W) const {
  const auto& view = *seen_.view;
  if (view.seq == 0) return false;
  // Pixels are those of the depth image; the view shows every n-th of them.
  const double step = camera_width_px_ / static_cast<double>(view.intrinsics.width);
  const int u = static_cast<int>(pixel[0] / step) + du, v = static_cast<int>(pixel[1] / step) + dv;
  if (u < 0 || v < 0 || u >= view.intrinsics.width || v >= view.intrinsics.height) return false;
  const auto& q =
      view.points[static_cast<std::size_t>(v) * static_cast<std::size_t>(view.intrinsics.width) +
                  static_cast<std::size_t>(u)];
  p_W = perception::Vec3(static_cast<double>(q.x), static_cast<double>(q.y),
                         static_cast<double>(q.z));
  return q.depth > 0;
}

// The person looks at the picture and puts the hand where they see the surface: the points of pixel
// segments come from the newest view, shortly before the segment starts.
void OperatorConsole::resolve_points(rt::Time now) {
  auto& hand = box_.hand();
  while (next_point_ < hand.size()) {
    const auto& segment = hand.segment(next_point_);
    if (segment.source != "pixel") {
      ++next_point_;
      continue;
    }
    const rt::Time start = epoch_ + hand.start(next_point_);
    if (now + std::chrono::milliseconds{100} < start) return;
    const auto& view = *seen_.view;
    if (view.seq == 0) return;
    perception::Vec3 p = perception::Vec3::Zero();
    const auto point = [&](int du, int dv, perception::Vec3& out) {
      return surface_at(segment.pixel, du, dv, out);
    };
    constexpr int kReach = 4;
    perception::Vec3 l, r, t, b;
    if (point(0, 0, p) && point(-kReach, 0, l) && point(kReach, 0, r) && point(0, -kReach, t) &&
        point(0, kReach, b)) {
      perception::Vec3 n = (r - l).cross(t - b);
      if (n.norm() > 1e-9) {
        n.normalize();
        if (n.dot(view.X_WV.translation() - p) < 0) n = -n;
        if (hand.set_point(next_point_, p, n)) ++seen_.points_resolved;
      }
    }
    ++next_point_;
  }
}

// Whatever has braked the device (its own watchdog, its button, make_safe()): forces want an act,
// which is counted.
void OperatorConsole::mind_device(rt::Time now) {
  if (!force_act_.due(now)) return;
  box_.device().request_enable();
  ++seen_.device_brakes;
}

// Engage is an act: it must be seen as "no" before it counts, and after a fault that has cleared
// the person at the desk has to do it again.
void OperatorConsole::engage(rt::Time now) {
  using Engage = tasks::SupervisionTask::Engage;
  const auto& script = scene_.operator_script;
  const bool holding = seen_.mode.mode == tasks::Mode::kHold;
  if (!holding)
    held_since_ = rt::Time{};
  else if (held_since_ == rt::Time{})
    held_since_ = now;
  followed_ = followed_ || seen_.mode.mode == tasks::Mode::kEngaged;
  const bool first = seen_.engages == 0 && rt::seconds(now - epoch_) >= script.engage_after_s;
  // The first engage is pressed until it is followed: the other box may start later than this one.
  constexpr double kFirstAgain_s = 1;
  const double wait_s =
      !followed_ && script.re_engage_after_s == 0 ? kFirstAgain_s : script.re_engage_after_s;
  const bool again =
      seen_.engages > 0 && wait_s > 0 && holding && rt::seconds(now - held_since_) >= wait_s;
  if (!engage_shown_ && holding && (first || again)) {
    engage_shown_ = true;
    ++seen_.engages;
    held_since_ = now;
  } else if (engage_shown_ && again) {
    engage_shown_ = false;  // lift the finger: the next tick presses again
  }
  box_.graph().requests().engage.store(
      static_cast<int>(engage_shown_ ? Engage::kYes : Engage::kNo));
}

// A safe stop, of this box or of the robot's, is cleared by an act of its own: a button that is
// pressed for a while, so that the robot's motors and encoders have time to let go. Then comes the
// engage.
void OperatorConsole::clear(rt::Time now) {
  constexpr rt::Nanos kPress = std::chrono::milliseconds{500};
  using tasks::Mode;
  const double wait_s = scene_.operator_script.re_engage_after_s;
  const bool stopped =
      seen_.mode.mode == Mode::kSafeStop || static_cast<Mode>(seen_.robot.mode) == Mode::kSafeStop;
  auto& button = box_.graph().requests().clear;
  if (button.load()) {
    if (now - pressed_since_ >= kPress) {
      button.store(false);
      stopped_since_ = rt::Time{};
    }
    return;
  }
  if (!stopped) {
    stopped_since_ = rt::Time{};
  } else if (stopped_since_ == rt::Time{}) {
    stopped_since_ = now;
  } else if (wait_s > 0 && rt::seconds(now - stopped_since_) >= wait_s) {
    ++seen_.clears;
    pressed_since_ = now;
    button.store(true);
  }
}

// In the order of the script. One that does not fit, or whose pixel shows nothing yet, is asked
// again.
void OperatorConsole::edit(rt::Time now) {
  const auto& edits = scene_.operator_script.edits;
  while (edits_scene_ && !page_ && next_edit_ < edits.size()) {
    const EditConfig& e = edits[next_edit_];
    if (rt::seconds(now - epoch_) < e.at_s) return;
    perception::Vec3 centre_W(e.position_m[0], e.position_m[1], e.position_m[2]);
    if (e.source == "pixel" && !surface_at(e.pixel, 0, 0, centre_W)) return;
    tasks::SceneEdit asked = e.edit(centre_W);
    asked.seq = next_edit_ + 1;
    asked.stamp = now;
    if (!box_.graph().edit(asked)) return;
    ++seen_.edits;
    ++next_edit_;
  }
}

void OperatorConsole::tick(rt::Time now) {
  box_.graph().requests().console_ns.store(rt::ns_of(now));
  drain(now);
  link_.drain(box_.graph().cells().link_samples);
  fold_samples();
  take_mesh(now, Judges::kYes);
  edit(now);
  if (log_) {
    log_->drain();
    seen_.log_dropped = log_->dropped();
  }
  mind_device(now);
  if (!page_) {
    engage(now);
    clear(now);
  }
  resolve_points(now);
  if (touch_script_.asked()) {
    touch_script_.tick(now - epoch_, *seen_.view, *seen_.map);
    seen_.visits = touch_script_.visits();
  }
}

void save_scene(rt::NonRealtime& nrt, const OperatorConsole& console,
                const tasks::FusionTask& fusion, const std::string& folder,
                const std::string& map_file) {
  if (fusion.config().mesh_blocks > 0 && !folder.empty()) {
    const auto ok = write_ply(nrt, folder + "/scene.ply", console.mesh().mesh());
    if (!ok) throw std::runtime_error(ok.error());
  }
  if (!map_file.empty())
    write_whole_file(map_file, perception::encode_map(nrt, fusion.map(), fusion.keyframes()));
}

RobotConsole::RobotConsole(RobotBox& box)
    : box_(box),
      mode_in_(tasks::limit_row(tasks::EdgeId::kRobotMode, tasks::kConsole), box.graph().config(),
               nullptr) {
  hold_room(seen_.robot, 2 * kWholeTicks + tasks::RobotSamples::capacity());
  hold_room(seen_.truth, 2 * kWholeTruth + 1);
  hold_room(seen_.robot_past.kept, Decimated<tasks::RobotSample>::kMost);
  hold_room(seen_.truth_past.kept, Decimated<TruthSample>::kMost);
}

void RobotConsole::tick(rt::Time now) {
  if (log_) {
    log_->drain();
    seen_.log_dropped = log_->dropped();
  }
  tasks::RobotSample r;
  auto& cells = box_.graph().cells();
  while (cells.robot_samples.try_pop(r)) {
    seen_.robot.push_back(r);
    seen_.tracking_error_max_m =
        std::max(seen_.tracking_error_max_m, static_cast<double>(r.tracking_error_m));
  }
  const auto m = cells.read<tasks::EdgeId::kRobotMode, tasks::kConsole>();
  seen_.mode_beyond = m && !mode_in_.within(m, now);
  if (m) seen_.mode = *m;
  drivers::PoseHistory::Sample s;
  if (box_.bus().history().newest(s)) {
    seen_.truth.push_back({s.time, s.X_WB.x, s.X_WB.y, s.X_WB.yaw, s.path_m, s.collisions});
  }
  fold_older(seen_.robot, kWholeTicks,
             [&](const tasks::RobotSample& old) { seen_.robot_past.add(old); });
  fold_older(seen_.truth, kWholeTruth, [&](const TruthSample& old) { seen_.truth_past.add(old); });
}

}  // namespace teletact

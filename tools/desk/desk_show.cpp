#include "tools/desk/desk_show.hpp"

#include <algorithm>

#include "perception/geometry/planar.hpp"
#include "rt/clock/box_time.hpp"
#include "tools/pictures/picture_words.hpp"

namespace teletact {

using perception::Pose2;

namespace {

std::span<const std::uint8_t> bytes_of(std::string_view s) {
  return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()};
}

// Where a base with this velocity is so much later.
Pose2 ahead(const Pose2& X, double vx, double vy, double wz, double s) {
  return perception::compose(X, {vx * s, vy * s, wz * s});
}

}  // namespace

DeskShow::DeskShow(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
                   const DeskPort& port, DeskFigures& figures, TaskWatch* tasks)
    : box_(box),
      console_(console),
      port_(port),
      figures_(figures),
      tasks_(tasks),
      epoch_(epoch),
      wheels_(scene.graph.robot_io.base),
      block_edge_m_(8 * scene.graph.fusion.tsdf.voxel_size_m),
      brake_m_per_s2_(scene.graph.prediction.brake_m_per_s2),
      renders_force_(box.device().properties().renders_force) {
  console.mesh_also_to({[this] {
                          using Wanted = OperatorConsole::MeshWanted;
                          if (port_.viewers() == 0) return Wanted::kNone;
                          return port_.wants_whole_mesh() ? Wanted::kWhole : Wanted::kDeltas;
                        },
                        [this](const perception::MeshDelta& d) {
                          port_.mesh(d, stamp(d.fused, d.exposure), block_edge_m_);
                          const rt::Time now = rt::time_from_ns(box_.graph().requests().console_ns);
                          figures_.mesh_ms.add(1e3 * rt::seconds(now - d.fused));
                        }});
}

ViewStamp DeskShow::stamp(rt::Time now, rt::Time data) const {
  return {rt::seconds(now - epoch_), data == rt::Time{} ? -1.0 : rt::seconds(data - epoch_), 0};
}

bool DeskShow::due(rt::Time& next, rt::Time now, int period_ms) const {
  if (now < next) return false;
  next = now + std::chrono::milliseconds{period_ms};
  return true;
}

void DeskShow::show_pose(rt::Time now) {
  const auto& seen = console_.seen();
  PoseView v;
  if (!seen.haptic.empty()) {
    const auto& h = seen.haptic.back();
    v.hand = h.p_WH;
    v.proxy = h.p_WP;
    v.force_N = h.f_W;
    if (h.in_contact && h.force_N > 1e-3F)
      for (std::size_t i = 0; i < 3; ++i) v.normal[i] = h.f_W[i] / h.force_N;
    v.reach_m = h.reach;
    v.flags |= PoseView::kHandValid | (h.in_contact ? PoseView::kContact : 0U) |
               (h.button ? PoseView::kButton : 0U) | (h.clutched ? PoseView::kClutch : 0U);
  }
  if (renders_force_) v.flags |= PoseView::kRendersForce;
  const auto& r = seen.robot;
  const auto& w = seen.world;
  rt::Time data{};
  if (const auto base_W = base_in_world(seen)) {
    data = r.taken;
    v.flags |= PoseView::kRobotValid;
    v.robot = *base_W;
    const double late_s = std::clamp(rt::seconds(now - r.taken), 0.0, 1.0);
    v.predicted = ahead(v.robot, r.vx, r.vy, r.wz, late_s);
    v.v_B = {r.vx, r.vy, r.wz};
    const double dt = rolled_ == rt::Time{} ? 0 : std::clamp(rt::seconds(now - rolled_), 0.0, 0.2);
    const auto turning = wheels_.inverse(v.v_B);
    for (std::size_t i = 0; i < 4; ++i) wheel_rad_[i] += dt * turning[i];
    v.wheel_rad = wheel_rad_;
    v.error_m = w.error_m;
  }
  rolled_ = now;
  if (seen.camera.seq != 0) v.flags |= PoseView::kCameraValid;
  if (seen.camera.claimed) v.flags |= PoseView::kCameraClaimed;
  v.X_WC = seen.camera.X_WC;
  if (!seen.paths.empty() && seen.paths.back().size > 0) {
    const auto& end =
        seen.paths.back().points[static_cast<std::size_t>(seen.paths.back().size - 1)];
    v.goal = {end[0], end[1], end[2]};
    v.path_seq = static_cast<std::uint32_t>(seen.paths.back().seq);
  }
  using Phase = tasks::TaskState::Phase;
  if (seen.task.phase == Phase::kDriving && seen.mode.mode == tasks::Mode::kEngaged)
    v.flags |= PoseView::kGoalEngaged;
  v.mode = static_cast<std::uint8_t>(seen.mode.mode);
  v.robot_mode = r.mode;
  v.phase = static_cast<std::uint8_t>(seen.task.phase);
  v.tracking = static_cast<std::uint8_t>(seen.camera.tracking);
  port_.publish(ViewKind::kPose, stamp(now, data), pose_body(v));
}

// Fusion tells the pose of a picture a job after it came. Until then: that of the newest one before
// it, carried on by the wheels.
perception::Pose DeskShow::camera_at(rt::Time exposure) const {
  const auto& seen = console_.seen();
  const auto base_W = base_in_world(seen);
  if (!base_W || seen.camera.seq == 0) return seen.camera.X_WC;
  const double s = std::clamp(rt::seconds(exposure - seen.camera.exposure), -0.2, 0.2);
  return carried(seen.camera.X_WC, *base_W, {seen.robot.vx, seen.robot.vy, seen.robot.wz}, s);
}

// The picture as it came over the link.
void DeskShow::show_picture(rt::Time now) {
  auto& cells = box_.graph().cells();
  const auto frame = cells.read<tasks::EdgeId::kFrame, tasks::kConsole>();
  if (!frame || frame.seq == frame_seq_) return;
  frame_seq_ = frame.seq;
  loss_.see(frame->seq, frame.seq, now);
  if (!due(next_picture_, now, 66)) return;
  ++figures_.pictures;
  port_.publish(ViewKind::kPicture, stamp(now, frame->exposure),
                pictures_.body(*frame, camera_at(frame->exposure)));
}

void DeskShow::show_map(rt::Time now) {
  const auto& map = *console_.seen().map;
  if (map.seq == 0 || map.seq == map_seq_ || !due(next_map_, now, 500)) return;
  map_seq_ = map.seq;
  port_.publish(ViewKind::kCostMap, stamp(now, map.exposure), cost_map_body(map));
  port_.publish(ViewKind::kMoving, stamp(now, map.exposure), moving_body(map));
}

void DeskShow::measure(rt::Time now, DeskFacts& facts) {
  const double passed_s = rt::seconds(now - measured_);
  if (passed_s >= 1) {
    const std::int64_t cpu = cpu_ns_ + (port_.server_cpu_ns ? port_.server_cpu_ns() : 0);
    if (measured_ != rt::Time{}) {
      figures_.cpu_s += 1e-9 * static_cast<double>(cpu - cpu_before_ns_);
      figures_.seconds += passed_s;
      share_ = 1e-9 * static_cast<double>(cpu - cpu_before_ns_) / passed_s;
    }
    cpu_before_ns_ = cpu;
    measured_ = now;
  }
  facts.share = share_;
}

LinkFacts DeskShow::link_facts(const DeskEvents& events, rt::Time now) const {
  const auto& link = box_.graph().link();
  LinkFacts f;
  f.now = link_now(console_.link().newest, now);
  f.loss = loss_.share();
  f.round_trip_ms = 1e-6 * static_cast<double>(link.round_trip_ns.load());
  f.closed = link.closed;
  f.refused = link.refused;
  if (const std::int64_t heard = link.last_heard_ns; heard != 0) {
    f.heard_ago_ms = 1e-6 * static_cast<double>(rt::ns_of(now) - heard);
    f.heard_at_s = events.seconds_at(now) - 1e-3 * f.heard_ago_ms;
  }
  f.lowered = spared_text(link.spared());
  f.commands_refused = link.commands_refused;
  return f;
}

void DeskShow::show_text(const DeskActs& acts, const DeskEvents& events, DeskFacts facts,
                         rt::Time now) {
  facts.renders_force = renders_force_;
  facts.scale = acts.device_scale();
  facts.link = link_facts(events, now);
  if (tasks_ != nullptr) facts.tasks = tasks_->now();
  facts.viewers = port_.viewers();
  const auto people = port_.people ? port_.people() : std::vector<ConsolePerson>{};
  std::string name;
  for (const ConsolePerson& p : people)
    if (p.role == ConsoleRole::kOperator) name = p.name;
  const ViewStamp at = stamp(now, {});
  if (people.empty()) {
    port_.publish(ViewKind::kText, at,
                  bytes_of(text_body(console_.seen(), acts, events, facts, "viewer", name)));
    return;
  }
  for (const ConsoleRole role : {ConsoleRole::kOperator, ConsoleRole::kViewer}) {
    std::string text;
    for (const ConsolePerson& p : people) {
      if (!p.connected || p.role != role) continue;
      if (text.empty())
        text = text_body(console_.seen(), acts, events, facts, role_text(role), name);
      port_.text_to(p.session, at, text);
    }
  }
}

void DeskShow::show_proposal(const ShownProposal& shown, rt::Time now) {
  if (!port_.view_to) return;
  port_.view_to(shown.session, ViewKind::kSelection, stamp(now, shown.proposal->exposure),
                selection_body(*shown.proposal));
}

void DeskShow::tick(const DeskActs& acts, const DeskEvents& events, DeskFacts facts, rt::Time now) {
  // Whose fault a miss was is known by what came before it: looked at with nobody there as well.
  if (tasks_ != nullptr && due(next_tasks_, now, 200)) tasks_->look();
  if (port_.viewers() == 0) {
    measured_ = {};
    return;
  }
  const std::int64_t began = rt::thread_cpu_ns();
  if (due(next_pose_, now, 33)) show_pose(now);
  show_picture(now);
  show_map(now);
  measure(now, facts);
  if (due(next_text_, now, 200)) show_text(acts, events, facts, now);
  cpu_ns_ += rt::thread_cpu_ns() - began;
}

}  // namespace teletact

#include "tools/desk/desk_text.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "tasks/supervision/fault_ids.hpp"
#include "tools/desk/desk_words.hpp"
#include "tools/files/build_info.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

namespace {

using nlohmann::json;
using perception::Vec3;

// Two decimals are a centimetre on the page; four a tenth of a millimetre.
double rounded(double v) { return std::round(v * 1e4) / 1e4; }
json vec(const Vec3& v) { return {rounded(v.x()), rounded(v.y()), rounded(v.z())}; }

// The cause of the newest change of mode may be an older one: what is wrong with the link now is
// told beside it. What put the robot's box into its mode stands there too, as "at the robot".
json faults_of(const OperatorView& seen, const DeskEvents& events, const LinkFacts& link) {
  json all = json::array();
  const auto add = [&](rt::FaultId id, double since_s, const char* where = "") {
    for (const auto& row : tasks::kFaultTable) {
      if (row.id != id) continue;
      all.push_back({{"id", std::string(row.code)},
                     {"text", where + std::string(row.what)},
                     {"advice", std::string(row.advice)},
                     {"since_s", rounded(since_s)}});
    }
  };
  if (seen.mode.cause != rt::kNoFault) add(seen.mode.cause, events.mode_since_s());
  if (seen.robot.fault != rt::kNoFault) add(seen.robot.fault, events.robot_fault_since_s());
  const rt::FaultId there = seen.robot.mode_cause;
  if (there != rt::kNoFault && there != seen.mode.cause && there != seen.robot.fault)
    add(there, events.robot_mode_since_s(), "at the robot: ");
  if (const rt::FaultId id = link.fault(); id != rt::kNoFault && id != seen.mode.cause)
    add(id, link.heard_at_s);
  return all;
}

// A goal that was dropped or given up is none, though its path was the newest.
bool pursues(tasks::TaskState::Phase phase) {
  using Phase = tasks::TaskState::Phase;
  return phase != Phase::kIdle && phase != Phase::kFailed;
}

json path_of(const OperatorView& seen) {
  json points = json::array();
  if (seen.paths.empty() || !pursues(seen.task.phase)) return points;
  const tasks::Path& path = seen.paths.back();
  constexpr std::int32_t kEach = 2;  // points lie 4 cm apart at most
  for (std::int32_t i = 0; i < path.size; ++i) {
    const auto& p = path.points[static_cast<std::size_t>(i)];
    if (i % kEach == 0 || i + 1 == path.size) points.push_back({rounded(p[0]), rounded(p[1])});
  }
  return points;
}

json obstacles_of(const DeskActs& acts) {
  json all = json::array();
  for (const auto& [id, o] : acts.obstacles()) {
    all.push_back({{"id", id},
                   {"kind", o.box ? "box" : "disc"},
                   {"centre", vec(o.centre_W)},
                   {"half", vec(o.half_m)},
                   {"yaw", rounded(o.yaw_rad)}});
  }
  return all;
}

json objects_of(const OperatorView& seen, const DeskObjects& known) {
  json all = json::array();
  const auto n = static_cast<std::size_t>(
      std::clamp<std::int32_t>(seen.objects.size, 0, perception::ObjectMap::kMost));
  for (std::size_t i = 0; i < n; ++i) {
    const auto& e = seen.objects.entries[i];
    if (!e.summarised) continue;
    const Eigen::Quaterniond q(e.X_WO.linear());
    all.push_back({{"id", e.id},
                   {"serial", e.serial},
                   {"name", known.name_of(e.serial)},
                   {"centre", vec(e.X_WO * e.centre_m)},
                   {"extent", vec(e.extent_m)},
                   {"quat", {rounded(q.w()), rounded(q.x()), rounded(q.y()), rounded(q.z())}},
                   {"colour", {e.colour.r, e.colour.g, e.colour.b}},
                   {"seen", e.seen}});
  }
  return all;
}

json marks_of(const DeskActs& acts) {
  json all = json::array();
  for (const ShownMark& m : acts.marks()) {
    json points = json::array();
    for (const Vec3& p : m.points_W) points.push_back(vec(p));
    all.push_back({{"id", m.id}, {"points", points}});
  }
  return all;
}

json events_of(const DeskEvents& events) {
  json all = json::array();
  for (const auto& e : events.newest())
    all.push_back({{"t", rounded(e.t_s)}, {"kind", e.kind}, {"text", e.text}});
  return all;
}

std::string ms_text(double ms) {
  char text[40];
  std::snprintf(text, sizeof text, ms < 1000 ? "%.0f ms" : "%.1f s", ms < 1000 ? ms : 1e-3 * ms);
  return text;
}

json link_of(const LinkFacts& f) {
  const bool heard = f.heard_ago_ms >= 0;
  json link{{"state", !heard     ? "no other box"
                      : f.closed ? "closed"
                                 : "connected"},
            {"fps", rounded(f.now.fps)},
            {"mbit_s", rounded(f.now.mbit_s)},
            {"lowered", nullptr}};
  if (f.refused)
    link["fault"] = "refused: the two boxes are of different versions or keys";
  else if (heard && f.heard_ago_ms > LinkFacts::kSilent_ms)
    link["fault"] = "silent for " + ms_text(f.heard_ago_ms);
  if (f.round_trip_ms > 0) link["round_trip_ms"] = rounded(f.round_trip_ms);
  if (f.now.picture_age_ms >= 0) link["age_ms"] = rounded(f.now.picture_age_ms);
  if (f.loss >= 0) link["loss"] = rounded(f.loss);
  if (!f.lowered.empty()) link["lowered"] = f.lowered;
  if (f.commands_refused > 0) link["commands_refused"] = f.commands_refused;
  return link;
}

json tasks_of(const DeskFacts& facts) {
  json all = json::array();
  for (const TaskFigures& t : facts.tasks) {
    json row{{"name", t.name}, {"box", t.box}, {"hz", rounded(t.hz)}, {"misses", t.misses}};
    if (const std::string blame = t.blame_text(); !blame.empty()) row["blame"] = blame;
    if (t.jobs > 0) {
      row["late_p95_us"] = rounded(t.late_p95_us);
      row["cpu_ms"] = rounded(t.cpu_ms);
      row["cpu_share"] = rounded(t.cpu_share);
    }
    all.push_back(row);
  }
  return all;
}

// `here`: of this run's world, so that it can be opened now.
json sessions_of(const DeskSessions& sessions) {
  json all = json::array();
  for (const SessionRow& row : sessions.rows())
    all.push_back({{"name", row.name},
                   {"saved", row.saved},
                   {"map", row.map},
                   {"here", row.world == sessions.world()}});
  return all;
}

// The base's motors as the robot's box tells of them.
std::string bus_text(const OperatorView& seen, const LinkNow& link) {
  if (seen.robot.seq == 0) return "nothing heard of it yet";
  const std::string fault =
      seen.robot.fault != rt::kNoFault ? fault_text(seen.robot.fault) : "no fault";
  const std::string moves = seen.robot.moving != 0 ? "moves" : "stands";
  const std::string age =
      link.state_age_ms >= 0 ? ", state " + ms_text(link.state_age_ms) + " old" : std::string();
  return moves + ", " + fault + age;
}

// Why the base stands: what holds it, else why its goal was given up.
std::string stands_text(const OperatorView& seen) {
  const auto& w = seen.world;
  std::string held = held_text(w.held, w.held_ms, w.held_limit_ms);
  const bool failed = seen.task.phase == tasks::TaskState::Phase::kFailed;
  return held.empty() && failed ? "the goal was given up: " + goal_text(seen.task) : held;
}

json device_of(const OperatorView& seen, const DeskFacts& facts) {
  constexpr std::array kStates = {"reset", "idle, forces off", "forces on", "brake, forces off"};
  json device{{"kind", facts.device}, {"renders_force", facts.renders_force}};
  if (facts.scale > 0) device["scale"] = rounded(facts.scale);
  if (seen.haptic.empty()) return device;
  const tasks::HapticSample& h = seen.haptic.back();
  device["state"] = h.device_state < kStates.size() ? kStates[h.device_state] : "unknown";
  device["clutch"] = h.clutched;
  return device;
}

}  // namespace

rt::FaultId LinkFacts::fault() const noexcept {
  if (refused) return tasks::kFaultLinkRefused;
  const bool gone = heard_ago_ms >= 0 && (closed || heard_ago_ms > kSilent_ms);
  return gone ? rt::FaultId{tasks::kFaultLinkSilent} : rt::kNoFault;
}

std::string text_body(const OperatorView& seen, const DeskActs& acts, const DeskEvents& events,
                      const DeskFacts& facts, std::string_view role,
                      std::string_view operator_name) {
  json t{{"version", kVersion},
         {"role", std::string(role)},
         {"operator_name", std::string(operator_name)},
         {"clock", facts.paced ? "paced" : "real"},
         {"mode", mode_text(seen.mode.mode)},
         {"robot_mode", mode_text(static_cast<tasks::Mode>(seen.robot.mode))},
         {"phase", phase_text(seen.task.phase)},
         {"held", stands_text(seen)},
         {"tracking", tracking_text(seen.camera.tracking)},
         {"link", link_of(facts.link)},
         {"bus", bus_text(seen, facts.link.now)},
         {"tasks", tasks_of(facts)},
         {"faults", faults_of(seen, events, facts.link)},
         {"path", path_of(seen)},
         {"marks", marks_of(acts)},
         {"obstacles", obstacles_of(acts)},
         {"objects", objects_of(seen, acts.objects())},
         {"events", events_of(events)},
         {"sessions", sessions_of(acts.sessions())},
         {"recording", acts.recording()},
         {"console", {{"viewers", facts.viewers}, {"share", rounded(facts.share)}}}};
  if (seen.mode.cause != rt::kNoFault) t["mode_cause"] = cause_text(seen.mode.cause, seen.robot);
  if (seen.robot.mode_cause != rt::kNoFault) t["robot_cause"] = fault_text(seen.robot.mode_cause);
  if (seen.task.off_m >= 0) {
    t["goal"] = {{"off_m", rounded(seen.task.off_m)},
                 {"short", seen.task.is_short},
                 {"text", goal_text(seen.task)}};
  }
  if (const std::string& warning = acts.drive_warning(); !warning.empty())
    t["drive_warning"] = warning;
  t["lost"] = acts.lost_holds();
  t["marked"] = nullptr;
  if (pursues(seen.task.phase) && !seen.paths.empty() && seen.paths.back().size > 0)
    t["marked"] = vec(seen.paths.back().marked_W);
  t["device"] = device_of(seen, facts);
  const auto& s = acts.first_steps();
  t["first_steps"] = {{"touch", s.touch},
                      {"mark", s.mark},
                      {"obstacle", s.obstacle},
                      {"object", s.object},
                      {"stop", s.stop}};
  json can = json::array();
  if (facts.takes_acts)
    for (const std::string_view name : acts.can()) can.push_back(std::string(name));
  t["can"] = can;
  return t.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace teletact

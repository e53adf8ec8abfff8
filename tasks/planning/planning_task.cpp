#include "tasks/planning/planning_task.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "tasks/planning/planning_ground.hpp"

namespace tasks {

using perception::CostMap;

void PlanningConfig::describe(config::Section& s) {
  planner.describe(s);
  grasp.describe(s.section("grasp", "arm and gripper, for a mark that asks for a grasp"));
  s.text("object_goal", object_goal, {"approach", "grasp"}, "what a mark on an object asks for");
  s.number("goal_radius_m", goal_radius_m, 0.0, 5.0, "largest distance from the mark to the goal");
  s.number("start_radius_m", start_radius_m, 0.0, 1.5,
           "unseen floor the base may cross at the start");
  s.number("spacing_m", spacing_m, 0.01, 0.05, "of the published points");
  s.number("turn_rad_per_m", turn_rad_per_m, 0.5, 50.0, "heading change along the path");
  s.number("arrive_m", arrive_m, 0.005, 0.5, "distance to the last point that counts as arrived");
  s.number("arrive_speed_m_per_s", arrive_speed_m_per_s, 0.001, 1.0, "and the speed");
  s.number("switch_s", switch_s, 0.0, 2.0,
           "time from a new path to the goal that is made from it, the link's delay not included");
  s.number("brake_m_per_s2", brake_m_per_s2, 0.05, 5.0, "deceleration a new path may count on");
  s.number("leave_m", leave_m, 0.05, 5.0, "farther from the path: plan again");
  s.number("reached_m", reached_m, 0.0, 5.0,
           "of a goal on the floor: nearer is an arrival, and so is a place that was seen, within "
           "the base's circle");
  s.number("reached_object_m", reached_object_m, 0.0, 5.0, "the same of a mark above the floor");
  s.number("go_on_m", go_on_m, 0.02, 5.0, "a place so much nearer to the goal is driven to");
  s.integer("look_jobs", look_jobs, 0, 100000, "jobs it looks for a place nearer to the goal");
  s.number("object_moved_m", object_moved_m, 0.02, 5.0,
           "way of the marked object after which the goal follows it");
  s.integer("attempts", attempts, 1, 100, "jobs a goal may spend its iterations in vain");
  s.integer("wait_jobs", wait_jobs, 1, 100000, "jobs a mark waits for a map and a robot");
  s.integer("moving_jobs", moving_jobs, 0, 100000,
            "jobs a goal waits for what moves to leave its way");
  s.integer("aborts", aborts, 1, 100000, "jobs in a row out of time before a goal is given up");
}

PlanningTask::PlanningTask(rt::NonRealtime& nrt, const PlanningConfig& config, std::uint64_t seed)
    : config_(config), seed_(seed), planner_(nrt, config.planner) {}

// ---- marks --------------------------------------------------------------------------------------

void PlanningTask::begin_mark(const TouchEvent& e) noexcept {
  Mark& m = state_.mark;
  m.open = true;
  m.seq = e.seq;
  m.stamp = e.stamp;
  m.sum = Vec3::Zero();
  m.count = 0;
  m.stride = 1;
  m.stored = 0;
}

void PlanningTask::add_point(const TouchEvent& e) noexcept {
  Mark& m = state_.mark;
  m.sum += e.p_W;
  if (m.count++ % m.stride != 0) return;
  if (m.stored == kMaxStroke) {
    // Full: keep every second one and store half as often from here on.
    for (int i = 0; i < kMaxStroke / 2; ++i) {
      m.points[static_cast<std::size_t>(i)] = m.points[static_cast<std::size_t>(2 * i)];
      m.normals[static_cast<std::size_t>(i)] = m.normals[static_cast<std::size_t>(2 * i)];
    }
    m.stored = kMaxStroke / 2;
    m.stride *= 2;
    if ((m.count - 1) % m.stride != 0) return;
  }
  m.points[static_cast<std::size_t>(m.stored)] = e.p_W;
  m.normals[static_cast<std::size_t>(m.stored)] = e.normal_W;
  ++m.stored;
}

void PlanningTask::end_mark(Out& out) noexcept {
  Mark& m = state_.mark;
  m.open = false;
  if (m.stored == 0) return;
  const Vec3 mean = m.sum / m.count;
  int best = 0;
  double best_d = std::numeric_limits<double>::infinity();
  for (int i = 0; i < m.stored; ++i) {
    const double d = (m.points[static_cast<std::size_t>(i)] - mean).squaredNorm();
    if (d < best_d) best_d = d, best = i;
  }
  Goal g;
  g.mark_seq = m.seq;
  g.mark_stamp = m.stamp;
  g.p_W = m.points[static_cast<std::size_t>(best)];
  g.normal_W = m.normals[static_cast<std::size_t>(best)];
  pursue(g, out);
}

// Instead of what was pursued before.
void PlanningTask::pursue(const Goal& goal, Out& out) noexcept {
  drop_path(out);
  state_.goal = goal;
  state_.goal.have = state_.goal.pending = true;
  state_.task.phase = TaskState::Phase::kPlanning;
  state_.task.failure = TaskState::Failure::kNo;
  ++state_.task.marks;
  out.flags |= kMarkTaken;
}

// Of acts and marks of the hand the later one is pursued; of those of one job, the act. The hand's
// numbers are below kOfAct.
rt::Health PlanningTask::take_act(const OperatorAct& act, Out& out) noexcept {
  constexpr std::uint64_t kOfAct = 1ULL << 62U;
  if (!act.p_W.allFinite() || !act.normal_W.allFinite() || !std::isfinite(act.yaw_rad))
    return counted(kFaultPlanningBadInput);
  if (act.kind == OperatorAct::Kind::kCancel) {
    drop_path(out);
    state_.goal.have = state_.goal.pending = state_.mark.open = false;
    state_.task.phase = TaskState::Phase::kIdle;
    state_.task.failure = TaskState::Failure::kNo;
    return rt::Health::ok();
  }
  Goal g;
  g.mark_seq = kOfAct | act.seq;
  g.mark_stamp = act.stamp;
  g.p_W = act.p_W;
  g.normal_W = act.kind == OperatorAct::Kind::kMark ? act.normal_W : Vec3::UnitZ();
  g.turns = act.turns;
  g.yaw_rad = act.yaw_rad;
  pursue(g, out);
  return rt::Health::ok();
}

rt::Health PlanningTask::take_events(const In& in, Out& out) noexcept {
  rt::Health health;
  const int n = std::clamp(in.event_count, 0, kMaxEvents);
  for (int i = 0; i < n; ++i) {
    const TouchEvent& e = in.events[static_cast<std::size_t>(i)];
    // Delivered twice: the first one counted.
    if (state_.any_event && (e.seq < state_.last_event_seq || (e.seq == state_.last_event_seq &&
                                                               e.kind == state_.last_event_kind))) {
      continue;
    }
    state_.any_event = true;
    state_.last_event_seq = e.seq;
    state_.last_event_kind = e.kind;
    if (e.gap) {
      // Something before this event is missing, perhaps the end of the mark.
      if (state_.mark.open) out.flags |= kGapDropped;
      state_.mark.open = false;
      health = rt::worst(health, counted(kFaultPlanningEventsLost));
    }
    const bool of_mark = e.kind == TouchEvent::Kind::kMarkBegin ||
                         e.kind == TouchEvent::Kind::kMarkPoint ||
                         e.kind == TouchEvent::Kind::kMarkEnd;
    if (of_mark && !(e.p_W.allFinite() && e.normal_W.allFinite())) {
      state_.mark.open = false;
      health = rt::worst(health, counted(kFaultPlanningBadInput));
      continue;
    }
    switch (e.kind) {
      case TouchEvent::Kind::kMarkBegin:
        begin_mark(e);
        add_point(e);
        break;
      case TouchEvent::Kind::kMarkPoint:
        if (state_.mark.open) add_point(e);
        break;
      case TouchEvent::Kind::kMarkEnd:
        if (!state_.mark.open) break;
        add_point(e);
        end_mark(out);
        break;
      case TouchEvent::Kind::kContactBegin:
      case TouchEvent::Kind::kContactEnd:
      case TouchEvent::Kind::kSurfaceLeft:
        break;
    }
  }
  return health;
}

// A mark on an object means the object. Its centre wanders by centimetres while more and more of it
// is seen, so only a longer way counts. After the arrival nothing is followed: the robot moves on a
// mark alone.
rt::Health PlanningTask::follow_object(const ObjectList& list, Out& out) noexcept {
  Goal& g = state_.goal;
  using Phase = TaskState::Phase;
  const bool stands = state_.task.phase == Phase::kArrived || state_.task.phase == Phase::kShort;
  if (!g.have || list.seq == 0 || stands) return rt::Health::ok();
  const auto n = static_cast<std::size_t>(
      std::clamp(list.size, std::int32_t{0}, static_cast<std::int32_t>(list.entries.size())));
  for (const ObjectList::Entry& e : std::span(list.entries).first(n)) {
    if (g.object == 0 && list.mark_seq == g.mark_seq && e.id == list.touched) g.object = e.serial;
    if (g.object == 0 || e.serial != g.object || !e.summarised) continue;
    const Vec3 centre_W = e.X_WO * e.centre_m;
    if (!centre_W.allFinite()) return counted(kFaultPlanningBadInput);
    if (!g.object_placed) {
      g.object_placed = true;
      g.object_W = centre_W;
      g.grasp_due = config_.object_goal == "grasp";
    } else if ((centre_W - g.object_W).norm() > config_.object_moved_m) {
      g.p_W += centre_W - g.object_W;
      g.object_W = centre_W;
      g.pending = true;
      g.attempts = 0;
      g.grasp_due = config_.object_goal == "grasp";
      out.flags |= kObjectMoved;
    }
    g.box = {e.X_WO, e.centre_m, e.extent_m};
    break;
  }
  return rt::Health::ok();
}

// The goal becomes a place from which the arm reaches the object.
rt::Health PlanningTask::choose_grasp(const Ground& ground, const drivers::RobotState& robot,
                                      Out& out) noexcept {
  Goal& g = state_.goal;
  g.grasp_due = false;
  out.flags |= kGrasp;
  g.grasp = find_grasp(g.box, ground.X_WM.linear().col(2), ground.X_WM.translation(),
                       Vec3(robot.x_m, robot.y_m, 0), config_.grasp);
  out.grasp = g.grasp;
  if (g.grasp.refused != Grasp::Refused::kNo) {
    give_up(out, TaskState::Failure::kNoGrasp);
    return counted(kFaultPlanningNoGrasp);
  }
  g.p_W = g.grasp.X_WG.translation();
  g.normal_W = -g.grasp.X_WG.linear().col(2);
  g.pending = true;
  g.attempts = 0;
  return rt::Health::ok();
}

// ---- one job ------------------------------------------------------------------------------------

void PlanningTask::drop_path(Out& out) noexcept {
  if (state_.path.seq != 0) {
    out.flags |= kPathDropped;
    state_.driven = state_.path;
  }
  state_.path = Path{};
  state_.task.off_m = -1;
  state_.task.is_short = false;
  state_.goal.probe = false;
  state_.path_truncated = false;
  state_.escape_points = 0;
}

void PlanningTask::give_up(Out& out, TaskState::Failure why) noexcept {
  drop_path(out);
  state_.goal.have = state_.goal.pending = false;
  state_.task.phase = TaskState::Phase::kFailed;
  state_.task.failure = why;
  ++state_.task.failures;
  out.flags |= kGivenUp;
}

bool PlanningTask::arrived(const drivers::RobotState& robot) const noexcept {
  const Path& p = state_.path;
  if (p.size == 0 || state_.path_truncated) return false;
  const auto& end = p.points[static_cast<std::size_t>(p.size - 1)];
  return std::hypot(end[0] - robot.x_m, end[1] - robot.y_m) <= config_.arrive_m &&
         std::hypot(robot.vx, robot.vy) <= config_.arrive_speed_m_per_s;
}

// Looks at what is still ahead: from the path point nearest to the robot to the end.
PlanningTask::Holds PlanningTask::path_holds(const Ground& ground, const CostMap& map,
                                             Point2 robot) const noexcept {
  const Path& p = state_.path;
  const auto at = [&](int i) {
    const auto& q = p.points[static_cast<std::size_t>(i)];
    return ground.under(q[0], q[1]);
  };
  double best = distance(robot, at(0));
  int ahead = 0;  // index of the segment (or the single point) the robot is on
  for (int i = 0; i + 1 < p.size; ++i) {
    const double d = distance_to_segment(robot, at(i), at(i + 1));
    if (d <= best) best = d, ahead = i;
  }
  for (int i = ahead; i + 1 < p.size; ++i) {
    const Point2 a = at(i), b = at(i + 1);
    bool clear = edge_clear(map, a, b);
    // Floor under and around the base may be unseen at the start. It stays passable until it is
    // seen.
    if (!clear && i < state_.escape_points) {
      clear = edge_clear_or_unknown(map, a, b, CostMap::kInscribed);
    }
    if (!clear) return Holds::kNo;
  }
  if (best > config_.leave_m) return Holds::kExtend;
  const double rest = (p.size - 1 - ahead) * config_.spacing_m;
  if (state_.path_truncated && rest < 2.0) return Holds::kExtend;
  return Holds::kYes;
}

// Something moves where the goal may be.
bool PlanningTask::moves_near(const CostMap& map, Point2 mark) const noexcept {
  const double reach = config_.goal_radius_m + config_.robot_radius_m;
  for (int i = 0; i < std::min(map.moving_count, CostMap::kMaxMoving); ++i) {
    const int cell = map.moving[static_cast<std::size_t>(i)].cell;
    const int column = cell % map.width, row = cell / map.width;
    const Point2 p{(column + 0.5) * map.resolution, (row + 0.5) * map.resolution};
    if (distance(p, mark) <= reach) return true;
  }
  return false;
}

// At the end of its path, for good.
void PlanningTask::stand() noexcept {
  using Phase = TaskState::Phase;
  state_.task.phase = state_.task.is_short ? Phase::kShort : Phase::kArrived;
  state_.goal.pending = state_.goal.probe = false;
}

// At the end of a path that is short of the goal. True: it has not given up a nearer place yet.
bool PlanningTask::look_for_nearer() noexcept {
  constexpr int kEach = 4;  // jobs from one look to the next: the map is made anew meanwhile
  Goal& g = state_.goal;
  if (!state_.task.is_short || g.looks >= config_.look_jobs) return false;
  if (++g.looks % kEach == 0) g.pending = g.probe = true;
  return true;
}

// Of a path that is driven: is it at its end, does it hold?
void PlanningTask::watch_path(const Ground& ground, const In& in, Out& out) noexcept {
  Goal& g = state_.goal;
  const bool better = g.second && !moves_near(*in.map, ground.foot(g.p_W));
  if (arrived(*in.robot) && !better) {
    // At the second best place it stands until what moved at the mark has gone.
    if (g.second && g.moving++ < config_.moving_jobs) return;
    if (!look_for_nearer()) stand();
    return;
  }
  if (g.pending) return;
  const Point2 robot = ground.under(in.robot->x_m, in.robot->y_m);
  const Holds holds = path_holds(ground, *in.map, robot);
  if (holds != Holds::kYes || better) {
    g.pending = true;
    g.attempts = 0;
    out.flags |= kReplanned;
  }
  // A path that does not hold is withdrawn at once, whatever the new plan brings.
  if (holds != Holds::kNo) return;
  drop_path(out);
  state_.task.phase = TaskState::Phase::kPlanning;
}

rt::Health PlanningTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  before_ = state_;
  if (tried_) aborted_ = 0;  // the job that planned last was not aborted
  tried_ = false;
  out.flags = 0;
  out.work = 0;
  out.grasp = Grasp{};
  out.status = PlanStatus::kFound;
  rt::Health health = take_events(in, out);
  if (state_.mark.open && !in.touch_live) {
    state_.mark.open = false;
    out.flags |= kGapDropped;
    health = rt::worst(health, counted(kFaultPlanningEventsLost));
  }
  if (in.act) health = rt::worst(health, take_act(*in.act, out));
  stop_if_asked(in, out);

  const bool robot_ok = in.robot != nullptr && std::isfinite(in.robot->x_m) &&
                        std::isfinite(in.robot->y_m) && std::isfinite(in.robot->yaw_rad);
  if (in.robot != nullptr && !robot_ok) {
    health = rt::worst(health, counted(kFaultPlanningBadInput));
  }
  if (in.objects != nullptr) health = rt::worst(health, follow_object(*in.objects, out));
  if (state_.goal.have) {
    if (!robot_ok || !in.may_plan || in.map == nullptr || in.map->seq == 0 ||
        !in.map->ground_found) {
      health = rt::worst(health, wait_for_inputs(in, robot_ok, out));
    } else if (const Ground ground(*in.map); !ground.usable) {
      health = rt::worst(health, counted(kFaultPlanningBadInput));
      if (state_.goal.pending && ++state_.goal.waited > config_.wait_jobs)
        give_up(out, TaskState::Failure::kNoMap);
    } else {
      health = rt::worst(health, pursue_goal(tick, in, ground, out));
    }
  }

  ++state_.task.seq;
  state_.task.stamp = tick.start;
  out.path = state_.path;
  out.state = state_.task;
  if (state_.goal.have) out.grasp = state_.goal.grasp;
  return health;
}

// A stop withdraws path, goal and an open mark. A silence from which the engagement may resume is
// no stop, unless it ends without resuming.
void PlanningTask::stop_if_asked(const In& in, Out& out) noexcept {
  using Phase = TaskState::Phase;
  const bool pauses = in.mode.seq != 0 && in.mode.resumes && in.mode.mode != Mode::kSafeStop;
  const bool gave_up = state_.pauses && !pauses && in.mode.mode != Mode::kEngaged;
  state_.pauses = pauses;
  const bool stopped = in.mode.seq != 0 && (in.mode.mode == Mode::kSafeStop || gave_up ||
                                            (in.mode.mode == Mode::kRampDown && !pauses));
  if (!stopped) return;
  drop_path(out);
  state_.goal.have = state_.goal.pending = state_.mark.open = false;
  if (state_.task.phase == Phase::kDriving || state_.task.phase == Phase::kPlanning) {
    state_.task.phase = Phase::kIdle;
  }
}

// There is a goal, and no map, robot or leave to plan.
rt::Health PlanningTask::wait_for_inputs(const In& in, bool robot_ok, Out& out) noexcept {
  using Phase = TaskState::Phase;
  if (robot_ok && state_.task.phase == Phase::kDriving && !state_.goal.second &&
      arrived(*in.robot)) {
    stand();
  }
  if (!state_.goal.pending || ++state_.goal.waited <= config_.wait_jobs) return rt::Health::ok();
  out.status = PlanStatus::kNoMap;
  give_up(out, TaskState::Failure::kNoMap);
  return counted(kFaultPlanningNoPath);
}

// There is a goal, and all that it takes to plan.
rt::Health PlanningTask::pursue_goal(const rt::Tick& tick, const In& in, const Ground& ground,
                                     Out& out) noexcept {
  rt::Health health = rt::Health::ok();
  if (state_.goal.grasp_due) health = choose_grasp(ground, *in.robot, out);
  if (state_.path.seq != 0 && state_.task.phase == TaskState::Phase::kDriving)
    watch_path(ground, in, out);
  if (state_.goal.pending) {
    if (may_try(state_.goal.mark_seq)) {
      health = rt::worst(health, make_path(tick, in, ground, out));
    } else if (state_.goal.probe) {
      stand();
    } else {
      out.status = PlanStatus::kCancelled;
      give_up(out, TaskState::Failure::kNoTime);
      health = rt::worst(health, counted(kFaultPlanningNoTime));
    }
  }
  state_.path.seen = in.map->exposure;
  return health;
}

}  // namespace tasks

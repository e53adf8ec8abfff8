// From a goal to a path: where it starts, where it ends, its points and headings.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "tasks/planning/planning_ground.hpp"

namespace tasks {

using perception::CostMap;

namespace {

double wrapped(double a) { return std::remainder(a, 2.0 * std::numbers::pi); }

}  // namespace

// The path that the robot drives before a new one takes effect: along its present path, or straight
// on, as far as it is clear.
void PlanningTask::look_ahead(const rt::Tick& tick, const Ground& ground, const CostMap& map,
                              const drivers::RobotState& robot) noexcept {
  const Point2 here = ground.under(robot.x_m, robot.y_m);
  ahead_[0] = here;
  ahead_size_ = 1;
  const double v = std::hypot(robot.vx, robot.vy);
  if (!(v > config_.arrive_speed_m_per_s)) return;  // NaN as well
  const double age = std::clamp(rt::seconds(tick.start - robot.taken), 0.0, 1.0);
  const double way = v * (2 * age + config_.switch_s) + v * v / (2 * config_.brake_m_per_s2);
  const double c = std::cos(robot.yaw_rad), s = std::sin(robot.yaw_rad);
  const Vec3 v_M = ground.X_MW.linear() *
                   Vec3(c * robot.vx - s * robot.vy, s * robot.vx + c * robot.vy, 0.0) / v;
  if (along_old_path(ground, map, here, {v_M.x(), v_M.y()}, way)) return;
  for (double gone = 0; gone < way && ahead_size_ < kMostAhead;) {
    gone = std::min(way, gone + config_.spacing_m);
    const Point2 next{here.x + gone * v_M.x(), here.y + gone * v_M.y()};
    if (!go_on(map, next)) return;
  }
}

// One point more, where the floor may be driven or is not seen yet.
bool PlanningTask::go_on(const CostMap& map, Point2 next) noexcept {
  const Point2 last = ahead_[static_cast<std::size_t>(ahead_size_ - 1)];
  if (ahead_size_ == kMostAhead || !edge_clear_or_unknown(map, last, next, kDriveableCost))
    return false;
  ahead_[static_cast<std::size_t>(ahead_size_++)] = next;
  return true;
}

// False: there is none, or the robot is not driving it.
bool PlanningTask::along_old_path(const Ground& ground, const CostMap& map, Point2 robot,
                                  Point2 direction, double way_m) noexcept {
  constexpr double kOnPath_m = 0.15;
  const Path& p = state_.path.size > 0 ? state_.path : state_.driven;
  const auto at = [&](int i) {
    const auto& q = p.points[static_cast<std::size_t>(i)];
    return ground.under(q[0], q[1]);
  };
  double best = kOnPath_m;
  int segment = -1;
  for (int i = 0; i + 1 < p.size; ++i) {
    const Point2 a = at(i), b = at(i + 1);
    const double d = distance_to_segment(robot, a, b);
    if (d > best || (b.x - a.x) * direction.x + (b.y - a.y) * direction.y <= 0) continue;
    best = d, segment = i;
  }
  if (segment < 0) return false;
  ahead_[0] = nearest_on_segment(robot, at(segment), at(segment + 1));
  double left = way_m;
  for (int i = segment + 1; i < p.size && left > 0; ++i) {
    const Point2 last = ahead_[static_cast<std::size_t>(ahead_size_ - 1)], q = at(i);
    const double d = distance(last, q);
    if (d < 1e-9) continue;
    const double f = std::min(1.0, left / d);
    if (!go_on(map, {last.x + f * (q.x - last.x), last.y + f * (q.y - last.y)})) break;
    left -= d;
  }
  if (ahead_size_ == 1) ahead_[0] = robot;
  return true;
}

// Floods from the robot's place, or, where that is not driveable (the camera does not see the floor
// at the robot's feet), from the driveable cells around it that no obstacle hides.
PlanStatus PlanningTask::find_start(const CostMap& map, Point2 robot, const rt::Tick& tick,
                                    bool& escape) noexcept {
  escape = !point_clear(map, robot, planner_.drive_limit());
  if (!escape) {
    if (planner_.flood(map, robot, tick)) return PlanStatus::kFound;
    return tick.cancelled() ? PlanStatus::kCancelled : PlanStatus::kStartBlocked;
  }
  const std::size_t n = find_escapes(map, robot, tick);
  if (n > 0 && planner_.flood(map, std::span<const Planner::Source>(sources_.data(), n), tick)) {
    return PlanStatus::kFound;
  }
  return tick.cancelled() ? PlanStatus::kCancelled : PlanStatus::kStartBlocked;
}

// The driveable cells to which the base may come straight. What is occupied (a no-go area drawn
// over the robot, a box pushed to it) may be nearer than its radius now; no obstacle may come
// nearer than that, or than it is.
std::size_t PlanningTask::find_escapes(const CostMap& map, Point2 robot,
                                       const rt::Tick& tick) noexcept {
  const double res = map.resolution;
  const int cx = static_cast<int>(std::floor(robot.x / res));
  const int cy = static_cast<int>(std::floor(robot.y / res));
  const auto centre = [&](int ix, int iy) { return Point2{(ix + 0.5) * res, (iy + 0.5) * res}; };
  const auto around = [&](double range_m, auto&& visit) {
    const int reach = static_cast<int>(range_m / res) + 1;
    for (int iy = std::max(0, cy - reach); iy <= std::min(map.height - 1, cy + reach); ++iy) {
      for (int ix = std::max(0, cx - reach); ix <= std::min(map.width - 1, cx + reach); ++ix) {
        const Point2 c = centre(ix, iy);
        const double d = distance(robot, c);
        if (d <= range_m && !visit(ix, iy, c, d)) return;
      }
    }
  };
  const auto occupied = [&](int ix, int iy) {
    return map.contains(ix, iy) && map.cost[map.index(ix, iy)] == CostMap::kOccupied;
  };
  std::size_t obstacles = 0;
  bool all = true;
  around(config_.start_radius_m + config_.robot_radius_m, [&](int ix, int iy, Point2 c, double d) {
    if (!occupied(ix, iy)) return true;
    if (occupied(ix - 1, iy) && occupied(ix + 1, iy) && occupied(ix, iy - 1) &&
        occupied(ix, iy + 1))
      return true;  // inside: its rim is nearer
    all = obstacles < near_.size();
    if (all) near_[obstacles++] = {c, std::min(config_.robot_radius_m + 0.5 * res, d - 0.5 * res)};
    return all;
  });
  std::size_t n = 0;
  if (!all) return n;  // more than fit: none can be answered for
  around(config_.start_radius_m, [&](int ix, int iy, Point2 c, double d) {
    if (tick.cancelled() || n == sources_.size()) return false;
    if (map.cost[map.index(ix, iy)] > planner_.drive_limit() ||
        !edge_clear_or_unknown(map, robot, c, CostMap::kInscribed))
      return true;
    for (std::size_t k = 0; k < obstacles; ++k) {
      if (distance_to_segment(near_[k].p, robot, c) < near_[k].least_m) return true;
    }
    sources_[n++] = {ix, iy, d};
    return true;
  });
  return tick.cancelled() ? 0 : n;
}

bool PlanningTask::find_goal(const CostMap& map, Point2 mark, Point2 facing,
                             Point2& goal) const noexcept {
  const double res = map.resolution;
  const int reach = static_cast<int>(config_.goal_radius_m / res) + 1;
  const double span = CostMap::kMaxCells * res;
  if (!(std::abs(mark.x) < 2 * span && std::abs(mark.y) < 2 * span)) return false;
  const int cx = static_cast<int>(std::floor(mark.x / res));
  const int cy = static_cast<int>(std::floor(mark.y / res));
  if (planner_.reachable(cx, cy) && point_clear(map, mark, planner_.drive_limit())) {
    goal = mark;
    return true;
  }
  // Only when nothing in front is reachable is the far side of the marked surface looked at.
  constexpr double kBehind = 100.0, kCramped = 0.15;
  double best = std::numeric_limits<double>::infinity();
  for (int iy = std::max(0, cy - reach); iy <= std::min(map.height - 1, cy + reach); ++iy) {
    for (int ix = std::max(0, cx - reach); ix <= std::min(map.width - 1, cx + reach); ++ix) {
      if (!planner_.reachable(ix, iy)) continue;
      const Point2 c{(ix + 0.5) * res, (iy + 0.5) * res};
      double score = distance(mark, c);
      if (score > config_.goal_radius_m) continue;
      const double front = (c.x - mark.x) * facing.x + (c.y - mark.y) * facing.y;
      if (front < -res) score += kBehind;
      if (map.cost[map.index(ix, iy)] > config_.planner.comfort_cost) score += kCramped;
      if (score < best) best = score, goal = c;
    }
  }
  return std::isfinite(best);
}

// A cell from which the arm reaches: of a grasp from above any in a ring about it, of one from the
// side where the hand comes straight. A cell off either way is near enough.
bool PlanningTask::find_stand(const CostMap& map, Point2 mark, Point2 facing,
                              Point2& goal) const noexcept {
  const Grasp& g = state_.goal.grasp;
  const double res = map.resolution;
  const int reach = static_cast<int>(g.base_most_m / res) + 2;
  const double span = CostMap::kMaxCells * res;
  if (!(std::abs(mark.x) < 2 * span && std::abs(mark.y) < 2 * span)) return false;
  const int cx = static_cast<int>(std::floor(mark.x / res));
  const int cy = static_cast<int>(std::floor(mark.y / res));
  double best = std::numeric_limits<double>::infinity();
  for (int iy = std::max(0, cy - reach); iy <= std::min(map.height - 1, cy + reach); ++iy) {
    for (int ix = std::max(0, cx - reach); ix <= std::min(map.width - 1, cx + reach); ++ix) {
      if (!planner_.reachable(ix, iy)) continue;
      const Point2 c{(ix + 0.5) * res, (iy + 0.5) * res};
      double away = distance(mark, c), aside = 0;
      if (g.kind == Grasp::Kind::kSide) {
        away = (c.x - mark.x) * facing.x + (c.y - mark.y) * facing.y;
        aside = std::abs((c.x - mark.x) * facing.y - (c.y - mark.y) * facing.x);
      }
      const double off =
          std::hypot(std::max({0.0, g.base_least_m - away, away - g.base_most_m}), aside);
      // Within reach the middle of it is best.
      const double score = off + 0.1 * std::abs(away - g.base_m);
      if (off <= res && score < best) best = score, goal = c;
    }
  }
  return std::isfinite(best);
}

bool PlanningTask::may_try(std::uint64_t mark_seq) noexcept {
  if (mark_seq != tried_mark_) aborted_ = 0;
  tried_mark_ = mark_seq;
  tried_ = aborted_ < config_.aborts;
  return tried_;
}

// Something moves, and all that can be reached is far from where the mark would have the base: it
// will be out of the way before the base has been there and back.
bool PlanningTask::worth_waiting(const CostMap& map, Point2 mark, Point2 goal) const noexcept {
  constexpr double kMore_m = 0.3;
  const Goal& g = state_.goal;
  if (map.moving_count == 0 || g.moving >= config_.moving_jobs) return false;
  const double enough = g.best_m >= 0 ? g.best_m + kMore_m : config_.goal_radius_m / 2;
  return distance(goal, mark) > enough;
}

rt::Health PlanningTask::make_path(const rt::Tick& tick, const In& in, const Ground& ground,
                                   Out& out) noexcept {
  const CostMap& map = *in.map;
  Goal& g = state_.goal;
  const Point2 mark = ground.foot(g.p_W);
  const Vec3 n_M = ground.X_MW.linear() * g.normal_W;
  const double flat = std::hypot(n_M.x(), n_M.y());
  // A surface that faces up or down has no side on the ground.
  const Point2 facing = flat > 0.5 ? Point2{n_M.x() / flat, n_M.y() / flat} : Point2{};
  Point2 goal;
  bool escape = false;
  look_ahead(tick, ground, map, *in.robot);
  PlanStatus status =
      find_start(map, ahead_[static_cast<std::size_t>(ahead_size_ - 1)], tick, escape);
  if (status == PlanStatus::kFound) {
    bool stands = g.grasp.kind == Grasp::Kind::kNone ? find_goal(map, mark, facing, goal)
                                                     : find_stand(map, mark, facing, goal);
    if (stands && worth_waiting(map, mark, goal)) stands = false;
    if (stands && g.probe && distance(goal, mark) > state_.task.off_m - config_.go_on_m)
      stands = false;
    status = stands ? planner_.plan(goal, seed_, tick.k, tick) : PlanStatus::kUnreachable;
    out.work += planner_.iterations();
  }
  out.status = status;
  if (status != PlanStatus::kFound) return answer_failure(map, out);
  lay_points(ground, escape, out);
  lay_headings(in.robot->yaw_rad, ground, mark, facing);
  if (planner_.from_grid()) out.flags |= kFromGrid;
  publish_path(tick, in, ground, goal, out);
  return rt::Health::ok();
}

// What may lie between the base's centre and what was asked for at an arrival. A place on the floor
// that is within the base's circle is reached: no base can stand nearer to what is beside it. Of a
// place that nobody has seen that is not known. A grasp has its place.
double PlanningTask::reached_within(const Ground& ground) const noexcept {
  constexpr double kFloor_m = 0.1;  // of a point on the floor, as a hand marks it
  const Goal& g = state_.goal;
  if (g.grasp.kind != Grasp::Kind::kNone) return std::numeric_limits<double>::infinity();
  const double above = (ground.X_MW * g.p_W).z();
  if (above > kFloor_m) return config_.reached_object_m;
  if (ground.unseen(ground.foot(g.p_W))) return config_.reached_m;
  return std::max(config_.reached_m, config_.robot_radius_m);
}

// No path in this job: waits for what moves, tries again with other samples, or gives up.
rt::Health PlanningTask::answer_failure(const CostMap& map, Out& out) noexcept {
  using Failure = TaskState::Failure;
  Goal& g = state_.goal;
  if (g.probe && out.status != PlanStatus::kCancelled) {
    g.pending = g.probe = false;  // there is no nearer place, as far as it sees now
    return rt::Health::ok();
  }
  switch (out.status) {
    case PlanStatus::kFound:
      break;
    case PlanStatus::kCancelled:
      return counted(kFaultPlanningCancelled);
    case PlanStatus::kBudgetSpent:
    case PlanStatus::kLibraryFault: {
      const rt::Health health = out.status == PlanStatus::kLibraryFault
                                    ? rt::Health::of(rt::Severity::kDegraded, kFaultPlanningLibrary)
                                    : rt::Health::ok();
      if (++g.attempts < config_.attempts) return health;  // the next job draws other samples
      give_up(out, Failure::kNoTime);
      return rt::worst(health, counted(kFaultPlanningNoPath));
    }
    case PlanStatus::kNoMap:
    case PlanStatus::kStartBlocked:
    case PlanStatus::kGoalBlocked:
    case PlanStatus::kUnreachable:
      if (map.moving_count > 0 && g.moving++ < config_.moving_jobs) {
        out.flags |= kWaits;
        return rt::Health::ok();
      }
      give_up(out, out.status == PlanStatus::kNoMap          ? Failure::kNoMap
                   : out.status == PlanStatus::kStartBlocked ? Failure::kStart
                                                             : Failure::kNoWay);
      return counted(kFaultPlanningNoPath);
  }
  return rt::Health::ok();
}

// The path that was laid answers the mark.
void PlanningTask::publish_path(const rt::Tick& tick, const In& in, const Ground& ground,
                                Point2 goal, Out& out) noexcept {
  const CostMap& map = *in.map;
  Goal& g = state_.goal;
  const Point2 mark = ground.foot(g.p_W);
  Path& p = state_.path;
  p.seq = ++state_.path_seq;
  p.made = tick.start;
  p.mark_seq = g.mark_seq;
  p.mark_stamp = g.mark_stamp;
  p.marked_W = g.p_W;
  state_.task.off_m = distance(goal, mark);
  state_.task.is_short = state_.task.off_m > reached_within(ground);
  if (g.probe) out.flags |= kGoesOn;
  g.pending = g.probe = false;
  g.attempts = g.waited = g.moving = g.looks = 0;
  g.second = map.moving_count > 0 && !(goal == mark) && moves_near(map, mark);
  if (!g.second) g.best_m = distance(goal, mark);
  ++state_.task.paths;
  state_.task.phase = TaskState::Phase::kDriving;
  out.flags |= kNewPath;
}

// The planner's vertices as points of W at most spacing_m apart; every vertex is kept, so the
// points lie on edges that were checked.
void PlanningTask::lay_points(const Ground& ground, bool escape, Out& out) noexcept {
  Path& p = state_.path;
  const auto vertices = planner_.vertices();
  p.size = 0;
  state_.escape_points = 0;
  state_.path_truncated = false;
  const auto put = [&](Point2 q) {
    const Vec3 w = ground.to_W(q);
    p.points[static_cast<std::size_t>(p.size++)] = {w.x(), w.y(), 0.0};
  };
  const auto leg = [&](Point2 a, Point2 b) {
    // On tilted ground the distance in W's plane is the shorter one, so this spacing holds there
    // too.
    const int n = std::max(1, static_cast<int>(std::ceil(distance(a, b) / config_.spacing_m)));
    for (int i = 1; i <= n; ++i) {
      if (p.size == Path::kMaxPoints) {
        state_.path_truncated = true;
        return;
      }
      const double t = static_cast<double>(i) / n;
      put(i == n ? b : Point2{a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)});
    }
  };
  // First what will be driven whatever is planned.
  put(ahead_[0]);
  for (int i = 1; i < ahead_size_; ++i)
    leg(ahead_[static_cast<std::size_t>(i - 1)], ahead_[static_cast<std::size_t>(i)]);
  Point2 last = vertices.front();
  if (escape) {
    leg(ahead_[static_cast<std::size_t>(ahead_size_ - 1)], last);
    out.flags |= kEscape;
  }
  if (escape || ahead_size_ > 1) state_.escape_points = p.size - 1;
  for (std::size_t i = 1; i < vertices.size() && !state_.path_truncated; ++i) {
    if (distance(last, vertices[i]) < 1e-9) continue;
    leg(last, vertices[i]);
    last = vertices[i];
  }
  if (state_.path_truncated) out.flags |= kTruncated;
}

// The heading follows the direction of travel, no faster than turn_rad_per_m along the path, and
// ends looking at the mark. It begins at the robot's own.
void PlanningTask::lay_headings(double robot_yaw, const Ground& ground, Point2 mark,
                                Point2 facing) noexcept {
  Path& p = state_.path;
  const auto at = [&](int i) -> std::array<double, 3>& {
    return p.points[static_cast<std::size_t>(i)];
  };
  const auto length = [&](int i) {  // of the edge that ends in point i
    return std::hypot(at(i)[0] - at(i - 1)[0], at(i)[1] - at(i - 1)[1]);
  };
  const auto direction = [&](int i) {
    return std::atan2(at(i)[1] - at(i - 1)[1], at(i)[0] - at(i - 1)[0]);
  };
  const int n = p.size;
  const Vec3 mark_W = ground.to_W(mark);
  double dx = mark_W.x() - at(n - 1)[0], dy = mark_W.y() - at(n - 1)[1];
  if (std::hypot(dx, dy) < 0.1) {
    // Too near to point at: look against the surface. Zero on the floor, where any heading will do.
    const Vec3 into = ground.X_WM.linear() * Vec3(-facing.x, -facing.y, 0.0);
    dx = into.x(), dy = into.y();
  }
  double end = n > 1 ? direction(n - 1) : robot_yaw;
  if (!state_.path_truncated && std::hypot(dx, dy) > 0.05) end = std::atan2(dy, dx);
  if (!state_.path_truncated && state_.goal.turns) end = state_.goal.yaw_rad;
  at(0)[2] = wrapped(n > 1 ? robot_yaw : end);
  for (int i = 1; i < n; ++i) {
    const double most = config_.turn_rad_per_m * length(i);
    const double turn = wrapped(direction(i) - at(i - 1)[2]);
    at(i)[2] = wrapped(at(i - 1)[2] + std::clamp(turn, -most, most));
  }
  // Backwards from the end: as much of the way as the turn to the mark needs.
  double yaw = wrapped(end), rest = 0;
  for (int i = n - 1; i >= 1; --i) {
    const double most = config_.turn_rad_per_m * rest;
    const double off = wrapped(at(i)[2] - yaw);
    if (i < n - 1 && std::abs(off) <= most) break;
    at(i)[2] = wrapped(yaw + std::clamp(off, -most, most));
    rest += length(i);
  }
}

}  // namespace tasks

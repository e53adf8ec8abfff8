// Planning, prediction and the robot's side in a closed loop over a delaying link, on a cost map
// made from the world by brute force: what the whole stack does with a mark and a no-go disc,
// without camera and fusion.
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <vector>

#include "drivers/youbot/virtual_youbot.hpp"
#include "rt/random.hpp"
#include "tasks/planning/planning_task.hpp"
#include "tasks/prediction/prediction_task.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tests/support/body_clearance.hpp"
#include "tests/support/world_scene.hpp"

namespace tests {

using namespace std::chrono_literals;
using perception::CostMap;
using tasks::TouchEvent;

inline rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

struct Disc {
  double x_m = 0, y_m = 0, radius_m = 0, at_s = 1e9;
};

// Cells of 50 mm over the default room. Occupied: a solid within the robot's height meets the cell,
// or the disc does. Costs as docs/fusion.md has them: inscribed to the radius and half a cell, then
// falling over 0.25 m.
class RoomMap {
 public:
  static constexpr double kCell = 0.05, kRadius = 0.35, kInflation = 0.25;
  static constexpr int kWidth = 104, kHeight = 84;
  static constexpr double kX0 = -1.1, kY0 = -2.1;

  explicit RoomMap(const drivers::World& world) : solid_(kWidth * kHeight) {
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const double x = kX0 + (i % kWidth) * kCell, y = kY0 + (i / kWidth) * kCell;
      bool hit = false;
      for (int n = 0; n < 4 * 4 * 8 && !hit; ++n) {
        const Vec3 p(x + (n % 4 + 0.5) * kCell / 4, y + (n / 4 % 4 + 0.5) * kCell / 4,
                     0.06 + n / 16 * 0.13);
        hit = world.signed_distance(p) < 0;
      }
      solid_[static_cast<std::size_t>(i)] = hit;
    }
  }
  [[nodiscard]] std::unique_ptr<CostMap> map(const Disc* disc) const {
    auto m = std::make_unique<CostMap>();
    m->seq = 1;
    m->ground_found = true;
    m->resolution = kCell;
    m->width = kWidth;
    m->height = kHeight;
    m->X_WM.translation() = Vec3(kX0, kY0, 0);
    std::vector<bool> occupied = solid_;
    for (int i = 0; i < kWidth * kHeight && disc != nullptr; ++i) {
      const double x = kX0 + (i % kWidth + 0.5) * kCell, y = kY0 + (i / kWidth + 0.5) * kCell;
      if (std::hypot(x - disc->x_m, y - disc->y_m) <= disc->radius_m + kCell / 2)
        occupied[static_cast<std::size_t>(i)] = true;
    }
    constexpr int kReach = 13;
    for (int i = 0; i < kWidth * kHeight; ++i) {
      double least = 1e9;
      for (int dy = -kReach; dy <= kReach; ++dy) {
        for (int dx = -kReach; dx <= kReach; ++dx) {
          const int x = i % kWidth + dx, y = i / kWidth + dy;
          if (x < 0 || y < 0 || x >= kWidth || y >= kHeight ||
              !occupied[static_cast<std::size_t>(y * kWidth + x)])
            continue;
          least = std::min(least, kCell * std::hypot(dx, dy));
        }
      }
      const double beyond = least - kRadius;
      double cost = 0;
      if (least == 0)
        cost = CostMap::kOccupied;
      else if (beyond <= kCell / 2)
        cost = CostMap::kInscribed;
      else if (beyond < kInflation)
        cost = std::max(1.0, 252 * (1 - beyond / kInflation));
      m->cost[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(cost);
    }
    return m;
  }

 private:
  std::vector<bool> solid_;
};

struct Ride {
  unsigned collisions = 0;
  double clearance_m = 1e9, clearance_at_s = 0;
  double speed_at_end_m_per_s = 0, end_error_m = 0, off_path_m = 0;
  bool arrived = false, failed = false, drove = false;
  std::uint32_t paths = 0;
};

// A mark at 0.5 s, the disc when it says, seconds of simulated time.
inline Ride ride(const drivers::World& world, const RoomMap& room, const Disc& disc,
                 rt::Nanos one_way, double seconds, std::uint64_t seed = 1,
                 std::vector<std::array<double, 4>>* trace = nullptr) {
  auto& nrt = startup().token();
  static const std::unique_ptr<CostMap> open = room.map(nullptr);
  const auto drawn = room.map(&disc);
  drivers::RobotPlantConfig plant;
  plant.speed_loop_order = 2;
  drivers::VirtualYoubot bus(
      nrt, {}, drivers::RobotPlant(nrt, plant, {}, {}, [&](const perception::Pose2& X, rt::Time) {
        return world.robot_collision(X.x, X.y, X.yaw) >= 0;
      }));
  tasks::RobotIoTask robot(nrt, {});
  tasks::PredictionConfig wheels_alone;  // there is no camera here, and the wheels do not slip
  wheels_alone.map_correction = false;
  tasks::PredictionTask prediction(nrt, wheels_alone);
  tasks::PlanningTask planning(nrt, {}, seed);
  tasks::ModeMsg mode;
  mode.seq = 1;
  mode.mode = tasks::Mode::kEngaged;
  tasks::RobotIoTask::In rin;
  tasks::RobotIoTask::Out rout;
  tasks::PredictionTask::In pin;
  tasks::PredictionTask::Out pout;
  tasks::PlanningTask::In lin;
  tasks::PlanningTask::Out lout;
  rin.mode = pin.mode = &mode;
  lin.mode = mode;
  pin.delay_known = true;
  pin.round_trip = 2 * one_way;
  pin.round_trip_uncertainty = pin.robot_unsure = rin.goal_unsure =
      one_way;  // as a clock exchange has it
  drivers::RobotState state, latched;
  drivers::RobotGoal goal;
  tasks::Path path;
  std::deque<std::pair<rt::Time, drivers::RobotState>> up;
  std::deque<std::pair<rt::Time, drivers::RobotGoal>> down;
  rt::Time now = rt::time_from_ns(3'000'000'000);
  Ride r;
  const int last = static_cast<int>(seconds * 1000);
  double path_before = 0;
  for (int ms = 0; ms < last; ++ms, now += 1ms) {
    const double t_s = ms * 1e-3;
    rt::Tick t;
    t.release = t.start = now;
    t.period = 1ms;
    t.k = static_cast<std::uint64_t>(ms);
    while (!down.empty() && down.front().first <= now) {
      goal = down.front().second;
      rin.goal = &goal;
      rin.link_heard = true;
      down.pop_front();
    }
    rin.link_heard_at = now;
    rin.bus = bus.sense(now, rin.motors);
    (void)robot.step(t, rin, rout);
    rin.sent = bus.act(now, rout.setpoints);
    if (ms % 20 == 0) up.emplace_back(now + one_way, rout.state);
    while (!up.empty() && up.front().first <= now) {
      state = up.front().second;
      pin.robot = lin.robot = &state;
      up.pop_front();
    }
    if (ms % 100 == 0) {
      t.period = 100ms;
      t.k = static_cast<std::uint64_t>(ms / 100);
      lin.map = t_s < disc.at_s + 0.1 ? open.get() : drawn.get();
      lin.event_count = 0;
      if (ms == 500) {
        for (const auto kind : {TouchEvent::Kind::kMarkBegin, TouchEvent::Kind::kMarkEnd}) {
          auto& e = lin.events[static_cast<std::size_t>(lin.event_count++)];
          e = TouchEvent{};
          e.seq = static_cast<std::uint64_t>(lin.event_count);
          e.stamp = now;
          e.kind = kind;
          e.p_W = Vec3(1.83, -0.37, 0);
          e.normal_W = Vec3::UnitZ();
        }
      }
      (void)planning.step(t, lin, lout);
    }
    if (ms % 100 == 30) {  // what planning takes
      path = lout.path;
      pin.path = &path;
    }
    if (ms % 100 == 50) {
      t.period = 100ms;
      (void)prediction.step(t, pin, pout);
      down.emplace_back(now + one_way, pout.goal);
    }
    if (ms % 40 == 0) {  // 20 mm at full speed; the twin itself looks every millisecond
      const auto& s = bus.plant().state();
      const double c = clearance_m(world, s.X_WB.x, s.X_WB.y, s.X_WB.yaw);
      if (c < r.clearance_m) r.clearance_m = c, r.clearance_at_s = t_s;
      if (trace != nullptr) trace->push_back({t_s, s.X_WB.x, s.X_WB.y, s.X_WB.yaw});
    }
    if (ms == last - 500) path_before = bus.plant().state().path_m;
  }
  const auto& s = bus.plant().state();
  r.collisions = s.collisions;
  r.speed_at_end_m_per_s = (s.path_m - path_before) / 0.5;
  r.drove = s.path_m > 0.01;
  r.arrived = lout.state.phase == tasks::TaskState::Phase::kArrived;
  // Told as not reached: no way at all, or none to where it was asked to go.
  r.failed = lout.state.phase == tasks::TaskState::Phase::kFailed ||
             lout.state.phase == tasks::TaskState::Phase::kShort;
  r.paths = lout.state.paths;
  if (path.size > 0) {
    const auto& e = path.points[static_cast<std::size_t>(path.size - 1)];
    r.end_error_m = std::hypot(e[0] - s.X_WB.x, e[1] - s.X_WB.y);
  }
  return r;
}

}  // namespace tests

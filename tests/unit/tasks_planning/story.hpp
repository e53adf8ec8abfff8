// The planning task job by job: what is marked, where the robot is, what the map says.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <numbers>

#include "tasks/planning/planning_task.hpp"
#include "tests/unit/tasks_planning/grid_oracle.hpp"

namespace tests {

using perception::CostMap;
using perception::Vec3;
using tasks::Mode;
using tasks::Path;
using tasks::PlanningConfig;
using tasks::PlanningTask;
using tasks::PlanStatus;
using tasks::Point2;
using tasks::TaskState;
using tasks::TouchEvent;
using Kind = TouchEvent::Kind;
using Phase = TaskState::Phase;

inline rt::Startup startup;

// A 6 m x 6 m room around the world's origin, the robot at (-2, -2).
struct Story {
  std::unique_ptr<CostMap> map = oracle::blank(120, 120);
  drivers::RobotState robot;
  PlanningTask task{startup.token(), PlanningConfig{}, 42};
  PlanningTask::In in;
  PlanningTask::Out out;
  rt::Tick tick;
  rt::Health health;
  std::uint64_t event_seq = 0;

  Story() {
    map->X_WM.translation() = Vec3(-3, -3, 0);
    robot.seq = 1;
    robot.x_m = robot.y_m = -2;
    in.map = map.get();
    in.robot = &robot;
  }
  Story& event(Kind kind, Vec3 p, Vec3 normal = {0, 0, 1}, bool gap = false) {
    auto& e = in.events[static_cast<std::size_t>(in.event_count++)];
    e = TouchEvent{};
    e.seq = ++event_seq;
    e.stamp = tick.start;
    e.kind = kind;
    e.p_W = p;
    e.normal_W = normal;
    e.gap = gap;
    return *this;
  }
  Story& mark(Vec3 p, Vec3 normal = {0, 0, 1}) {
    return event(Kind::kMarkBegin, p, normal)
        .event(Kind::kMarkPoint, p, normal)
        .event(Kind::kMarkEnd, p, normal);
  }
  Story& job() {
    ++tick.k;
    tick.start += std::chrono::milliseconds(100);
    health = task.step(tick, in, out);
    in.event_count = 0;
    return *this;
  }
  void box(double x0, double y0, double x1, double y1, std::uint8_t value = CostMap::kOccupied) {
    const auto cell = [](double v) { return static_cast<int>(std::floor((v + 3) / 0.05)); };
    oracle::fill(*map, cell(x0), cell(y0), cell(x1), cell(y1), value);
  }
  Point2 to_M(double x, double y) const {
    const Vec3 p = map->X_WM.inverse() * Vec3(x, y, 0);
    return {p.x(), p.y()};
  }
  void expect_path_sound() const {
    const Path& p = out.path;
    ASSERT_GT(p.size, 0);
    for (int i = 0; i < p.size; ++i) {
      const auto& q = p.points[static_cast<std::size_t>(i)];
      for (const double v : q) ASSERT_TRUE(std::isfinite(v));
      ASSERT_LE(std::abs(q[2]), std::numbers::pi + 1e-12);
      if (i == 0) continue;
      const auto& o = p.points[static_cast<std::size_t>(i - 1)];
      ASSERT_LE(std::hypot(q[0] - o[0], q[1] - o[1]), 0.05 + 1e-9);
      ASSERT_TRUE(oracle::free_segment(*map, to_M(o[0], o[1]), to_M(q[0], q[1])));
    }
  }
  const std::array<double, 3>& last() const {
    return out.path.points[static_cast<std::size_t>(out.path.size - 1)];
  }
};

}  // namespace tests

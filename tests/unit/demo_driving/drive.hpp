// The whole stack on the virtual clock, judged by where the twin says the robot was.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/body_clearance.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"

namespace tests {

using perception::Vec3;
using teletact::DemoOptions;
using teletact::EditConfig;
using teletact::Scene;
using teletact::VirtualRun;

inline rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

inline std::unique_ptr<Scene> room(const std::vector<std::string>& overrides = {}) {
  return teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
}

inline VirtualRun drive(Scene& s, double seconds, const std::string& log_folder = "") {
  DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  options.log_folder = log_folder;
  return teletact::run_virtual(startup().token(), s, options, teletact::reference_calibration());
}

inline EditConfig disc(double x_m, double y_m, double radius_m, double at_s) {
  EditConfig e;
  e.kind = "disc";
  e.at_s = at_s;
  e.position_m = {x_m, y_m, 0};
  e.radius_m = radius_m;
  return e;
}

struct Driven {
  unsigned collisions = 0;
  double clearance_m = 0, clearance_at_s = 0;  // least over the run
  double speed_at_end_m_per_s = 0;
  bool arrived = false, failed = false;
  std::uint32_t paths = 0;
  double way_m = 0, end_x_m = 0, end_y_m = 0, end_yaw_rad = 0, arrived_at_s = 0;
};

inline Driven judge(const Scene& s, const VirtualRun& r) {
  Driven d;
  const drivers::World world(startup().token(), s.world);
  const auto& truth = r.robot.view.truth;
  EXPECT_GT(truth.size(), 100U);
  if (truth.empty()) return d;
  d.clearance_m = std::numeric_limits<double>::infinity();
  for (const auto& t : truth) {
    const double c = clearance_m(world, t.x_m, t.y_m, t.yaw_rad);
    if (c >= d.clearance_m) continue;
    d.clearance_m = c;
    d.clearance_at_s = 1e-9 * static_cast<double>(rt::ns_of(t.stamp) - r.robot.epoch_ns);
  }
  const auto& end = truth.back();
  const auto& before = truth[truth.size() - 26];  // half a second
  d.collisions = end.collisions;
  d.speed_at_end_m_per_s =
      (end.path_m - before.path_m) /
      (1e-9 * static_cast<double>(rt::ns_of(end.stamp) - rt::ns_of(before.stamp)));
  d.arrived = r.op.view.task.phase == tasks::TaskState::Phase::kArrived;
  // Told as not reached: no way at all, or none to where it was asked to go.
  d.failed = r.op.view.task.phase == tasks::TaskState::Phase::kFailed ||
             r.op.view.task.phase == tasks::TaskState::Phase::kShort;
  d.paths = r.op.view.task.paths;
  d.way_m = end.path_m;
  d.end_x_m = end.x_m, d.end_y_m = end.y_m, d.end_yaw_rad = end.yaw_rad;
  if (r.op.view.arrivals > 0)
    d.arrived_at_s = 1e-9 * static_cast<double>(rt::ns_of(r.op.view.first_arrival) - r.op.epoch_ns);
  return d;
}

}  // namespace tests

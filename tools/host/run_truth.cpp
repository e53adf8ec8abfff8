#include "tools/host/run_truth.hpp"

#include <algorithm>

#include "tools/host/run_options.hpp"

namespace teletact {

namespace {

using perception::Pose2;
using perception::wrap_angle;

// From the operator's clock to the robot's.
rt::Time to_robot(rt::Time at) { return kRobotClock.from_host(kOperatorClock.to_host(at)); }

template <class Samples, class PoseOf>
std::optional<Pose2> between(const Samples& samples, rt::Time t, const PoseOf& pose_of) {
  const auto b = std::lower_bound(samples.begin(), samples.end(), t,
                                  [](const auto& s, rt::Time at) { return s.stamp < at; });
  if (b == samples.end() || (b == samples.begin() && b->stamp != t)) return std::nullopt;
  const Pose2 q = pose_of(*b);
  if (b->stamp == t) return q;
  const Pose2 p = pose_of(*(b - 1));
  const double f = rt::seconds(t - (b - 1)->stamp) / rt::seconds(b->stamp - (b - 1)->stamp);
  return Pose2{p.x + f * (q.x - p.x), p.y + f * (q.y - p.y),
               wrap_angle(p.yaw + f * wrap_angle(q.yaw - p.yaw))};
}

}  // namespace

std::optional<Pose2> true_base_at(const RobotHalf& robot, rt::Time at) {
  return between(robot.view.truth, to_robot(at), [](const TruthSample& s) {
    return Pose2{s.x_m, s.y_m, s.yaw_rad};
  });
}

std::optional<Pose2> odometry_at(const RobotHalf& robot, rt::Time at) {
  return between(robot.view.robot, to_robot(at), [](const tasks::RobotSample& s) {
    return Pose2{static_cast<double>(s.x_m), static_cast<double>(s.y_m),
                 static_cast<double>(s.yaw_rad)};
  });
}

}  // namespace teletact

// What predictors are judged on: what a robot's box measures, with its stamps, and the truth, which
// no predictor sees.
//
//   robot_trace  A mecanum base (drivers/youbot/mecanum.hpp) driven between marks at up to 0.8 m/s:
//                straight, curves, sideways, diagonal, turns on the spot, stops, reversals. Its
//                reference changes with a stated acceleration; each wheel follows with a
//                first-order lag of its own and slips by a share drawn anew twice a second.
//                Measured: odometry from the wheels' encoders, their speeds with noise, at 10 to
//                30 Hz, stamped up to 2 ms off.
//   log_trace    A recorded log, t_s,x_m,y_m,yaw_rad,vx,vy,wz ;
//                the truth is its poses.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "perception/geometry/planar.hpp"

namespace teletact {

struct MotionRow {
  double t = 0;      // true instant, s
  double stamp = 0;  // what the box writes
  perception::Pose2 X_OB;
  perception::Twist2 v_B;
};

struct MotionCommand {
  double t = 0;
  perception::Twist2 v_B;
};

struct MotionTrace {
  std::string name;  // part of metric names: a-z, 0-9, _
  std::vector<MotionRow> rows;
  std::vector<MotionCommand> commands;  // empty: not known
  // True poses at true_t0 + i true_step; empty: the rows' own.
  double true_t0 = 0, true_step = 0.001;
  std::vector<perception::Pose2> truth;
  // Likewise, integrated from how the wheels turned, exactly: off the truth by their slip alone.
  // Empty: not known.
  std::vector<perception::Pose2> wheels;
  double delay_min_s = 0.1, delay_max_s = 0.1;
  double judged_from = 0, judged_to = 1e300;  // targets
  std::uint64_t seed = 1;                     // of the delays

  [[nodiscard]] perception::Pose2 true_pose(double t) const;
  [[nodiscard]] perception::Pose2 wheel_pose(double t) const;  // where `wheels` is known

 private:
  [[nodiscard]] perception::Pose2 sampled(const std::vector<perception::Pose2>& poses,
                                          double t) const;
};

struct RobotTraceOptions {
  double acceleration_m_per_s2 = 2;
  double rate_hz = 20;
  bool sideways = false;  // only vy and stops
  double length_s = 60;
  std::uint64_t seed = 1;
};
[[nodiscard]] MotionTrace robot_trace(const RobotTraceOptions&);

// Throws std::runtime_error with file and line.
[[nodiscard]] MotionTrace log_trace(const std::string& file, const std::string& name);
// t_s,vx,wz: what the log's robot was told.
[[nodiscard]] std::vector<MotionCommand> log_commands(const std::string& file);

// All of a bench or of the choice of constants. `folder`: of the logs; empty: none. `choice`: the
// data that constants were chosen on (seed 5, first halves of the logs); else those that judge
// (seed 4, second halves).
struct TraceSetOptions {
  std::string folder;
  std::uint64_t seed = 4;
  double length_s = 60;
  bool choice = false;
};
[[nodiscard]] std::vector<MotionTrace> trace_set(const TraceSetOptions&);

}  // namespace teletact

// Prediction, 10 Hz, hard: the path's next goal, moved ahead by the round-trip delay.
//
//   reads    Latest<RobotState>   from robot_io, over the link, in local time; silent -> not
//   engaged
//            Latest<Path>         from planning
//            Latest<CameraPose>   from fusion, only with `map_correction`
//            Latest<ModeMsg>      from supervision of the operator box
//            round trip and its uncertainty, from the link's clock estimate
//   writes   RobotGoal            over the link, to robot_io
//   budget   2 ms of the 100 ms period
//
// The goal is chosen between path point and marked point by the larger distance to the robot (see
// path_follower.hpp) from where the robot will be one round trip later, by its predicted velocity
// (motion_predictor.hpp). It never lies beyond the path's end, so the robot slows down to it.
// Frames: W world (= map), O odometry (equal to W at the start; X_WO follows the camera's pose when
// `map_correction` is on), B base. SI units.
#pragma once

#include <cstdint>

#include "drivers/link/messages.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/tick.hpp"
#include "tasks/graph/messages.hpp"
#include "tasks/graph/table.hpp"
#include "tasks/prediction/motion_predictor.hpp"
#include "tasks/prediction/path_follower.hpp"

namespace tasks {

// Section [prediction].
struct PredictionConfig {
  MotionPredictorConfig motion;
  PathFollowerConfig path;
  double speed_m_per_s = 0.5;  // sent as the goal's speed limit
  int goal_valid_ms = limit_of(EdgeId::kGoal, TaskId::kRobotIo).data_age_ms;
  // Older robot states do not drive.
  int state_liveness_ms = limit_of(EdgeId::kRobotState, TaskId::kPrediction).data_age_ms;
  double horizon_limit_s = 1.0;       // the goal is moved ahead by at most this much
  double uncertainty_share_m = 0.05;  // speed x delay uncertainty stays below it
  bool map_correction = false;
  double map_gain = 0.1;     // share of the difference taken per camera pose
  double map_step_m = 0.01;  // and at most this much
  double map_step_rad = 0.01;
  double map_gate_m = 0.5;  // a difference beyond it is not believed

  void describe(config::Section& s) {
    motion.describe(s.section("motion", "velocity prediction"));
    path.describe(s.section("path", "path following"));
    s.number("speed_m_per_s", speed_m_per_s, 0.01, 0.8, "speed limit sent with a goal");
    s.integer("goal_valid_ms", goal_valid_ms, 20, 5000, "life time of a goal");
    s.integer("state_liveness_ms", state_liveness_ms, 20, 5000, "older robot states do not drive");
    s.number("horizon_limit_s", horizon_limit_s, 0, 10, "largest lead of a goal");
    s.number("uncertainty_share_m", uncertainty_share_m, 0.001, 1,
             "way driven within the uncertainty of the delay");
    s.flag("map_correction", map_correction, "follow the camera's pose in the map");
    s.number("map_gain", map_gain, 0.001, 1, "share of a correction taken at once");
    s.number("map_step_m", map_step_m, 1e-4, 1, "largest correction at once");
    s.number("map_step_rad", map_step_rad, 1e-4, 1, "largest correction at once");
    s.number("map_gate_m", map_gate_m, 0.01, 100, "larger differences are not believed");
  }
};

namespace prediction_fault {
inline constexpr rt::FaultId kStateStale = 301;    // no robot state for too long: not engaged
inline constexpr rt::FaultId kStateRefused = 302;  // not finite: counted
inline constexpr rt::FaultId kPathRefused = 303;   // not finite: counted, the old path is dropped
inline constexpr rt::FaultId kDelayUnknown = 304;  // no round trip measured: not engaged
inline constexpr rt::FaultId kCorrectionRefused = 305;  // camera pose too far off: counted
}  // namespace prediction_fault

struct PredictionTelemetry {
  perception::Pose2 X_WB;            // newest measured
  perception::Pose2 predicted_X_WB;  // where it will be when the goal arrives
  perception::Pose2 X_WO;
  double lead_s = 0;  // newest state to predicted
  double remaining_m = 0, off_path_m = 0;
  double end_distance_m = 0;  // measured base to the end of the path
  bool goal_is_mark = false;
  bool arrived = false;  // at the end of the path in force, latched
  std::uint64_t path_seq = 0;
};

class PredictionTask {
 public:
  struct In {
    const drivers::RobotState* robot = nullptr;  // newest, local time; null: none yet
    bool robot_live = true;                      // false: silent or too old, does not drive
    const Path* path = nullptr;                  // newest; null or seq 0: no path
    const CameraPose* camera = nullptr;
    const ModeMsg* mode = nullptr;
    bool delay_known = false;
    rt::Nanos round_trip{0};
    rt::Nanos round_trip_uncertainty{0};
  };
  struct Out {
    drivers::RobotGoal goal;  // always valid to send; engaged = 0 holds the robot
    PredictionTelemetry telemetry;
  };

  // `X_BC`: camera in the base, used by the map correction only.
  PredictionTask(rt::NonRealtime&, const PredictionConfig&, const Pose& X_BC = Pose::Identity());
  // One cycle. No throw, lock, allocation or I/O.
  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;

 private:
  [[nodiscard]] rt::Health take_state(const In&) noexcept;
  [[nodiscard]] rt::Health take_path(const In&) noexcept;
  [[nodiscard]] rt::Health correct_map(const In&) noexcept;
  [[nodiscard]] bool make_goal(const rt::Tick&, const In&, Out&, rt::Health&) noexcept;
  [[nodiscard]] double to_seconds(rt::Time t) const noexcept { return rt::seconds(t - epoch_); }

  PredictionConfig config_;
  Pose X_CB_;
  MotionPredictor motion_;
  PathFollower follower_;
  perception::Pose2 X_WO_;
  bool have_state_ = false, epoch_set_ = false;
  rt::Time epoch_{};
  drivers::RobotState state_;
  std::uint64_t camera_seq_ = 0, seq_ = 0, refused_path_ = 0;
};

}  // namespace tasks

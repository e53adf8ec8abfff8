// Prediction, 10 Hz, hard: the path's next goal, moved ahead by the round-trip delay.
//
//   reads    Latest<RobotState>   from robot_io, over the link, in local time; silent ->
//                                not engaged
//            Latest<Path>         from planning
//            Latest<CameraPose>   from fusion: where O lies in W
//            Latest<DriveIntent>  from the console: a velocity instead of the path
//            Latest<ModeMsg>      from supervision of the operator box
//            round trip and its uncertainty, from the link's clock estimate
//   writes   RobotGoal            over the link, to robot_io
//            OdometryFrame        to planning, console: the one writer of X_WO (world_filter.hpp)
//   budget   2 ms of the 100 ms period
//
// The goal is chosen between path point and marked point by the larger distance to the robot (see
// path_follower.hpp) from where the robot will be one round trip later, by its predicted velocity
// (motion_predictor.hpp). It never lies beyond the path's end, so the robot slows down to it.
// A camera that is lost leaves odometry, whose stated error grows with the way. Before it passes
// `error_limit_m` with the base at rest, goals are no longer engaged; they are again when it is
// below half of that. Frames: W world (= map), O odometry (equal to W at the start; X_WO follows
// the camera's claimed poses unless `map_correction` is off), B base. SI units.
#pragma once

#include <cstdint>

#include "drivers/link/messages.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/operator_act.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/prediction/motion_predictor.hpp"
#include "tasks/prediction/path_follower.hpp"
#include "tasks/prediction/world_filter.hpp"

namespace tasks {

// Section [prediction].
struct PredictionConfig {
  MotionPredictorConfig motion;
  PathFollowerConfig path;
  double speed_m_per_s = 0.5;  // sent as the goal's speed limit
  // A goal is followed until the one after the next should have come: two periods of this task, one
  // of the link's.
  int goal_hold_ms = 250;
  int goal_valid_ms = limit_of(EdgeId::kGoal, TaskId::kRobotIo).data_age_ms;
  // Older robot states do not drive.
  int state_liveness_ms = limit_of(EdgeId::kRobotState, TaskId::kPrediction).data_age_ms;
  double horizon_limit_s = 1.0;       // the goal is moved ahead by at most this much
  double settle_s = 1.0;              // after a robot state that was too old or missing
  double uncertainty_share_m = 0.05;  // speed x delay uncertainty stays below it
  // Of 0.55 s at the speed limit: docs/prediction.md.
  double blind_way_m = 0.275;
  WorldFilterConfig world;
  bool map_correction = true;   // off: O is taken as W, and its error is not known
  double error_limit_m = 0.15;  // of the stated error of the base's place, once it stands
  double brake_m_per_s2 = 0.6;  // the base stops at least so fast

  void describe(config::Section& s) {
    motion.describe(s.section("motion", "velocity prediction"));
    path.describe(s.section("path", "path following"));
    s.number("speed_m_per_s", speed_m_per_s, 0.01, 0.8, "speed limit sent with a goal");
    s.integer("goal_hold_ms", goal_hold_ms, 20, 5000, "life of a goal beyond the round trip");
    s.integer("goal_valid_ms", goal_valid_ms, 20, 5000, "longest life of a goal");
    s.integer("state_liveness_ms", state_liveness_ms, 20, 5000, "older robot states do not drive");
    s.number("settle_s", settle_s, 0, 10,
             "after an old or missing robot state the base stands until all were in time for this "
             "long; a quarter where all were for twice as long before");
    s.number("horizon_limit_s", horizon_limit_s, 0, 10, "largest lead of a goal");
    s.number("uncertainty_share_m", uncertainty_share_m, 0.001, 1,
             "way driven within the uncertainty of the delay");
    s.number("blind_way_m", blind_way_m, 0.01, 10,
             "way driven on one robot state, until the goal that was made from it ends");
    world.describe(s.section("world", "odometry against the camera's poses"));
    s.flag("map_correction", map_correction,
           "follow the camera's pose in the map; off: the odometry frame is the world");
    s.number("error_limit_m", error_limit_m, 0.01, 10,
             "the base stands before the stated error of its place passes this");
    s.number("brake_m_per_s2", brake_m_per_s2, 0.05, 8, "the base stops at least so fast");
  }
};

namespace prediction_fault {
inline constexpr rt::FaultId kStateStale = 301;    // no robot state for too long: not engaged
inline constexpr rt::FaultId kStateRefused = 302;  // not finite: counted
inline constexpr rt::FaultId kPathRefused = 303;   // not finite: counted, the old path is dropped
inline constexpr rt::FaultId kDelayUnknown = 304;  // no round trip measured: not engaged
inline constexpr rt::FaultId kCorrectionRefused = 305;  // camera pose too far off: counted
inline constexpr rt::FaultId kPlaceUnsure = 306;        // stated error above the limit: not engaged
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
    rt::Nanos robot_unsure{0};                   // of the instant of its measurement
    const Path* path = nullptr;                  // newest; null or seq 0: no path
    const CameraPose* camera = nullptr;
    const ModeMsg* mode = nullptr;
    const DriveIntent* drive = nullptr;  // held, and young enough; null: nobody drives by hand
    bool delay_known = false;
    rt::Nanos round_trip{0};
    rt::Nanos round_trip_uncertainty{0};
  };
  struct Out {
    drivers::RobotGoal goal;  // always valid to send; engaged = 0 holds the robot
    OdometryFrame frame;
    PredictionTelemetry telemetry;
  };

  // `X_BC`: camera in the base, used by the map correction only. `start_known`: O is W at the
  // start; else nothing is engaged before a claimed pose says where the base is.
  PredictionTask(rt::NonRealtime&, const PredictionConfig&, const Pose& X_BC = Pose::Identity(),
                 bool start_known = true);
  // One cycle. No throw, lock, allocation or I/O.
  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;

 private:
  [[nodiscard]] rt::Health take_state(const In&) noexcept;
  [[nodiscard]] rt::Health take_path(const In&) noexcept;
  [[nodiscard]] rt::Health correct_map(const In&) noexcept;
  void write_frame(Out&) noexcept;
  [[nodiscard]] bool sure_enough(double lead_s) noexcept;
  [[nodiscard]] bool in_time(const rt::Tick&, const In&, OdometryFrame&) noexcept;
  [[nodiscard]] double speed_limit(rt::Nanos age, rt::Nanos life, rt::Nanos unsure) const noexcept;
  [[nodiscard]] static bool usable(const DriveIntent* drive) noexcept;
  void drive_goal(const DriveIntent& drive, const perception::Pose2& X_OB,
                  drivers::RobotGoal& goal) const noexcept;
  void limit_goal(const rt::Tick&, const In&, drivers::RobotGoal&) const noexcept;
  [[nodiscard]] bool make_goal(const rt::Tick&, const In&, Out&, rt::Health&) noexcept;
  [[nodiscard]] double to_seconds(rt::Time t) const noexcept { return rt::seconds(t - epoch_); }

  PredictionConfig config_;
  Pose X_CB_;
  MotionPredictor motion_;
  PathFollower follower_;
  WorldFilter world_;
  bool have_state_ = false, epoch_set_ = false;
  bool unsure_ = false, was_late_ = false;
  bool single_ = false;    // the newest lateness came after a long time without one
  bool settling_ = false;  // in time again, not yet for long enough
  // late_at_: of the last job whose robot state was too old or missing
  rt::Time epoch_{}, late_at_{}, in_time_since_ = rt::Time::max();
  drivers::RobotState state_;
  std::uint64_t camera_seq_ = 0, seq_ = 0, refused_path_ = 0, frame_seq_ = 0;
};

}  // namespace tasks

// Robot I/O, 1 kHz, hard: goal and wheel angles in, wheel speeds out.
//
//   sense    MotorStates           from drivers/youbot   (bus, outside step)
//   reads    Latest<RobotGoal>     from prediction, over the link; silent or expired -> ramp down
//            Latest<ModeMsg>       from supervision of the robot box
//            SafetyInputs          from drivers/gpio, where fitted (safety_watch.hpp)
//   act      MotorSetpoints        to drivers/youbot     (bus, outside step; of the same job)
//   writes   RobotState            over the link, to prediction, planning, fusion, supervision
//                                  and the console
//   budget   100 us of the 1 ms period
//
// Frames: O odometry (= world at the start), B base. SI units.
// The base moves only while: mode engaged, bus up, a finite goal that is engaged and not expired,
// the link heard from. A fault among these ramps it down with its own, steeper deceleration; a goal
// that is not engaged halts it with the acceleration limit; safe stop switches the motors off at
// once; what of the bus and its motors is a fault: bus_watch.hpp. What a safe stop has latched (the
// motors' watchdog, an encoder fault) goes with the
// operator's clear; until supervision is seen in its safe stop the fault stays reported.
// Motors that were off start from what their wheels do: the first setpoints are the wheels' own
// speeds, the reference is where the base is, and goals made before that instant are void.
#pragma once

#include <cstdint>

#include "drivers/link/messages.hpp"
#include "drivers/youbot/mecanum.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/robot_io/bus_watch.hpp"
#include "tasks/robot_io/safety_watch.hpp"
#include "tasks/robot_io/trajectory.hpp"

namespace tasks {

// Section [robot_io].
struct RobotIoConfig {
  TrajectoryConfig trajectory;
  drivers::MecanumConfig base;
  double wheel_speed_limit_rad_per_s = 25;
  // Nothing heard from the operator box: ramp down. Motion goes on by itself when the link is back
  // before supervision has called it silent.
  int link_silence_ms = limit_of(EdgeId::kGoal, TaskId::kRobotIo).liveness_ms;
  // From the command's zero until the base stands (below 0.01 m/s): the tail of the speed loop.
  double motor_settle_s = 0.07;
  int frames_lost_limit = 100;  // consecutive: the bus counts as down, safe stop
  double start_x_m = 0, start_y_m = 0, start_yaw_rad = 0;  // X_OB at the start

  void describe(config::Section& s) {
    trajectory.describe(s.section("trajectory", "limits and gains of the base"));
    base.describe(s.section("base", "geometry of the base"));
    s.number("wheel_speed_limit_rad_per_s", wheel_speed_limit_rad_per_s, 1, 100,
             "largest wheel speed; the twist is scaled down to it");
    s.integer("link_silence_ms", link_silence_ms, 10, 10000,
              "ramp down after this silence of the link");
    s.number("motor_settle_s", motor_settle_s, 0, 1,
             "from the command's zero until the base stands");
    s.integer("frames_lost_limit", frames_lost_limit, 1, 10000,
              "consecutive lost bus frames that count as a lost bus");
    s.number("start_x_m", start_x_m, -1000, 1000, "pose at the start");
    s.number("start_y_m", start_y_m, -1000, 1000, "pose at the start");
    s.number("start_yaw_rad", start_yaw_rad, -3.1416, 3.1416, "pose at the start");
  }
};

namespace robot_io_fault {
inline constexpr rt::FaultId kGoalExpired = 503;  // ramp down
inline constexpr rt::FaultId kGoalRefused = 504;  // not finite: ignored, counted
inline constexpr rt::FaultId kLinkSilent = 505;   // ramp down
inline constexpr rt::FaultId kEncoder = 507;      // not finite or a leap: safe stop
inline constexpr rt::FaultId kTracking = 508;     // base does not follow: reference waits
}  // namespace robot_io_fault

struct RobotIoTelemetry {
  perception::Pose2 X_OR;       // reference pose of the controller
  double tracking_error_m = 0;  // |reference - odometry| while driving, else 0
  double tracking_error_rad = 0;
  double tracking_error_max_m = 0;  // largest so far
  double goal_distance_m = 0;       // odometry to the goal in force, 0 without one
  double odometry_path_m = 0;
  std::uint64_t frames_lost = 0, goals_refused = 0, goals_expired = 0;
  bool driving = false;  // following a goal in this tick
};

class RobotIoTask {
 public:
  struct In {
    drivers::BusStatus bus = drivers::BusStatus::kDown;
    drivers::MotorStates motors;  // read in this job; valid when bus is kOk
    // What became of the setpoints of the job before this one.
    drivers::BusStatus sent = drivers::BusStatus::kOk;
    // Of the read; of a good one, of that write.
    drivers::BusDetail bus_detail;
    const drivers::RobotGoal* goal = nullptr;  // newest, times of this box; null: none yet
    rt::Nanos goal_unsure{0};                  // of its times: it ends so much earlier
    const ModeMsg* mode = nullptr;             // newest; null: not engaged
    bool link_heard = false;                   // ever
    rt::Time link_heard_at{};                  // last valid message of the operator box
    bool link_closed = false;                  // its connection has ended
    drivers::SafetyInputs safety;              // of this job; not fitted: none
  };
  struct Out {
    drivers::MotorSetpoints setpoints;
    drivers::RobotState state;
    RobotIoTelemetry telemetry;
    // The operator clears: the driver lets go of what its motors have latched.
    bool rearm_motors = false;
    drivers::SafetyOutputs safety;  // where fitted
    BusReport bus;                  // who has the fault
  };

  // Throws std::invalid_argument if a limit contradicts another one.
  RobotIoTask(rt::NonRealtime&, const RobotIoConfig&);
  // One cycle. No throw, lock, allocation or I/O.
  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;

 private:
  enum class Drive : std::uint8_t { kOff, kRampDown, kHalt, kGoal };
  [[nodiscard]] rt::Health sense_bus(const rt::Tick&, const In&) noexcept;
  void let_go(Out&) noexcept;
  [[nodiscard]] rt::Health until_seen(rt::Health) noexcept;
  void start_motors(const In&, Out&) noexcept;
  [[nodiscard]] Drive decide(const rt::Tick&, const In&, rt::Health&) noexcept;
  [[nodiscard]] rt::Health accept_goal(const In&) noexcept;
  void write_setpoints(Drive, double dt, Out&) noexcept;
  [[nodiscard]] std::uint8_t pauses(const rt::Tick&, const In&) const noexcept;
  void write_state(const rt::Tick&, const In&, rt::Health, Out&) noexcept;

  RobotIoConfig config_;
  drivers::Mecanum kinematics_;
  drivers::Odometry odometry_;
  Trajectory trajectory_;
  drivers::RobotGoal goal_;  // last accepted one
  bool have_goal_ = false, expiry_counted_ = false;
  bool powered_ = false;  // the last job's setpoints were speeds
  // Of wheels that were off: what of their speeds is no motion of the base. It goes to zero.
  drivers::WheelVector residual_rad_per_s_{};
  rt::Time off_until_{};  // goals made before it are void
  std::uint64_t refused_seq_ = 0;
  Mode last_mode_ = Mode::kInit;
  std::uint64_t seq_ = 0;
  perception::Twist2 v_measured_;
  perception::Twist2 v_commanded_;
  perception::Pose2 last_pose_;
  rt::Time motors_taken_{};
  std::uint64_t motors_seq_ = 0;
  bool encoder_fault_ = false, encoder_readable_ = false;
  rt::Health unseen_stop_;  // a safe stop that supervision has not taken up yet
  SafetyWatch safety_;
  BusWatch bus_;
  RobotIoTelemetry telemetry_;
};

}  // namespace tasks

// The messages that cross between the boxes, apart from images. Plain data, SI units.
// Wire form: drivers/link/wire.hpp, little-endian, in the order of the field lists below; the
// schema hash covers their names, sizes and order.
#pragma once

#include <array>
#include <cstdint>

#include "rt/message/fields.hpp"
#include "rt/time.hpp"

namespace drivers {

enum class MessageId : std::uint16_t {
  kHello = 1,     // first on a connection, both ways
  kClockRequest,  // both ways: each side measures the other's clock
  kClockReply,
  kFrame,          // robot -> operator: EncodedFrame
  kRobotState,     // robot -> operator
  kRobotGoal,      // operator -> robot
  kBye,            // an orderly end, both ways
  kAlive,          // nothing to say: sent when the line would else be quiet, both ways
  kFrameReport,    // operator -> robot, where frames are coded on demand
  kCommandReport,  // robot -> operator, when a goal was refused
};
inline constexpr int kMessageIds = 10;

// Planar pose and velocity of the base B in the odometry frame O (starts equal to the world).
struct RobotState {
  std::uint64_t seq = 0;
  rt::Time made{};   // by the robot's box: that it lives is told by this alone
  rt::Time taken{};  // the motors' measurement, which may be older: a bus fails, the box goes on
  double x_m = 0, y_m = 0, yaw_rad = 0;       // X_OB
  double vx = 0, vy = 0, wz = 0;              // body frame, m/s, rad/s, measured
  double cmd_vx = 0, cmd_vy = 0, cmd_wz = 0;  // body frame, commanded in the same cycle
  std::uint64_t goal_seq = 0;                 // newest RobotGoal the robot has accepted
  std::uint8_t mode = 0;                      // tasks::Mode of the robot box
  std::uint8_t moving = 0;
  std::uint16_t fault = 0;
  // A silence of the link alone has taken the robot's box out of the engaged mode, and it goes on
  // if the operator still asks for it. 1: it is still silent. 2: it is heard again.
  std::uint8_t pauses = 0;
  std::uint16_t mode_cause = 0;  // the fault that put the robot's box into `mode`, 0: none
};

// Where the base shall go next, made 10 times a second by prediction.
struct RobotGoal {
  std::uint64_t seq = 0;
  rt::Time made{};
  rt::Time valid_until{};                // beyond it the robot holds still
  double x_m = 0, y_m = 0, yaw_rad = 0;  // target pose X_OG
  double vx = 0, vy = 0, wz = 0;         // feed-forward at the target, body frame
  double speed_limit_m_per_s = 0;
  std::uint8_t engaged = 0;  // 0: hold still, whatever the pose says
  // 1: the operator's box is in the engaged mode. 2: a silence has interrupted it, and it goes on
  // with an act that is still held if the silence ends in time; until then the robot stays out of
  // it.
  std::uint8_t operator_engaged = 0;
  std::uint8_t operator_clear = 0;  // the operator holds the button that clears a safe stop
  std::uint64_t path_seq = 0;
};

// What became of the frames, from the end that decodes them.
struct FrameReport {
  std::uint64_t arrived = 0;    // number of the newest frame that arrived, good or not
  std::uint8_t key_wanted = 0;  // 1: the decoder takes no frame but one that needs none before it
};

// What became of the operator's goals at the robot's box, since that one started
// (command_gate.hpp).
struct CommandReport {
  std::uint64_t replayed = 0, reordered = 0, out_of_range = 0, from_ahead = 0, late = 0;
  std::uint8_t newest = 0;  // CommandFault
};

// Clock exchange: t0 sent by the asker, t1 received and t2 sent by the other (its clock).
struct ClockRequest {
  std::int64_t t0_ns = 0;
};
struct ClockReply {
  std::int64_t t0_ns = 0, t1_ns = 0, t2_ns = 0;
};

}  // namespace drivers

template <>
struct rt::Fields<drivers::RobotState> {
  using M = drivers::RobotState;
  static constexpr auto kList = fields(
      value(&M::seq, "seq"), instant(&M::made, "made"), datum(&M::taken, "taken"),
      number(&M::x_m, "x"), number(&M::y_m, "y"), number(&M::yaw_rad, "yaw"), number(&M::vx, "vx"),
      number(&M::vy, "vy"), number(&M::wz, "wz"), value(&M::cmd_vx, "cmd_vx"),
      value(&M::cmd_vy, "cmd_vy"), value(&M::cmd_wz, "cmd_wz"), value(&M::goal_seq, "goal_seq"),
      value(&M::mode, "mode", 4), value(&M::moving, "moving", 1), value(&M::fault, "fault"),
      value(&M::pauses, "pauses", 2), value(&M::mode_cause, "mode_cause"));
};
static_assert(rt::lists_every_field<drivers::RobotState>());

template <>
struct rt::Fields<drivers::RobotGoal> {
  using M = drivers::RobotGoal;
  static constexpr auto kList = fields(
      value(&M::seq, "seq"), datum(&M::made, "made"), instant(&M::valid_until, "valid_until"),
      number(&M::x_m, "x"), number(&M::y_m, "y"), number(&M::yaw_rad, "yaw"), number(&M::vx, "vx"),
      number(&M::vy, "vy"), number(&M::wz, "wz"), number(&M::speed_limit_m_per_s, "speed_limit"),
      value(&M::engaged, "engaged", 1), value(&M::operator_engaged, "operator_engaged", 2),
      value(&M::operator_clear, "operator_clear", 1), value(&M::path_seq, "path_seq"));
};
static_assert(rt::lists_every_field<drivers::RobotGoal>());

template <>
struct rt::Fields<drivers::FrameReport> {
  using M = drivers::FrameReport;
  static constexpr auto kList =
      fields(value(&M::arrived, "arrived"), value(&M::key_wanted, "key_wanted", 1));
};
static_assert(rt::lists_every_field<drivers::FrameReport>());

template <>
struct rt::Fields<drivers::CommandReport> {
  using M = drivers::CommandReport;
  static constexpr auto kList =
      fields(value(&M::replayed, "replayed"), value(&M::reordered, "reordered"),
             value(&M::out_of_range, "out_of_range"), value(&M::from_ahead, "from_ahead"),
             value(&M::late, "late"), value(&M::newest, "newest", 5));
};
static_assert(rt::lists_every_field<drivers::CommandReport>());

template <>
struct rt::Fields<drivers::ClockRequest> {
  using M = drivers::ClockRequest;
  static constexpr auto kList = fields(instant(&M::t0_ns, "t0i"));
};
static_assert(rt::lists_every_field<drivers::ClockRequest>());

template <>
struct rt::Fields<drivers::ClockReply> {
  using M = drivers::ClockReply;
  static constexpr auto kList =
      fields(instant(&M::t0_ns, "t0i"), instant(&M::t1_ns, "t1i"), instant(&M::t2_ns, "t2i"));
};
static_assert(rt::lists_every_field<drivers::ClockReply>());

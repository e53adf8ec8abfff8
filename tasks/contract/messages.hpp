// Messages between the operator's tasks. Plain data, SI, world (= map) frame W unless named.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "rt/health.hpp"
#include "rt/time.hpp"

namespace tasks {

using perception::Pose;
using perception::Vec3;

// Box modes; supervision is the only writer. Motion after a restart needs an explicit engage.
enum class Mode : std::uint8_t { kInit, kHold, kEngaged, kRampDown, kSafeStop };

struct ModeMsg {
  std::uint64_t seq = 0;
  rt::Time stamp{};
  Mode mode = Mode::kInit;
  rt::FaultId cause = rt::kNoFault;
  bool clear = false;  // the operator clears: devices and tasks reset what they have latched
  // Ramped down by a silence of the link alone: it goes on when the link is back in time, as long
  // as the operator's engage is held.
  bool resumes = false;
};

// Where the hand is, for fusion's window and for the console. haptic -> fusion, every tick.
struct HapticState {
  std::uint64_t seq = 0;
  rt::Time stamp{};
  Vec3 p_WH = Vec3::Zero();  // stylus tip
  Vec3 v_WH = Vec3::Zero();
  Vec3 p_WP = Vec3::Zero();      // proxy
  Vec3 f_H_W = Vec3::Zero();     // force on the hand, N, after all guards
  Vec3 normal_W = Vec3::Zero();  // of the contact; zero when free
  std::int32_t contacts = 0;     // active constraints
  bool button = false;
  std::uint64_t patch_seq = 0;   // newest patch in use
  std::uint64_t mark_seq = 0;    // event seq of the newest mark that was begun; 0: none yet
  Vec3 p_mark_W = Vec3::Zero();  // where it was begun, on the surface
};

// What the hand did, in order. haptic -> planning, Ring. A full ring drops the newest and sets
// `gap` in the next one that fits; after a gap planning drops an open mark.
struct TouchEvent {
  enum class Kind : std::uint8_t {
    kContactBegin,
    kContactEnd,
    kMarkBegin,
    kMarkPoint,
    kMarkEnd,
    kSurfaceLeft,  // the touched surface left, or came faster than the hand can follow
  };
  std::uint64_t seq = 0;
  rt::Time stamp{};
  Kind kind = Kind::kContactBegin;
  bool gap = false;
  Vec3 p_W = Vec3::Zero();  // proxy position on the surface
  Vec3 normal_W = Vec3::Zero();
  double force_N = 0;
};

// Where fusion says the camera is. fusion -> prediction, haptic, console.
struct CameraPose {
  enum class Tracking : std::uint8_t { kLost = 0, kWeak = 1, kTracking = 2 };
  std::uint64_t seq = 0;
  rt::Time exposure{};
  Pose X_WC = Pose::Identity();
  Tracking tracking = Tracking::kLost;
  bool claimed = false;  // trusted: perception/icp/tracker.hpp
  rt::Time seen{};       // exposure of the newest claimed image: this one, or the one before a loss
};

// Why prediction lets the base stand.
enum class Held : std::uint8_t {
  kNo,
  kStateOld,  // the newest robot state, with the uncertainty of its instant, is too old to drive on
  kStateSilent,   // none came
  kSettling,      // one of these two held until a moment ago
  kDelayUnknown,  // no round trip was measured
  kPlaceUnsure,
  kModeSilent,
  kPathOld,
};

// Pose of the odometry frame O in the world with its covariance, and whether the base may be
// driven.
// prediction -> planning, console.
struct OdometryFrame {
  std::uint64_t seq = 0;
  rt::Time taken{};              // of the robot state it was carried to
  rt::Time claimed{};            // exposure of the newest claimed image in it; 0: none yet
  std::array<double, 3> X_WO{};  // x, y, yaw
  std::array<double, 6>
      covariance{};  // of the base's pose in W then: xx, xy, x yaw, yy, y yaw, yaw yaw
  double error_m = 0, error_rad = 0;  // stated: three standard deviations (world_filter.hpp)
  bool known = false;                 // false: X_WO is not known yet
  bool follows_camera = false;        // false: O is taken as W, with an unknown error
  bool unsure = false;                // the stated error is above its limit: goals are not engaged
  // Why goals are not engaged although the mode is, with the measured value and its limit, ms.
  Held held = Held::kNo;
  std::int32_t held_ms = 0, held_limit_ms = 0;
};

// A path for the base on the ground, in W (z of the ground plane). planning -> prediction.
struct Path {
  static constexpr int kMaxPoints = 256;
  std::uint64_t seq = 0;  // 0: there is no path
  rt::Time made{};
  std::uint64_t mark_seq = 0;  // event seq of the mark it answers
  rt::Time mark_stamp{};
  std::int32_t size = 0;
  std::array<std::array<double, 3>, kMaxPoints> points{};  // x, y, yaw of the base in W
  Vec3 marked_W = Vec3::Zero();
  rt::Time seen{};  // newest claimed image of the map that last let it pass
};

// planning -> console.
struct TaskState {
  enum class Phase : std::uint8_t {
    kIdle,
    kPlanning,
    kDriving,
    kArrived,
    kFailed,
    kShort,  // stands at the end of its path, which is not where it was asked to go: off_m
  };
  std::uint64_t seq = 0;
  rt::Time stamp{};
  // Why the newest goal was given up; kNo unless the phase is kFailed.
  enum class Failure : std::uint8_t {
    kNo,
    kNoMap,    // of the floor, or nothing heard of the robot
    kStart,    // the base may not set off from where it stands
    kNoWay,    // no floor that was seen leads there
    kNoTime,   // none was found in the time there is
    kNoGrasp,  // the arm can not take the object
  };
  Phase phase = Phase::kIdle;
  Failure failure = Failure::kNo;
  std::uint32_t marks = 0, paths = 0, failures = 0;
  // From the end of the newest path to the goal that was asked for, on the ground; below 0: there
  // is no path. is_short: too far to be called an arrival.
  double off_m = -1;
  bool is_short = false;
};

}  // namespace tasks

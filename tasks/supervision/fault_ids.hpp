// Every fault of the stack, as ordered data: id, severity, reaction, clear rule. docs/faults.md is this
// table; a test compares them. The tasks name their own ids in their own headers, since no task
// includes another; a test compares those too. A number is an identity and says nothing by itself.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "rt/health.hpp"

namespace tasks {

// How a fault ends, once its condition is gone.
enum class ClearRule : std::uint8_t {
  kItself,    // the next engage may start motion
  kOperator,  // an explicit clear first
  kRestart,   // only a new start of the program
};

struct FaultRow {
  rt::FaultId id;
  std::string_view code;  // F-HAP-01
  rt::Severity severity;  // at least this, whatever the task reported
  ClearRule clear;
  std::string_view what;      // what happened
  std::string_view reaction;  // what the stack does
};

// clang-format off
inline constexpr std::array kFaultTable = {
  FaultRow{101, "F-HAP-01", rt::Severity::kDegraded, ClearRule::kItself, "haptic: a value is not finite", "force zero; back through the fade"},
  FaultRow{102, "F-HAP-02", rt::Severity::kDegraded, ClearRule::kItself, "haptic: surface patch not published for its liveness time", "force ramps to zero; returns with the patch"},
  FaultRow{103, "F-HAP-03", rt::Severity::kCounted, ClearRule::kItself, "haptic: no sample from the device", "last force held for its liveness, then zero"},
  FaultRow{104, "F-HAP-04", rt::Severity::kCounted, ClearRule::kItself, "haptic: malformed patch or ray cast refused", "the patches in use stay; without a ray cast no contact"},
  FaultRow{105, "F-HAP-05", rt::Severity::kDegraded, ClearRule::kItself, "haptic: ray cast of force_shading not published for its liveness time", "force ramps to zero; returns with the ray cast"},
  FaultRow{190, "F-HAP-90", rt::Severity::kSafeStop, ClearRule::kOperator, "haptic: task silent", "safe stop; device made safe by the watchdog"},
  FaultRow{201, "F-FUS-01", rt::Severity::kDegraded, ClearRule::kItself, "fusion: tracking lost", "nothing integrated; the map stays as it is"},
  FaultRow{202, "F-FUS-02", rt::Severity::kCounted, ClearRule::kItself, "fusion: a direction is only guessed", "the frame is not claimed and not integrated"},
  FaultRow{203, "F-FUS-03", rt::Severity::kDegraded, ClearRule::kRestart, "fusion: block pool full", "what does not fit is lost and counted"},
  FaultRow{204, "F-FUS-04", rt::Severity::kCounted, ClearRule::kItself, "fusion: image of another size, or empty", "image refused"},
  FaultRow{205, "F-FUS-05", rt::Severity::kCounted, ClearRule::kItself, "fusion: joints missing or too old for the image", "image refused: nobody knows where the robot's body is in it"},
  FaultRow{290, "F-FUS-90", rt::Severity::kRampDown, ClearRule::kItself, "fusion: task silent", "ramp down; the hand goes limp with the patch"},
  FaultRow{301, "F-PRE-01", rt::Severity::kDegraded, ClearRule::kItself, "prediction: no robot state for too long", "goals are not engaged: the robot holds still"},
  FaultRow{302, "F-PRE-02", rt::Severity::kCounted, ClearRule::kItself, "prediction: robot state not finite", "state refused; the last one ages"},
  FaultRow{303, "F-PRE-03", rt::Severity::kCounted, ClearRule::kItself, "prediction: path not finite", "path refused and the old one dropped"},
  FaultRow{304, "F-PRE-04", rt::Severity::kDegraded, ClearRule::kItself, "prediction: no round trip measured", "goals are not engaged: the robot holds still"},
  FaultRow{305, "F-PRE-05", rt::Severity::kCounted, ClearRule::kItself, "prediction: camera pose too far from the odometry", "correction refused"},
  FaultRow{306, "F-PRE-06", rt::Severity::kDegraded, ClearRule::kItself, "prediction: where the base is, is not sure enough", "goals are not engaged: the robot stands until the camera says where it is"},
  FaultRow{390, "F-PRE-90", rt::Severity::kRampDown, ClearRule::kItself, "prediction: task silent", "ramp down; goals expire at the robot"},
  FaultRow{401, "F-PLN-01", rt::Severity::kCounted, ClearRule::kItself, "planning: no path to the goal", "goal given up; the robot stays; a new mark is needed"},
  FaultRow{402, "F-PLN-02", rt::Severity::kDegraded, ClearRule::kItself, "planning: the planning library threw", "no path this job; tried again, then given up"},
  FaultRow{403, "F-PLN-03", rt::Severity::kCounted, ClearRule::kItself, "planning: input not finite, or ground not level", "mark, robot pose or map refused"},
  FaultRow{404, "F-PLN-04", rt::Severity::kCounted, ClearRule::kItself, "planning: touch events were lost", "an open mark is dropped"},
  FaultRow{405, "F-PLN-05", rt::Severity::kCounted, ClearRule::kItself, "planning: job out of time", "job aborted, nothing committed; the next one tries again"},
  FaultRow{406, "F-PLN-06", rt::Severity::kCounted, ClearRule::kItself, "planning: jobs for one mark out of time, again and again", "goal given up; the robot stays; a new mark is needed"},
  FaultRow{407, "F-PLN-07", rt::Severity::kCounted, ClearRule::kItself, "planning: the marked object can not be grasped", "goal given up with the reason in the log; the robot stays"},
  FaultRow{490, "F-PLN-90", rt::Severity::kDegraded, ClearRule::kItself, "planning: task silent", "the last path stays; no new ones"},
  FaultRow{501, "F-RIO-01", rt::Severity::kCounted, ClearRule::kItself, "robot_io: a bus frame was lost", "last state kept"},
  FaultRow{502, "F-RIO-02", rt::Severity::kSafeStop, ClearRule::kOperator, "robot_io: bus down, or many frames lost in a row", "safe stop"},
  FaultRow{503, "F-RIO-03", rt::Severity::kDegraded, ClearRule::kItself, "robot_io: goal expired", "the base ramps down"},
  FaultRow{504, "F-RIO-04", rt::Severity::kCounted, ClearRule::kItself, "robot_io: goal not finite", "goal ignored"},
  FaultRow{505, "F-RIO-05", rt::Severity::kDegraded, ClearRule::kItself, "robot_io: link silent, or its connection ended", "the base ramps down"},
  FaultRow{506, "F-RIO-06", rt::Severity::kSafeStop, ClearRule::kOperator, "robot_io: a motor controller timed out", "safe stop; motors off until the operator clears"},
  FaultRow{507, "F-RIO-07", rt::Severity::kSafeStop, ClearRule::kOperator, "robot_io: encoder not finite, or a leap", "safe stop"},
  FaultRow{508, "F-RIO-08", rt::Severity::kCounted, ClearRule::kItself, "robot_io: the base does not follow", "the reference waits"},
  FaultRow{590, "F-RIO-90", rt::Severity::kSafeStop, ClearRule::kOperator, "robot_io: task silent", "safe stop; motors stopped by the watchdog"},
  FaultRow{690, "F-CAP-90", rt::Severity::kDegraded, ClearRule::kItself, "capture: task silent", "no new images; the map stays as it is"},
  FaultRow{701, "F-SUP-01", rt::Severity::kSafeStop, ClearRule::kOperator, "emergency stop pressed, broken or not sampled", "safe stop"},
  FaultRow{702, "F-SUP-02", rt::Severity::kRampDown, ClearRule::kItself, "link silent, or its connection ended", "ramp down; a new engage is needed"},
  FaultRow{703, "F-SUP-03", rt::Severity::kSafeStop, ClearRule::kRestart, "link refused: message schema or version differ", "safe stop; no motion until started again with equal builds"},
  FaultRow{704, "F-SUP-04", rt::Severity::kRampDown, ClearRule::kItself, "the robot's box did not follow into the engaged mode, or left it", "ramp down; a new engage is needed"},
  FaultRow{705, "F-SUP-05", rt::Severity::kSafeStop, ClearRule::kOperator, "the other box went into a safe stop", "safe stop; while it lasts no engage is followed"},
  FaultRow{706, "F-SUP-06", rt::Severity::kRampDown, ClearRule::kItself, "engage withdrawn by the operator's box", "ramp down"},
  FaultRow{707, "F-SUP-07", rt::Severity::kRampDown, ClearRule::kItself, "ramp down requested", "ramp down"},
  FaultRow{708, "F-SUP-08", rt::Severity::kSafeStop, ClearRule::kOperator, "stop requested", "safe stop"},
  FaultRow{709, "F-SUP-09", rt::Severity::kSafeStop, ClearRule::kRestart, "the executor's watchdog made an output safe", "safe stop"},
  FaultRow{710, "F-SUP-10", rt::Severity::kDegraded, ClearRule::kOperator, "a task reported a fault that is not in this table", "as severe as the task says, at least degraded"},
  FaultRow{711, "F-SUP-11", rt::Severity::kCounted, ClearRule::kItself, "engage asked for on a host that has no room for the engaged mode", "engage refused; the admission report has the figures"},
  FaultRow{1537, "F-CAP-01", rt::Severity::kCounted, ClearRule::kItself, "capture: not an image", "nothing sent"},
  FaultRow{1538, "F-CAP-02", rt::Severity::kCounted, ClearRule::kItself, "capture: colour left out", "depth sent alone"},
};
// clang-format on
inline constexpr std::size_t kFaultCount = kFaultTable.size();

enum Fault : rt::FaultId {
  kFaultEstop = 701,
  kFaultLinkSilent = 702,
  kFaultLinkRefused = 703,
  kFaultPeerNotEngaged = 704,
  kFaultPeerStopped = 705,
  kFaultEngageWithdrawn = 706,
  kFaultRampRequested = 707,
  kFaultStopRequested = 708,
  kFaultWatchdog = 709,
  kFaultUnknown = 710,
  kFaultNoRoom = 711,
};

// Row of an id, or -1.
[[nodiscard]] constexpr int fault_row(rt::FaultId id) noexcept {
  for (std::size_t i = 0; i < kFaultCount; ++i) {
    if (kFaultTable[i].id == id) return static_cast<int>(i);
  }
  return -1;
}

// The table of docs/faults.md, in its order.
static_assert([] {
  for (std::size_t i = 1; i < kFaultCount; ++i) {
    if (kFaultTable[i].id <= kFaultTable[i - 1].id) return false;
  }
  return true;
}());

}  // namespace tasks

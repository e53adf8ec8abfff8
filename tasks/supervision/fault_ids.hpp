// Every fault of the stack, as ordered data: id, severity, reaction, clear rule, advice.
// docs/faults.md is this table; a test compares them. The tasks name their own ids in their own
// headers, since no task includes another; a test compares those too. A number is only an identity.
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
  std::string_view advice;    // what the user can do
};

// clang-format off
inline constexpr std::array kFaultTable = {
  FaultRow{101, "F-HAP-01", rt::Severity::kDegraded, ClearRule::kItself,
           "haptic: a position or a force is not a finite number",
           "force zero; it fades in again with the next good sample",
           "if it repeats, check the device's cable with `teletact device`"},
  FaultRow{102, "F-HAP-02", rt::Severity::kDegraded, ClearRule::kItself,
           "haptic: no new surface patch from fusion within its liveness limit",
           "force ramps to zero; it returns with the next patch",
           "look in the report why fusion was late or stopped"},
  FaultRow{103, "F-HAP-03", rt::Severity::kCounted, ClearRule::kItself,
           "haptic: no sample from the device",
           "the last force is held for the device's liveness limit, then force zero",
           "check the device's cable and power with `teletact device`"},
  FaultRow{104, "F-HAP-04", rt::Severity::kCounted, ClearRule::kItself,
           "haptic: malformed patch or ray cast",
           "it is refused: the patches in use stay; without a ray cast no contact",
           "report it: the program wrote a message that it must not write"},
  FaultRow{105, "F-HAP-05", rt::Severity::kDegraded, ClearRule::kItself,
           "haptic: no new ray cast for force_shading within its liveness limit",
           "force ramps to zero; it returns with the next ray cast",
           "lower fusion.surface_periods, or give fusion workers or a coarser voxel"},
  FaultRow{190, "F-HAP-90", rt::Severity::kSafeStop, ClearRule::kOperator,
           "haptic: the task is silent",
           "safe stop; the watchdog makes the device safe",
           "read the black box with `teletact audit`, then clear"},
  FaultRow{201, "F-FUS-01", rt::Severity::kDegraded, ClearRule::kItself,
           "fusion: tracking of the camera is lost",
           "nothing is fused; the map stays as it is",
           "drive the camera back to a place that it has seen"},
  FaultRow{202, "F-FUS-02", rt::Severity::kCounted, ClearRule::kItself,
           "fusion: the image does not constrain every direction of the camera's motion",
           "the frame is not claimed and not fused",
           "none; if it lasts, turn the camera to a scene with more structure"},
  FaultRow{203, "F-FUS-03", rt::Severity::kDegraded, ClearRule::kRestart,
           "fusion: the map's memory is full",
           "blocks that do not fit are left out and counted",
           "raise fusion.tsdf.max_blocks, or choose a coarser voxel, and start again"},
  FaultRow{204, "F-FUS-04", rt::Severity::kCounted, ClearRule::kItself,
           "fusion: an image of another size, an empty one, or one that is not newer",
           "the image is refused",
           "check that camera and scene state the same image size"},
  FaultRow{205, "F-FUS-05", rt::Severity::kCounted, ClearRule::kItself,
           "fusion: the arm's joint angles are missing, or too old for the image",
           "the image is refused, since the robot's body in it can not be removed",
           "check the reports of the arm's joints; fusion.body.oldest_joints_ms is their limit"},
  FaultRow{290, "F-FUS-90", rt::Severity::kRampDown, ClearRule::kItself,
           "fusion: the task is silent",
           "ramp down; the force goes to zero with the patch",
           "look in the report why fusion stopped, then engage again"},
  FaultRow{301, "F-PRE-01", rt::Severity::kDegraded, ClearRule::kItself,
           "prediction: no robot state within its limits",
           "goals are not engaged: the robot stands",
           "check the link and the robot's box"},
  FaultRow{302, "F-PRE-02", rt::Severity::kCounted, ClearRule::kItself,
           "prediction: the robot state is not a finite number",
           "it is refused, and the last one ages",
           "check the robot's encoders and bus"},
  FaultRow{303, "F-PRE-03", rt::Severity::kCounted, ClearRule::kItself,
           "prediction: the path is not a finite number",
           "it is refused, and the old one is dropped",
           "draw the mark again; report it if it repeats"},
  FaultRow{304, "F-PRE-04", rt::Severity::kDegraded, ClearRule::kItself,
           "prediction: the link's round trip was not measured yet",
           "goals are not engaged: the robot stands",
           "wait; if it lasts, check the link"},
  FaultRow{305, "F-PRE-05", rt::Severity::kCounted, ClearRule::kItself,
           "prediction: the camera's pose is farther from the odometry than their errors allow",
           "this correction is refused",
           "none; if it lasts, look for slipping wheels, or a wrong camera mount"},
  FaultRow{306, "F-PRE-06", rt::Severity::kDegraded, ClearRule::kItself,
           "prediction: the base's place is not certain enough",
           "goals are not engaged: the robot stands until the camera confirms its place",
           "turn the camera to a place that it has seen"},
  FaultRow{390, "F-PRE-90", rt::Severity::kRampDown, ClearRule::kItself,
           "prediction: the task is silent",
           "ramp down; goals expire at the robot",
           "look in the report why the task stopped, then engage again"},
  FaultRow{401, "F-PLN-01", rt::Severity::kCounted, ClearRule::kItself,
           "planning: no path to the goal",
           "the goal is given up; the robot stays",
           "draw a mark that the base can reach"},
  FaultRow{402, "F-PLN-02", rt::Severity::kDegraded, ClearRule::kItself,
           "planning: the planning library threw an exception",
           "no path in this job; planning tries again, then gives the goal up",
           "draw the mark again; report it if it repeats"},
  FaultRow{403, "F-PLN-03", rt::Severity::kCounted, ClearRule::kItself,
           "planning: an input is not a finite number, or the ground is not level",
           "mark, robot pose or map is refused",
           "draw the mark again"},
  FaultRow{404, "F-PLN-04", rt::Severity::kCounted, ClearRule::kItself,
           "planning: touch events were lost",
           "an open mark is dropped",
           "draw the mark again"},
  FaultRow{405, "F-PLN-05", rt::Severity::kCounted, ClearRule::kItself,
           "planning: the job ran out of time",
           "the job is aborted and publishes nothing; the next one tries again",
           "none; if it repeats, give planning more CPU time"},
  FaultRow{406, "F-PLN-06", rt::Severity::kCounted, ClearRule::kItself,
           "planning: jobs for one mark ran out of time several times in a row",
           "the goal is given up; the robot stays",
           "draw a mark that is nearer; give planning more CPU time"},
  FaultRow{407, "F-PLN-07", rt::Severity::kCounted, ClearRule::kItself,
           "planning: the marked object can not be grasped",
           "the goal is given up; the robot stays",
           "read the reason in the log and mark another object"},
  FaultRow{490, "F-PLN-90", rt::Severity::kDegraded, ClearRule::kItself,
           "planning: the task is silent",
           "the last path stays; there are no new ones",
           "look in the report why the task stopped"},
  FaultRow{501, "F-RIO-01", rt::Severity::kCounted, ClearRule::kItself,
           "robot_io: a frame of the motor bus was lost",
           "the last state is kept",
           "none; if it repeats, check the bus cable"},
  FaultRow{502, "F-RIO-02", rt::Severity::kSafeStop, ClearRule::kOperator,
           "robot_io: the motor bus is down, or many frames in a row were lost",
           "safe stop",
           "check cable and power of the motor bus, then clear"},
  FaultRow{503, "F-RIO-03", rt::Severity::kDegraded, ClearRule::kItself,
           "robot_io: the goal expired",
           "the base ramps down",
           "check the link's delay; the base goes on with the next goal"},
  FaultRow{504, "F-RIO-04", rt::Severity::kCounted, ClearRule::kItself,
           "robot_io: the goal is not a finite number",
           "the goal is ignored",
           "report it: the program wrote a message that it must not write"},
  FaultRow{505, "F-RIO-05", rt::Severity::kDegraded, ClearRule::kItself,
           "robot_io: the link is silent, or its connection ended",
           "the base ramps down",
           "check the network and the operator's box"},
  FaultRow{506, "F-RIO-06", rt::Severity::kSafeStop, ClearRule::kOperator,
           "robot_io: a motor controller got no setpoint in time and stopped",
           "safe stop; the motors stay off until the operator clears",
           "check the bus cable and the load of the robot's box, then clear"},
  FaultRow{507, "F-RIO-07", rt::Severity::kSafeStop, ClearRule::kOperator,
           "robot_io: an encoder value is not a finite number, or it leapt",
           "safe stop",
           "check the encoder's cable, then clear; the pose is kept"},
  FaultRow{508, "F-RIO-08", rt::Severity::kCounted, ClearRule::kItself,
           "robot_io: the base lags behind its reference",
           "the reference waits for the base",
           "see whether a wheel is blocked or slips"},
  FaultRow{590, "F-RIO-90", rt::Severity::kSafeStop, ClearRule::kOperator,
           "robot_io: the task is silent",
           "safe stop; the watchdog stops the motors",
           "read the black box with `teletact audit`, then clear"},
  FaultRow{690, "F-CAP-90", rt::Severity::kDegraded, ClearRule::kItself,
           "capture: the task is silent",
           "there are no new images; the map stays as it is",
           "check the camera; look in the report why the task stopped"},
  FaultRow{701, "F-SUP-01", rt::Severity::kSafeStop, ClearRule::kOperator,
           "the emergency stop is pressed, broken or not sampled",
           "safe stop",
           "release the emergency stop or mend its cable, then clear"},
  FaultRow{702, "F-SUP-02", rt::Severity::kRampDown, ClearRule::kItself,
           "the link is silent, or its connection ended",
           "ramp down",
           "check the network and the other box, then engage again"},
  FaultRow{703, "F-SUP-03", rt::Severity::kSafeStop, ClearRule::kRestart,
           "the link is refused: the boxes have different message schemas or versions",
           "safe stop; no motion",
           "install the same build on both boxes and start again"},
  FaultRow{704, "F-SUP-04", rt::Severity::kRampDown, ClearRule::kItself,
           "the robot's box did not follow into the engaged mode, or left it",
           "ramp down",
           "look in the robot's log why, then engage again"},
  FaultRow{705, "F-SUP-05", rt::Severity::kSafeStop, ClearRule::kOperator,
           "the other box went into a safe stop",
           "safe stop; while it lasts no engage is followed",
           "remove the cause on the other box, then clear"},
  FaultRow{706, "F-SUP-06", rt::Severity::kRampDown, ClearRule::kItself,
           "the operator's box withdrew the engage",
           "ramp down",
           "engage again"},
  FaultRow{707, "F-SUP-07", rt::Severity::kRampDown, ClearRule::kItself,
           "a ramp down was requested",
           "ramp down",
           "engage again"},
  FaultRow{708, "F-SUP-08", rt::Severity::kSafeStop, ClearRule::kOperator,
           "a stop was requested",
           "safe stop",
           "clear, then engage"},
  FaultRow{709, "F-SUP-09", rt::Severity::kSafeStop, ClearRule::kRestart,
           "a job hung, and the executor's watchdog made its device safe",
           "safe stop",
           "read the black box with `teletact audit`, then start again"},
  FaultRow{710, "F-SUP-10", rt::Severity::kDegraded, ClearRule::kOperator,
           "a task reported a fault that is not in this table",
           "as severe as the task says, at least degraded",
           "report it: the fault table lacks a row; then clear"},
  FaultRow{711, "F-SUP-11", rt::Severity::kCounted, ClearRule::kItself,
           "engage was requested on a host that has no room for the engaged mode",
           "the engage is refused",
           "see the figures in the admission report; free a core or lower the load"},
  FaultRow{1537, "F-CAP-01", rt::Severity::kCounted, ClearRule::kItself,
           "capture: the frame is not a valid image",
           "nothing is sent",
           "if it repeats, check the camera's cable and its mode"},
  FaultRow{1538, "F-CAP-02", rt::Severity::kCounted, ClearRule::kItself,
           "capture: the colour image could not be encoded",
           "depth is sent alone",
           "none; if it repeats, lower capture.colour.quality"},
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

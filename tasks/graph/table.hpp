// The task table and the edge table of the whole stack: reading this file is the tour.
//
//     robot box                                      operator box
//     camera ─▶ capture ══frame══▶ fusion ──patch──▶ haptic ◀──▶ Omega
//                                    │ ▲───hand──────┘ │
//                                    │cost_map         │touch
//     bus ◀─▶ robot_io ◀══goal══ prediction ◀─path─ planning
//                 └═══robot_state══▶ prediction, planning, fusion, supervision
//     supervision (one on each box) ──mode──▶ every task of its box
//
// A process instantiates the rows of its box; an edge that crosses boxes (══) becomes a link
// endpoint at both ends. Tasks see channels only, never each other.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "rt/sched/task_spec.hpp"

namespace tasks {

// One row a line: this is a table.
// clang-format off
enum class TaskId : std::uint16_t {
  kHaptic, kFusion, kPrediction, kPlanning, kSupervision,   // operator box
  kRobotIo, kCapture, kRobotSupervision,                    // robot box
};
inline constexpr int kTaskCount = 8;
[[nodiscard]] constexpr std::size_t index_of(TaskId id) noexcept { return static_cast<std::size_t>(id); }

struct VariantRow {
  std::string_view name;
  std::int64_t budget_us;  // declared CPU; calibration replaces it
};

struct TaskRow {
  TaskId id;
  std::string_view name;
  rt::Box box;
  rt::TaskClass task_class;
  std::int64_t rate_hz;
  rt::MissPolicy policy;
  int miss_limit;                     // leaky bucket; above it the safe output is forced
  std::array<VariantRow, 4> variants; // level 0 first; an empty name ends the list
};

using enum rt::MissPolicy;
inline constexpr std::array<TaskRow, kTaskCount> kTaskTable{{
    {TaskId::kHaptic, "haptic", rt::Box::kOperator, rt::TaskClass::kHard, 1000, kSkip, 100,
     {{{"full", 100}}}},
    {TaskId::kFusion, "fusion", rt::Box::kOperator, rt::TaskClass::kHard, 30, kSkip, 0,
     {{{"full", 25000}, {"step2", 12000}, {"step4", 9000}}}},
    {TaskId::kPrediction, "prediction", rt::Box::kOperator, rt::TaskClass::kHard, 10, kSkip, 5,
     {{{"full", 2000}}}},
    {TaskId::kPlanning, "planning", rt::Box::kOperator, rt::TaskClass::kFirm, 10, kAbort, 0,
     {{{"full", 50000}, {"short", 20000}}}},
    {TaskId::kSupervision, "supervision", rt::Box::kOperator, rt::TaskClass::kHard, 100, kSkip, 0,
     {{{"full", 50}}}},
    {TaskId::kRobotIo, "robot_io", rt::Box::kRobot, rt::TaskClass::kHard, 1000, kSkip, 100,
     {{{"full", 100}}}},
    {TaskId::kCapture, "capture", rt::Box::kRobot, rt::TaskClass::kFirm, 30, kSkip, 0,
     {{{"colour", 15000}, {"depth", 6000}}}},
    {TaskId::kRobotSupervision, "robot_supervision", rt::Box::kRobot, rt::TaskClass::kHard, 100, kSkip, 0,
     {{{"full", 50}}}},
}};

enum class EdgeId : std::uint8_t {
  kFrame, kRobotState, kGoal,                                             // across the link
  kPatch, kView, kMesh, kCostMap, kCameraPose, kObjects, kHand, kTouch, kEdit, kPath, kTask, kMode, kOdometryFrame,  // operator box
  kRobotMode,                                                             // robot box
};
inline constexpr int kEdgeCount = 17;

enum class EdgeKind : std::uint8_t { kLatest, kRing, kRemote };

struct EdgeRow {
  EdgeId id;
  std::string_view name, from, to;
  EdgeKind kind;
  std::string_view beyond;  // what happens without it
};

inline constexpr std::array<EdgeRow, kEdgeCount> kEdgeTable{{
    {EdgeId::kFrame, "frame", "capture", "fusion", EdgeKind::kRemote, "map stays, tracking idles"},
    {EdgeId::kRobotState, "robot_state", "robot_io", "prediction planning fusion supervision", EdgeKind::kRemote, "ramp down"},
    {EdgeId::kGoal, "goal", "prediction", "robot_io robot_supervision", EdgeKind::kRemote, "robot ramps down"},
    {EdgeId::kPatch, "patch", "fusion", "haptic", EdgeKind::kLatest, "force ramps to zero"},
    {EdgeId::kView, "view", "fusion", "console", EdgeKind::kLatest, "shown"},
    {EdgeId::kMesh, "mesh", "fusion", "console", EdgeKind::kLatest, "not taken in time: all of it is sent again"},
    {EdgeId::kCostMap, "cost_map", "fusion", "planning", EdgeKind::kLatest, "no new path"},
    {EdgeId::kCameraPose, "camera_pose", "fusion", "prediction haptic console", EdgeKind::kLatest, "odometry alone"},
    {EdgeId::kObjects, "objects", "fusion", "planning console", EdgeKind::kLatest, "the goal stays where the mark was"},
    {EdgeId::kHand, "hand", "haptic", "fusion console", EdgeKind::kLatest, "window stays"},
    {EdgeId::kTouch, "touch", "haptic", "planning", EdgeKind::kRing, "full: newest dropped, gap flag; open mark dropped"},
    {EdgeId::kEdit, "edit", "console", "fusion", EdgeKind::kRing, "full: asked again at the next look"},
    {EdgeId::kPath, "path", "planning", "prediction console", EdgeKind::kLatest, "last path holds"},
    {EdgeId::kTask, "task", "planning", "console", EdgeKind::kLatest, "shown"},
    {EdgeId::kMode, "mode", "supervision", "haptic prediction planning", EdgeKind::kLatest, "not engaged"},
    {EdgeId::kOdometryFrame, "odometry_frame", "prediction", "planning console", EdgeKind::kLatest, "nothing is planned"},
    {EdgeId::kRobotMode, "robot_mode", "robot_supervision", "robot_io", EdgeKind::kLatest, "not engaged"},
}};

// How old an edge's value may be for one of its readers. A reader that is not here has no limit. The
// tasks' configurations take their defaults from these rows (limit_of), so what is written here is
// what is in force unless a scene says otherwise.
struct LimitRow {
  EdgeId edge;
  TaskId reader;
  int liveness_ms;          // since the writer last published, or the link was heard; 0 = no limit
  int data_age_ms;          // since the oldest sensor datum in it was taken, or the goal was made; 0 = no limit
  std::string_view key;     // of the scene, that overrides it
  std::string_view beyond;  // the reader's answer
};

inline constexpr std::array<LimitRow, 5> kLimitTable{{
    {EdgeId::kRobotState, TaskId::kPrediction, 0, 250, "prediction.state_liveness_ms", "goals are not engaged"},
    {EdgeId::kRobotState, TaskId::kSupervision, 180, 0, "supervision.link_liveness_s", "ramp down"},
    {EdgeId::kGoal, TaskId::kRobotIo, 90, 300, "robot_io.link_silence_ms, prediction.goal_valid_ms", "the base ramps down"},
    {EdgeId::kGoal, TaskId::kRobotSupervision, 180, 0, "supervision.link_liveness_s", "ramp down"},
    {EdgeId::kPatch, TaskId::kHaptic, 100, 0, "haptic.patch_liveness_s", "force ramps to zero"},
}};

// clang-format on

// Does not compile for a pair that has no row.
[[nodiscard]] consteval LimitRow limit_of(EdgeId edge, TaskId reader) {
  for (const LimitRow& row : kLimitTable) {
    if (row.edge == edge && row.reader == reader) return row;
  }
  throw "no such row in kLimitTable";
}

static_assert(limit_of(EdgeId::kRobotState, TaskId::kSupervision).liveness_ms ==
                  limit_of(EdgeId::kGoal, TaskId::kRobotSupervision).liveness_ms,
              "one key serves both boxes");

}  // namespace tasks

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

#include <algorithm>
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
// A reader of edges that is no task: an ordinary thread.
inline constexpr TaskId kConsole = static_cast<TaskId>(kTaskCount);

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
     {{{"full", 50000}, {"brief", 5000}}}},
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
  kPatch, kSurface, kView, kMesh, kCostMap, kCameraPose, kObjects, kHand, kTouch, kEdit, kPath, kTask, kMode, kOdometryFrame,  // operator box
  kRobotMode,                                                             // robot box
};
inline constexpr int kEdgeCount = 18;

enum class EdgeKind : std::uint8_t { kLatest, kRing, kRemote };

struct EdgeRow {
  EdgeId id;
  std::string_view name, from, to;
  EdgeKind kind;
  std::string_view beyond;  // what happens without it
};

inline constexpr std::array<EdgeRow, kEdgeCount> kEdgeTable{{
    {EdgeId::kFrame, "frame", "capture", "fusion", EdgeKind::kRemote, "map stays, tracking idles"},
    {EdgeId::kRobotState, "robot_state", "robot_io", "prediction planning fusion supervision console", EdgeKind::kRemote, "ramp down"},
    {EdgeId::kGoal, "goal", "prediction", "robot_io robot_supervision", EdgeKind::kRemote, "robot ramps down"},
    {EdgeId::kPatch, "patch", "fusion", "haptic", EdgeKind::kLatest, "force ramps to zero"},
    {EdgeId::kSurface, "surface", "fusion", "haptic", EdgeKind::kLatest, "of the method force_shading alone: no contact; force ramps to zero"},
    {EdgeId::kView, "view", "fusion", "console", EdgeKind::kLatest, "shown"},
    {EdgeId::kMesh, "mesh", "fusion", "console", EdgeKind::kLatest, "not taken in time: all of it is sent again"},
    {EdgeId::kCostMap, "cost_map", "fusion", "planning console", EdgeKind::kLatest, "no new path"},
    {EdgeId::kCameraPose, "camera_pose", "fusion", "prediction haptic console", EdgeKind::kLatest, "odometry alone"},
    {EdgeId::kObjects, "objects", "fusion", "planning console", EdgeKind::kLatest, "the goal stays where the mark was"},
    {EdgeId::kHand, "hand", "haptic", "fusion console", EdgeKind::kLatest, "window stays"},
    {EdgeId::kTouch, "touch", "haptic", "planning", EdgeKind::kRing, "full: newest dropped, gap flag; open mark dropped"},
    {EdgeId::kEdit, "edit", "console", "fusion", EdgeKind::kRing, "full: asked again at the next look"},
    {EdgeId::kPath, "path", "planning", "prediction console", EdgeKind::kLatest, "last path holds"},
    {EdgeId::kTask, "task", "planning", "console", EdgeKind::kLatest, "shown"},
    {EdgeId::kMode, "mode", "supervision", "haptic prediction planning console", EdgeKind::kLatest, "not engaged"},
    {EdgeId::kOdometryFrame, "odometry_frame", "prediction", "planning console", EdgeKind::kLatest, "nothing is planned"},
    {EdgeId::kRobotMode, "robot_mode", "robot_supervision", "robot_io console", EdgeKind::kLatest, "not engaged"},
}};

// How old an edge's value may be for each of its readers, judged at the latch by the reader's clock (limits.hpp).
//
//   liveness  since the writer last published: of an edge between boxes since it last arrived, of the goal since the
//             link was heard. Of what is published only when there is something to say (touch, edit, mesh): since its
//             writer was last known to live.
//   age       since the oldest sensor datum in it was taken, and how unsure that instant is. Of a fused value since its
//             newest claimed image; of a path since that of the map that last let it pass; of a goal or a mode since
//             it was made. kAgeless: a mark or an edit is as good as on the day it was made.
//   beyond    the reader's answer, to either
//
// A value that was never published is no matter of these rows: the reader waits for it. The tasks' configurations take
// their defaults from here, so what is written here is in force unless a scene says otherwise: by the named keys, where
// there are none by limits.<reader>.<edge>_liveness_ms and _age_ms.
//
// The ages across the link are set by the delay that is to be borne, 200 ms one way with 20 ms of jitter, for the
// uncertainty of an instant doubles it: a state is 400 + 40 + 10 (its rate) + 30 (an image before it) ms old, and a goal
// lives a round trip and 250 ms. How far the base drives on them is bounded by its speed, not by them: docs/prediction.md.
inline constexpr int kAgeless = 0;
struct LimitRow {
  EdgeId edge;
  TaskId reader;
  int liveness_ms;
  int data_age_ms;
  std::string_view beyond;
  std::string_view liveness_key = {}, age_key = {};
};

inline constexpr std::array<LimitRow, 34> kLimitTable{{
    {EdgeId::kFrame, TaskId::kFusion, 500, 1000, "silent: map stays, tracking idles; old: not looked at"},
    {EdgeId::kRobotState, TaskId::kPrediction, 180, 500, "goals are not engaged", "", "prediction.state_liveness_ms"},
    {EdgeId::kRobotState, TaskId::kPlanning, 250, 600, "nothing is planned; the path stands"},
    {EdgeId::kRobotState, TaskId::kFusion, 250, 600, "the camera is tracked without odometry"},
    {EdgeId::kRobotState, TaskId::kSupervision, 180, 700, "as a silent link: ramp down", "supervision.link_liveness_s"},
    {EdgeId::kRobotState, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kGoal, TaskId::kRobotIo, 90, 700, "the base ramps down", "robot_io.link_silence_ms", "prediction.goal_valid_ms"},
    {EdgeId::kGoal, TaskId::kRobotSupervision, 180, 800, "silent: ramp down; old: as an engage withdrawn", "supervision.link_liveness_s"},
    {EdgeId::kPatch, TaskId::kHaptic, 100, 1000, "silent: force ramps to zero; old: told, contact stays", "haptic.patch_liveness_s"},
    {EdgeId::kSurface, TaskId::kHaptic, 1000, 1500, "silent: force ramps to zero; old: told, contact stays"},
    {EdgeId::kView, kConsole, 2000, 2000, "named in the status line"},
    {EdgeId::kMesh, kConsole, 1000, 2000, "named in the status line"},
    {EdgeId::kCostMap, TaskId::kPlanning, 500, 1000, "no new path; the one under way stands, for its own age"},
    {EdgeId::kCostMap, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kCameraPose, TaskId::kPrediction, 500, 1000, "odometry alone"},
    {EdgeId::kCameraPose, TaskId::kHaptic, 500, 1000, "a held clutch does not turn the workspace"},
    {EdgeId::kCameraPose, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kObjects, TaskId::kPlanning, 1000, 1000, "the goal stays where it is"},
    {EdgeId::kObjects, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kHand, TaskId::kFusion, 50, 100, "the window stays"},
    {EdgeId::kHand, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kTouch, TaskId::kPlanning, 500, kAgeless, "an open mark is dropped"},
    {EdgeId::kEdit, TaskId::kFusion, 2000, kAgeless, "told; what was drawn stays"},
    {EdgeId::kPath, TaskId::kPrediction, 1000, 10000, "goals are not engaged"},
    {EdgeId::kPath, kConsole, 1000, 10000, "named in the status line"},
    {EdgeId::kTask, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kMode, TaskId::kHaptic, 50, 100, "limp: force ramps to zero"},
    {EdgeId::kMode, TaskId::kPrediction, 50, 100, "goals are not engaged"},
    {EdgeId::kMode, TaskId::kPlanning, 50, 100, "nothing is planned; the path stands"},
    {EdgeId::kMode, kConsole, 1000, 1000, "named in the status line"},
    {EdgeId::kOdometryFrame, TaskId::kPlanning, 500, 750, "nothing is planned; the path stands"},
    {EdgeId::kOdometryFrame, kConsole, 1000, 1500, "named in the status line"},
    {EdgeId::kRobotMode, TaskId::kRobotIo, 50, 100, "the base ramps down"},
    {EdgeId::kRobotMode, kConsole, 1000, 1000, "named in the status line"},
}};
inline constexpr int kLimitCount = static_cast<int>(kLimitTable.size());

// clang-format on

[[nodiscard]] constexpr std::string_view reader_name(TaskId id) noexcept {
  return id == kConsole ? std::string_view("console") : kTaskTable[index_of(id)].name;
}

// Of a pair in kLimitTable. Does not compile for one that has no row.
[[nodiscard]] consteval std::size_t limit_row(EdgeId edge, TaskId reader) {
  for (std::size_t i = 0; i < kLimitTable.size(); ++i) {
    if (kLimitTable[i].edge == edge && kLimitTable[i].reader == reader) return i;
  }
  throw "no such row in kLimitTable";
}
[[nodiscard]] consteval LimitRow limit_of(EdgeId edge, TaskId reader) {
  return kLimitTable[limit_row(edge, reader)];
}

// Each reader that an edge names has one row, with both limits.
static_assert([] {
  std::size_t pairs = 0;
  for (const EdgeRow& edge : kEdgeTable) {
    for (std::string_view rest = edge.to; !rest.empty();) {
      const std::string_view reader = rest.substr(0, rest.find(' '));
      rest.remove_prefix(std::min(rest.size(), reader.size() + 1));
      int rows = 0;
      for (const LimitRow& r : kLimitTable) {
        if (r.edge != edge.id || reader_name(r.reader) != reader) continue;
        ++rows;
        if (r.liveness_ms <= 0 || r.beyond.empty()) return false;
        if ((r.data_age_ms <= 0) != (edge.kind == EdgeKind::kRing)) return false;
      }
      if (rows != 1) return false;
      ++pairs;
    }
  }
  return pairs == kLimitTable.size();
}());

static_assert(limit_of(EdgeId::kRobotState, TaskId::kSupervision).liveness_ms ==
                  limit_of(EdgeId::kGoal, TaskId::kRobotSupervision).liveness_ms,
              "one key serves both boxes");

}  // namespace tasks

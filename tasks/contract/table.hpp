// The task table and the edge table of the whole stack. docs/tour.md follows data through it.
//
//     robot box                                      operator box
//     camera ─▶ capture ══frame══▶ fusion ──patch──▶ haptic ◀──▶ Omega
//                                    │ ▲───hand──────┘ │
//                                    │cost_map         │touch
//                                    └─────────────┐   │
//                                                  ▼   ▼
//     bus ◀─▶ robot_io ◀══goal══ prediction ◀─path─ planning
//                 └═══robot_state══▶ prediction, planning, fusion, supervision
//     supervision (one on each box) ──mode──▶ haptic, prediction, planning; robot_io
//
// Not drawn: goal goes to the robot's supervision too (engage, clear); camera_pose, surface,
// objects, odometry_frame; what the console shows (view, mesh, task) and asks for (edit, act,
// drive); what the link asks of capture (demand).
//
// A process instantiates the rows of its box; an edge that crosses boxes (══) becomes a link
// endpoint at both ends. Nodes (tasks/graph) see channels only; tasks see neither them nor each
// other.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "drivers/link/messages.hpp"
#include "rt/sched/task_spec.hpp"

// Message types of the rows. Those of the tasks: messages.hpp, scene_edit.hpp, operator_act.hpp.
namespace perception {
struct RgbdFrame;
struct SurfacePatch;
struct MeshDelta;
struct CostMap;
}  // namespace perception
namespace drivers {
struct EncodedFrame;
struct FrameDemand;
}  // namespace drivers

namespace tasks {

struct SurfacePoints;
struct SceneView;
struct CameraPose;
struct ObjectList;
struct HapticState;
struct TouchEvent;
struct SceneEdit;
struct OperatorAct;
struct DriveIntent;
struct Path;
struct TaskState;
struct ModeMsg;
struct OdometryFrame;

// One row a line: this is a table.
// clang-format off
// ---------------------------------------------------------------- tasks

enum class TaskId : std::uint16_t {
  kHaptic, kFusion, kPrediction, kPlanning, kSupervision,   // operator box
  kRobotIo, kCapture, kRobotSupervision,                    // robot box
};
inline constexpr int kTaskCount = 8;
[[nodiscard]] constexpr std::size_t index_of(TaskId id) noexcept { return static_cast<std::size_t>(id); }
// A reader of edges that is no task: an ordinary thread.
inline constexpr TaskId kConsole = static_cast<TaskId>(kTaskCount);
// A writer that is no task either: the robot box's end of the link.
inline constexpr TaskId kLink = static_cast<TaskId>(kTaskCount + 1);

struct VariantRow {
  std::string_view name;
  std::int64_t budget_us;  // declared CPU; calibration replaces it
};

// What the supervision of its box watches: a task that is silent for longer is a fault.
struct WatchRow {
  std::uint16_t fault = 0;  // 0: not watched
  int silence_ms = 0;
  // Index in supervision's rt::JobRecord::input_seq of the number of this task's newest health.
  int input = 0;
  int published = 0;  // place of that number in a recording of its own jobs
};

struct TaskRow {
  TaskId id;
  std::string_view name;
  rt::Box box;
  rt::TaskClass task_class;           // and policy: rt/sched/task_spec.hpp
  std::int64_t rate_hz;
  rt::MissPolicy policy;
  int miss_limit;                     // leaky bucket; above it the safe output is forced; 0: never
  std::array<VariantRow, 4> variants; // level 0 first; an empty name ends the list
  WatchRow watch = {};
  // Place in rt::JobRecord::input_seq of an input that is no Latest: a device's sample, a ring's event.
  int sensed = -1;
};

using enum rt::MissPolicy;
inline constexpr std::array<TaskRow, kTaskCount> kTaskTable{{
    {TaskId::kHaptic, "haptic", rt::Box::kOperator, rt::TaskClass::kHard, 1000, kSkip, 100,
     {{{"full", 100}}}, {190, 50, 0, 2}, 2},
    {TaskId::kFusion, "fusion", rt::Box::kOperator, rt::TaskClass::kHard, 30, kSkip, 0,
     {{{"full", 25000}, {"step2", 12000}, {"step4", 9000}}}, {290, 500, 1, 3}},
    {TaskId::kPrediction, "prediction", rt::Box::kOperator, rt::TaskClass::kHard, 10, kSkip, 5,
     {{{"full", 2000}}}, {390, 500, 2, 0}},
    {TaskId::kPlanning, "planning", rt::Box::kOperator, rt::TaskClass::kFirm, 10, kAbort, 0,
     {{{"full", 50000}, {"brief", 5000}}}, {490, 1000, 3, 1}, 3},
    {TaskId::kSupervision, "supervision", rt::Box::kOperator, rt::TaskClass::kHard, 100, kSkip, 0,
     {{{"full", 50}}}},
    {TaskId::kRobotIo, "robot_io", rt::Box::kRobot, rt::TaskClass::kHard, 1000, kSkip, 100,
     {{{"full", 100}}}, {590, 50, 0, 0}, 2},
    {TaskId::kCapture, "capture", rt::Box::kRobot, rt::TaskClass::kFirm, 30, kSkip, 0,
     {{{"colour", 15000}, {"depth", 6000}}}, {690, 1000, 1, 0}, 0},
    {TaskId::kRobotSupervision, "robot_supervision", rt::Box::kRobot, rt::TaskClass::kHard, 100, kSkip, 0,
     {{{"full", 50}}}},
}};

// ---------------------------------------------------------------- edges

enum class EdgeId : std::uint8_t {
  kFrame, kRobotState, kGoal,                                             // across the link
  kPatch, kSurface, kView, kMesh, kCostMap, kCameraPose, kObjects, kHand, kTouch, kEdit, kAct, kDrive, kPath, kTask, kMode, kOdometryFrame,  // operator box
  kRobotMode, kDemand,                                                    // robot box
};
inline constexpr int kEdgeCount = 21;
[[nodiscard]] constexpr std::size_t index_of(EdgeId id) noexcept { return static_cast<std::size_t>(id); }

enum class EdgeKind : std::uint8_t { kLatest, kRing, kRemote };

inline constexpr int kUnlisted = -1;

// Of an edge between the boxes: its code on the wire, how often it goes out, and whether it waits for a free line.
struct Wire {
  drivers::MessageId code{};
  int period_ms = 0;
  bool bulk = false;
};

struct EdgeRow {
  EdgeId id;
  std::string_view name;
  TaskId from;
  EdgeKind kind;
  std::string_view beyond;  // what happens without it
  // Index of this edge among its writer's publications in a recording; kUnlisted: not numbered
  // there.
  int published = kUnlisted;
  Wire wire = {};
  int room = 0;  // of a ring: how many elements it holds
};

// One reader of an edge, and how old a value it accepts. Judged at the latch by the reader's clock
// (tasks/graph/limits.hpp). Of patch at haptic and of goal at robot_io a crossing is only logged
// there; the tasks themselves judge those two.
//
//   input     place of the value's sequence number in rt::JobRecord::input_seq, and so in a run's
//             hash and in a recording. kUnlisted: the reader is an ordinary thread, or the edge a ring
//   liveness  time since the writer last published. Between boxes: since the last arrival; goal:
//             since the link was last heard. What is published only on an event (touch, edit,
//             act, mesh): since its writer was last known to live; touch: since its last event,
//             while a mark is open
//   age       time since the oldest sensor datum in the value was taken, plus the uncertainty of
//             that instant. Fused value: since its newest fused image. Path: since the newest
//             image of the map that last let it pass. Goal, mode: since it was made.
//             kAgeless: a mark or an edit does not age
//   beyond    what the reader does beyond either limit
//   holds     how many values the reader keeps at once
//   may_skip  a job may leave the value unread; it then notes number 0
//
// A value that was never published is beyond them: the reader waits for it. The tasks'
// configurations take their defaults from here. A scene may override them by the named keys, or
// where none is named by limits.<reader>.<edge>_liveness_ms and _age_ms.
//
// The ages across the link follow from the largest delay that is allowed: 200 ms one way with 20 ms
// of jitter. The uncertainty of an instant doubles it, so a state is up to 400 + 40 + 10 (its rate)
// + 30 ms old (a frame that is being sent goes first), and a goal lives a round trip and 250 ms.
// How far the base drives meanwhile is bounded by its speed, not by these ages:
// docs/prediction.md.
inline constexpr int kAgeless = 0;
struct Reader {
  TaskId reader;
  int input;
  int liveness_ms;
  int data_age_ms;
  std::string_view beyond;
  std::string_view liveness_key = {}, age_key = {};
  int holds = 1;
  bool may_skip = false;
};

// A row with its types: the message that readers get, and the one that the writer sends where the
// two boxes differ.
template <class M, class Sent, std::size_t N>
struct Edge {
  using Message = M;
  using SentMessage = Sent;
  EdgeRow row;
  std::array<Reader, N> readers;
};
template <class M, class Sent = M, class... R>
[[nodiscard]] constexpr Edge<M, Sent, sizeof...(R)> make_edge(const EdgeRow& row, const R&... readers) {
  return {row, {readers...}};
}

inline constexpr std::string_view kNamed = "named in the status line";
// In a namespace of its own, for the short names of its rows.
namespace edge_rows {
using enum EdgeId; using enum EdgeKind; using drivers::MessageId;
inline constexpr std::tuple kEdges{
    make_edge<perception::RgbdFrame, drivers::EncodedFrame>(
        {kFrame, "frame", TaskId::kCapture, kRemote, "map stays, tracking idles", 0, {MessageId::kFrame, 30, true}},
        Reader{TaskId::kFusion, 0, 500, 1000, "silent: map stays, tracking idles; old: ignored"},
        Reader{kConsole, kUnlisted, 1000, 2000, kNamed}),
    make_edge<drivers::RobotState>(
        {kRobotState, "robot_state", TaskId::kRobotIo, kRemote, "ramp down", 1, {MessageId::kRobotState, 10}},
        Reader{TaskId::kPrediction, 0, 180, 500, "goals are not engaged", "", "prediction.state_liveness_ms"},
        Reader{TaskId::kPlanning, 1, 250, 600, "no planning; the path stays"},
        Reader{TaskId::kFusion, 2, 250, 600, "the camera is tracked without odometry"},
        Reader{TaskId::kSupervision, 4, 180, 700, "treated as a silent link: ramp down", "supervision.link_liveness_s"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<drivers::RobotGoal>(
        {kGoal, "goal", TaskId::kPrediction, kRemote, "robot ramps down", 2, {MessageId::kRobotGoal, 50}},
        Reader{TaskId::kRobotIo, 0, 90, 700, "the base ramps down", "robot_io.link_silence_ms", "prediction.goal_valid_ms"},
        Reader{TaskId::kRobotSupervision, 2, 180, 800, "silent: ramp down; old: treated as a withdrawn engage", "supervision.link_liveness_s"}),
    make_edge<perception::SurfacePatch>(
        {kPatch, "patch", TaskId::kFusion, kLatest, "force ramps to zero", 0},
        Reader{TaskId::kHaptic, 0, 100, 1000, "silent: force ramps to zero; old: logged, contact stays", "haptic.patch_liveness_s", "", 2, true}),
    make_edge<SurfacePoints>(
        {kSurface, "surface", TaskId::kFusion, kLatest, "force_shading only: no contact, force ramps to zero", 5},
        Reader{TaskId::kHaptic, 4, 1000, 1500, "silent: force ramps to zero; old: logged, contact stays"}),
    make_edge<SceneView>(
        {kView, "view", TaskId::kFusion, kLatest, "the last picture stays"},
        Reader{kConsole, kUnlisted, 2000, 2000, kNamed}),
    make_edge<perception::MeshDelta>(
        {kMesh, "mesh", TaskId::kFusion, kLatest, "if not taken in time: the whole mesh again"},
        Reader{kConsole, kUnlisted, 1000, 2000, kNamed}),
    make_edge<perception::CostMap>(
        {kCostMap, "cost_map", TaskId::kFusion, kLatest, "no new path", 1},
        Reader{TaskId::kPlanning, 0, 500, 1000, "no new path; the present one stays, up to its own age limit"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<CameraPose>(
        {kCameraPose, "camera_pose", TaskId::kFusion, kLatest, "odometry alone", 2},
        Reader{TaskId::kPrediction, 2, 500, 1000, "odometry alone"},
        Reader{TaskId::kHaptic, 3, 500, 1000, "a held clutch does not turn the workspace"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<ObjectList>(
        {kObjects, "objects", TaskId::kFusion, kLatest, "the goal stays where the mark was", 4},
        Reader{TaskId::kPlanning, 4, 1000, 1000, "the goal stays where it is"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<HapticState>(
        {kHand, "hand", TaskId::kHaptic, kLatest, "the patch stays where it is", 0},
        Reader{TaskId::kFusion, 1, 50, 100, "the patch stays where it is"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<TouchEvent>(
        {kTouch, "touch", TaskId::kHaptic, kRing, "when full: newest dropped, gap flag, open mark dropped", 1, {}, 256},
        Reader{TaskId::kPlanning, kUnlisted, 500, kAgeless, "an open mark is dropped"}),
    make_edge<SceneEdit>(
        {kEdit, "edit", kConsole, kRing, "when full, the console tries again", kUnlisted, {}, 32},
        Reader{TaskId::kFusion, kUnlisted, 2000, kAgeless, "logged; areas drawn before stay"}),
    make_edge<OperatorAct>(
        {kAct, "act", kConsole, kRing, "when full, the console tries again", kUnlisted, {}, 32},
        Reader{TaskId::kPlanning, kUnlisted, 2000, kAgeless, "logged; the goal stays"}),
    make_edge<DriveIntent>(
        {kDrive, "drive", kConsole, kLatest, "nobody drives by hand", kUnlisted},
        Reader{TaskId::kPrediction, 4, 200, 200, "not driven by hand until a new press; without a path the base halts"}),
    make_edge<Path>(
        {kPath, "path", TaskId::kPlanning, kLatest, "last path holds", 0},
        Reader{TaskId::kPrediction, 1, 1000, 10000, "goals are not engaged"},
        Reader{kConsole, kUnlisted, 1000, 10000, kNamed}),
    make_edge<TaskState>(
        {kTask, "task", TaskId::kPlanning, kLatest, "the last phase stays on show"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<ModeMsg>(
        {kMode, "mode", TaskId::kSupervision, kLatest, "not engaged", 0},
        Reader{TaskId::kHaptic, 1, 50, 100, "limp: force ramps to zero"},
        Reader{TaskId::kPrediction, 3, 50, 100, "goals are not engaged"},
        Reader{TaskId::kPlanning, 2, 50, 100, "no planning; the path stays"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<OdometryFrame>(
        {kOdometryFrame, "odometry_frame", TaskId::kPrediction, kLatest, "no planning", 1},
        Reader{TaskId::kPlanning, 5, 500, 750, "no planning; the path stays"},
        Reader{kConsole, kUnlisted, 1000, 1500, kNamed}),
    make_edge<ModeMsg>(
        {kRobotMode, "robot_mode", TaskId::kRobotSupervision, kLatest, "not engaged", 0},
        Reader{TaskId::kRobotIo, 1, 50, 100, "the base ramps down"},
        Reader{kConsole, kUnlisted, 1000, 1000, kNamed}),
    make_edge<drivers::FrameDemand>(
        {kDemand, "demand", kLink, kLatest, "with codecs on demand: no frame is coded"},
        Reader{TaskId::kCapture, 1, 500, 500, "no frame is coded"})};
}  // namespace edge_rows
using edge_rows::kEdges;
// clang-format on

// ---------------------------------------------------------------- what follows from the rows

[[nodiscard]] constexpr std::string_view reader_name(TaskId id) noexcept {
  if (id == kLink) return "link";
  return id == kConsole ? std::string_view("console") : kTaskTable[index_of(id)].name;
}

template <EdgeId E>
inline constexpr const auto& kEdge = std::get<index_of(E)>(kEdges);
template <EdgeId E>
using MessageOf = typename std::remove_cvref_t<decltype(kEdge<E>)>::Message;
template <EdgeId E>
using SentMessageOf = typename std::remove_cvref_t<decltype(kEdge<E>)>::SentMessage;

// f(edge) for each row, in order.
template <class F>
constexpr void for_each_edge(F&& f) {
  std::apply([&](const auto&... edges) { (f(edges), ...); }, kEdges);
}

inline constexpr std::array<EdgeRow, kEdgeCount> kEdgeTable =
    std::apply([](const auto&... e) { return std::array<EdgeRow, kEdgeCount>{e.row...}; }, kEdges);

// One row a reader, in the order of the edges.
struct LimitRow : Reader {
  EdgeId edge;
};
inline constexpr int kLimitCount =
    std::apply([](const auto&... e) { return static_cast<int>((e.readers.size() + ...)); }, kEdges);
inline constexpr std::array<LimitRow, kLimitCount> kLimitTable = [] {
  std::array<LimitRow, kLimitCount> rows{};
  std::size_t at = 0;
  for_each_edge([&](const auto& e) {
    for (const Reader& r : e.readers) rows[at++] = {r, e.row.id};
  });
  return rows;
}();

[[nodiscard]] constexpr bool names_reader(EdgeId edge, TaskId reader) {
  return std::any_of(kLimitTable.begin(), kLimitTable.end(),
                     [=](const LimitRow& r) { return r.edge == edge && r.reader == reader; });
}
// Place in kLimitTable of an edge and its reader, for constants. A reader that the edge does not
// name does not compile. For templates: clang 14 refuses a consteval function of their arguments.
[[nodiscard]] constexpr std::size_t find_limit_row(EdgeId edge, TaskId reader) {
  for (std::size_t i = 0; i < kLimitTable.size(); ++i) {
    if (kLimitTable[i].edge == edge && kLimitTable[i].reader == reader) return i;
  }
  throw "the edge's row in kEdges names no such reader";
}
// The same anywhere else.
[[nodiscard]] consteval std::size_t limit_row(EdgeId edge, TaskId reader) {
  return find_limit_row(edge, reader);
}
[[nodiscard]] consteval LimitRow limit_of(EdgeId edge, TaskId reader) {
  return kLimitTable[limit_row(edge, reader)];
}
// Place of a reader among those of its edge; for constants, too.
[[nodiscard]] constexpr int reader_slot(EdgeId edge, TaskId reader) {
  std::size_t first = 0;
  while (kLimitTable[first].edge != edge) ++first;
  return static_cast<int>(find_limit_row(edge, reader) - first);
}
// Its values are no task's: a recording keeps what a latch took of it.
[[nodiscard]] constexpr bool fed_from_outside(const EdgeRow& row) noexcept {
  return row.from == kConsole || row.from == kLink;
}
[[nodiscard]] consteval std::size_t sensed_input(TaskId id) {
  const int place = kTaskTable[index_of(id)].sensed;
  return place >= 0 ? static_cast<std::size_t>(place) : throw "its row says that it senses nothing";
}
[[nodiscard]] constexpr rt::Box box_of(TaskId id) noexcept {
  if (id == kLink) return rt::Box::kRobot;
  return id == kConsole ? rt::Box::kOperator : kTaskTable[index_of(id)].box;
}

static_assert(
    [] {
      std::size_t at = 0;
      bool good = true;
      for_each_edge([&](const auto& e) { good = good && index_of(e.row.id) == at++; });
      return good && at == kEdgeCount;
    }(),
    "kEdges is in the order of EdgeId");

static_assert(
    [] {
      for (const LimitRow& r : kLimitTable) {
        const EdgeRow& edge = kEdgeTable[index_of(r.edge)];
        if ((edge.room > 0) != (edge.kind == EdgeKind::kRing)) return false;
        if (r.liveness_ms <= 0 || r.beyond.empty()) return false;
        if ((r.data_age_ms <= 0) != (edge.kind == EdgeKind::kRing)) return false;
        // Each number has one place, and what a task reads of a Latest is noted.
        if (r.reader != kConsole && r.input >= 0 &&
            r.input == kTaskTable[index_of(r.reader)].sensed)
          return false;
        if ((r.input == kUnlisted) != (r.reader == kConsole || edge.kind == EdgeKind::kRing))
          return false;
        if (r.reader != kConsole && !fed_from_outside(edge) && edge.published == kUnlisted)
          return false;
        for (const LimitRow& other : kLimitTable) {
          if (&other == &r) continue;
          if (other.edge == r.edge && other.reader == r.reader) return false;
          if (other.reader == r.reader && other.input == r.input && r.input != kUnlisted)
            return false;
        }
      }
      return true;
    }(),
    "each reader has one row with both limits, and a place of its own");

static_assert(limit_of(EdgeId::kRobotState, TaskId::kSupervision).liveness_ms ==
                  limit_of(EdgeId::kGoal, TaskId::kRobotSupervision).liveness_ms,
              "one key serves both boxes");

}  // namespace tasks

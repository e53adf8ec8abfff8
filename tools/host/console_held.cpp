// Of the operator's console: its status line, why the base stands, the mesh that it is told of.
#include <algorithm>
#include <cstdio>

#include "tasks/fusion/fusion_io.hpp"
#include "tasks/robot_io/robot_io_task.hpp"
#include "tools/host/console.hpp"
#include "tools/pictures/picture_words.hpp"
#include "tools/record/box_recorder.hpp"

namespace teletact {

std::string held_text(tasks::Held held, std::int32_t measured_ms, std::int32_t limit_ms) {
  using tasks::Held;
  char text[120] = "";
  switch (held) {
    case Held::kNo:
      break;
    case Held::kStateOld:
      std::snprintf(text, sizeof text, "robot state %d ms old, limit %d ms", measured_ms, limit_ms);
      break;
    case Held::kStateSilent:
      std::snprintf(text, sizeof text, "no robot state arrives, the newest is %d ms old",
                    measured_ms);
      break;
    case Held::kSettling:
      return "waits a moment after robot states that were too old or missing";
    case Held::kDelayUnknown:
      return "the link's round trip is not measured yet";
    case Held::kPlaceUnsure:
      return "its place is not certain enough: turn the camera to a place that it has seen";
    case Held::kModeSilent:
      return "supervision sends no mode";
    case Held::kPathOld:
      return "the path is too old, or planning is silent";
  }
  return text;
}

namespace {

const char* failure_text(tasks::TaskState::Failure why) {
  using Failure = tasks::TaskState::Failure;
  switch (why) {
    case Failure::kNo:
      break;
    case Failure::kNoMap:
      return "there was no map of the floor, or nothing was heard of the robot";
    case Failure::kStart:
      return "from where it stands the base may not set off: what is about it is too near, or was "
             "not seen";
    case Failure::kNoWay:
      return "no floor that was seen leads there";
    case Failure::kNoTime:
      return "no way was found in the time there is";
    case Failure::kNoGrasp:
      return "the arm can not take it: too wide, too thin or out of reach";
  }
  return "";
}

}  // namespace

std::string goal_text(const tasks::TaskState& task) {
  using Phase = tasks::TaskState::Phase;
  if (task.phase == Phase::kFailed) return failure_text(task.failure);
  // What is marked on an object can not be stood on: how far off the base is belongs to the word.
  constexpr double kWorthAWord_m = 0.1;
  const bool stands = task.phase == Phase::kArrived || task.phase == Phase::kShort;
  if ((!stands && task.phase != Phase::kDriving) || task.off_m < kWorthAWord_m) return {};
  char text[120];
  const char* format = !task.is_short ? "%.2f m from what was marked"
                       : stands       ? "%.2f m short of the goal: no nearer place can be driven to"
                                      : "this way ends %.2f m short of the goal";
  std::snprintf(text, sizeof text, format, task.off_m);
  return text;
}

// A job of prediction is a tenth of a second; where the console saw none, the next one counts for
// it. Settling keeps the reason that it comes from.
void OperatorConsole::mind_held(const tasks::OdometryFrame& newest) {
  using tasks::Held;
  using Phase = tasks::TaskState::Phase;
  const Phase phase = seen_.task.phase;
  if ((phase != Phase::kDriving && phase != Phase::kPlanning) || seen_.engages == 0 ||
      newest.held == Held::kNo || newest.held == Held::kPlaceUnsure)
    return;
  if (seen_.world.seq != 0) seen_.held_s += 0.1 * static_cast<double>(newest.seq - seen_.world.seq);
  if (newest.held == Held::kSettling && seen_.held != Held::kNo) return;
  seen_.held = newest.held;
  seen_.held_ms = newest.held_ms;
  seen_.held_limit_ms = newest.held_limit_ms;
}

// For the status line: that the robot's box alone is in a safe stop; once somebody has engaged, why
// the base may not be driven, or that goals reach the robot too late.
std::string OperatorConsole::stands() const {
  using tasks::Held;
  if (static_cast<tasks::Mode>(seen_.robot.mode) == tasks::Mode::kSafeStop &&
      seen_.mode.mode != tasks::Mode::kSafeStop)
    return "  ROBOT IN A SAFE STOP: " + fault_text(seen_.robot.mode_cause);
  if (seen_.engages == 0) return {};
  const auto& w = seen_.world;
  if (w.held == Held::kPlaceUnsure) return {};  // stands beside the stated error
  if (w.held != Held::kNo) return "  STANDS: " + held_text(w.held, w.held_ms, w.held_limit_ms);
  using namespace tasks::robot_io_fault;
  if (seen_.robot.fault == kGoalExpired || seen_.robot.fault == kLinkSilent)
    return "  STANDS: " + fault_text(seen_.robot.fault);
  return {};
}

std::string OperatorConsole::status_line(rt::Time now) const {
  const char* modes[] = {"init", "hold", "engaged", "ramp down", "safe stop"};
  const char* phases[] = {"idle", "planning", "driving", "arrived", "failed", "short"};
  const float force = seen_.haptic.empty() ? 0.0F : seen_.haptic.back().force_N;
  const float reach = seen_.haptic.empty() ? 0.0F : seen_.haptic.back().reach;
  const auto tracked = std::count_if(seen_.fusion.begin(), seen_.fusion.end(),
                                     [](const auto& f) { return f.tracked; });
  char moving[60] = "";
  if (const auto& map = *seen_.map; map.moving_count > 0)
    std::snprintf(moving, sizeof moving, "  MOVES: %.2f m2 of the ground",
                  map.moving_count * map.resolution * map.resolution);
  std::string old;
  const std::string why = stands();
  std::string goal = goal_text(seen_.task);
  if (!goal.empty()) goal = " (" + goal + ")";
  for (const auto edge : seen_.beyond) old += (old.empty() ? "  OLD: " : ", ") + std::string(edge);
  const auto X_WB =
      perception::compose({seen_.world.X_WO[0], seen_.world.X_WO[1], seen_.world.X_WO[2]},
                          {seen_.robot.x_m, seen_.robot.y_m, seen_.robot.yaw_rad});
  char sure[60] = "";
  if (seen_.world.follows_camera && seen_.world.known)
    std::snprintf(sure, sizeof sure, " +- %.3f m%s", seen_.world.error_m,
                  seen_.world.unsure ? "  STANDS: where it is, is not sure enough" : "");
  else if (seen_.world.follows_camera)
    std::snprintf(sure, sizeof sure, "  where it is, is not known yet");
  const auto& link = box_.graph().link();
  std::optional<rt::Nanos> age;
  if (const auto seen_ns = link.picture_ns.load(); seen_ns != 0)
    age = rt::Nanos{rt::ns_of(now) - seen_ns};
  const std::string spared = spared_text(link.spared());
  const std::string picture =
      "  picture " + age_text(age) + (spared.empty() ? "" : "  LOWERED: " + spared);
  char line[960];
  std::snprintf(line, sizeof line,
                "%5.1f s  %-9s  force %5.2f N  reach %3.0f %%  frames %4ld  marks %u  paths %u  "
                "%-8s%s  robot (%.2f, %.2f) m%s%s%s%s%s%s",
                rt::seconds(now - epoch_), modes[static_cast<int>(seen_.mode.mode)],
                static_cast<double>(force), 100 * static_cast<double>(reach),
                static_cast<long>(tracked), seen_.task.marks, seen_.task.paths,
                phases[static_cast<int>(seen_.task.phase)], goal.c_str(), X_WB.x, X_WB.y, sure,
                why.c_str(), moving,
                force_act_.waits() ? "  forces off: press the clutch and let go" : "", old.c_str(),
                picture.c_str());
  return line;
}

void OperatorConsole::glance(rt::Time now) {
  box_.graph().requests().console_ns.store(rt::ns_of(now));
  take_mesh(now, Judges::kNo);
}

// No mesh is sent while nothing changes: that fusion is alive is known from its samples. The age of
// a mesh is its age when it arrives.
void OperatorConsole::take_mesh(rt::Time now, Judges judges) {
  auto& cells = box_.graph().cells();
  if (!cells.has<tasks::EdgeId::kMesh>()) return;
  auto& taken = box_.graph().requests().mesh_taken;
  const MeshWanted wanted = mesh_taker_.wants ? mesh_taker_.wants() : MeshWanted::kDeltas;
  if (wanted == MeshWanted::kNone) return taken.store(tasks::kMeshUnwanted);
  const auto delta = cells.read<tasks::EdgeId::kMesh, tasks::kConsole>();
  if (!delta) {
    // Nobody has wanted any so far: fusion makes the first one once it hears that somebody does.
    if (edits_scene_ && taken.load() == tasks::kMeshUnwanted) taken.store(0);
    return;
  }
  if (delta->seq != mesh_.seq()) mesh_lag_ = now - delta->exposure;
  for (auto& w : watches_) {
    if (judges == Judges::kNo) break;
    if (w.row().edge == tasks::EdgeId::kMesh && !w.within(now, fusion_heard_, now - mesh_lag_))
      seen_.beyond.push_back("mesh");
  }
  // To who has nothing no delta counts but one that begins anew, which comes when none is taken.
  const bool counts = wanted != MeshWanted::kWhole || delta->restart;
  if (!counts && edits_scene_) taken.store(0);
  if (!counts || (delta->seq == mesh_.seq() && wanted == MeshWanted::kDeltas)) return;
  if (delta->seq != mesh_.seq() && !mesh_.take(*delta)) return;
  if (mesh_taker_.take) mesh_taker_.take(*delta);
  if (edits_scene_) taken.store(delta->seq);
}

}  // namespace teletact

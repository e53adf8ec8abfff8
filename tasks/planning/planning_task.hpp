// From a mark on the scene to a path on the ground, 10 Hz.
//
//   reads   Ring<TouchEvent>     from tasks/haptic         up to 64 a job; a gap drops an open mark
//           Ring<OperatorAct>    from the console          one a job: go there, mark, drop it
//           Latest<CostMap>      from tasks/fusion         held for one job
//           Latest<ObjectList>   from tasks/fusion         the object that the mark named, if it did
//           Latest<RobotState>   over the link             newest; its pose in W by X_WO. Without
//                                                          either there is no planning
//           Latest<ModeMsg>      from tasks/supervision    a stop drops mark and path
//   writes  Latest<Path>         to tasks/prediction       every job; the same path while it holds
//           Latest<TaskState>    to the console            every job
//   budget  50 ms of the 100 ms period; firm: OMPL allocates, our own code does not
//   policy  abort: an aborted job leaves the task as it was (abandon()), with the same events
//           unread. After `aborts` aborted plans in a row for one mark the goal is given up.
//
// A mark runs from MarkBegin to MarkEnd; the marked point is the drawn point nearest to the
// stroke's mean. The goal is the nearest driveable, reachable cell to its foot on the ground, on
// the side that the marked surface faces, heading towards the mark. A path is planned again when
// the map no longer lets it pass, or when the robot has left it.
//
// Where the base ends too far from what was asked for, that is no arrival: it looks for a nearer
// place for look_jobs jobs, since it sees more from there, goes on if there is one, and else says
// kShort and how far off it is.
//
// Moving things: if one blocks the only way, the goal waits for it to leave. If one stands at the
// goal's own place, the robot goes to the next best place, and on to the goal once it is free.
// Objects: if the mark named an object, the goal follows the object until the robot has arrived.
// With object_goal = "grasp" the goal is a place from which the arm can take the object
// (grasp.hpp); if there is none, the goal is given up with the reason.
//
// Frames: W world (= map), M grid of the cost map, B base.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "config/schema.hpp"
#include "drivers/link/messages.hpp"
#include "perception/ground/cost_map.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/contract/object_list.hpp"
#include "tasks/contract/operator_act.hpp"
#include "tasks/planning/grasp.hpp"
#include "tasks/planning/planner.hpp"

namespace tasks {

// Section [planning].
struct PlanningConfig {
  PlannerConfig planner;
  GraspConfig grasp;
  std::string object_goal = "approach";  // or "grasp": what a mark on an object asks for
  double goal_radius_m = 1.2;            // largest distance from the mark's foot to the goal
  double start_radius_m = 0.8;           // unseen floor the base may cross to reach the seen one
  double spacing_m = 0.04;               // of the published points
  double turn_rad_per_m = 3.0;           // heading change along the path
  double arrive_m = 0.05;                // distance to the last point that counts as arrived
  double arrive_speed_m_per_s = 0.03;
  // A path that replaces another one begins where the robot can still turn off: beyond the distance
  // that it drives until it gets the new path (twice the age of its state, plus this time for the
  // jobs between) and while it brakes.
  double switch_s = 0.2;
  double brake_m_per_s2 = 0.6;
  double leave_m = 0.4;           // farther from the path than this: plan again
  double reached_m = 0.1;         // of a goal on the floor: a path that ends nearer reaches it
  double reached_object_m = 0.8;  // of a mark above the floor, whose foot no base can stand on
  double go_on_m = 0.15;          // so much nearer to the goal: worth going on to
  int look_jobs = 20;             // jobs that it looks for such a place
  double object_moved_m = 0.15;   // way of the marked object after which the goal follows it
  int attempts = 3;               // jobs a goal may spend its iterations in vain
  int wait_jobs = 50;             // jobs a mark waits for a map and a robot
  int moving_jobs = 300;          // jobs a goal waits for what moves to leave its way
  int aborts = 20;                // jobs in a row that may run out of time planning for one mark
  double robot_radius_m = 0.35;   // no key: that of the ground map, [fusion.ground]

  void describe(config::Section& s);
};

// Fault ids of this task (docs/faults.md).
inline constexpr rt::FaultId kFaultPlanningNoPath = 401;    // goal given up: unreachable or budget
inline constexpr rt::FaultId kFaultPlanningLibrary = 402;   // the planning library threw
inline constexpr rt::FaultId kFaultPlanningBadInput = 403;  // not finite, or ground not level in W
inline constexpr rt::FaultId kFaultPlanningEventsLost = 404;  // gap: an open mark was dropped
inline constexpr rt::FaultId kFaultPlanningCancelled = 405;   // no time left; nothing committed
inline constexpr rt::FaultId kFaultPlanningNoTime = 406;      // ... too often: goal given up
inline constexpr rt::FaultId kFaultPlanningNoGrasp = 407;     // the marked object can not be taken

class PlanningTask {
 public:
  static constexpr int kMaxEvents = 64;
  enum Flags : std::uint32_t {
    kNewPath = 1U << 0U,      // this job made the path it publishes
    kReplanned = 1U << 1U,    // ... because the old one did not hold
    kGapDropped = 1U << 2U,   // an open mark was dropped after a gap
    kMarkTaken = 1U << 3U,    // a mark was completed
    kEscape = 1U << 4U,       // the path begins with a leg over unseen floor
    kTruncated = 1U << 5U,    // longer than a Path holds; its rest comes when the robot is near
    kPathDropped = 1U << 6U,  // a path was withdrawn
    kFromGrid = 1U << 7U,     // the search spent its iterations; the path is the grid's chain
    kGivenUp = 1U << 8U,      // a goal was dropped without a path
    kObjectMoved = 1U << 9U,  // the goal went after the object that the mark named
    kWaits = 1U << 11U,       // no way while something moves in it: the goal waits
    kGrasp = 1U << 10U,       // a grasp was looked for: Out::grasp says which, or why there is none
    kGoesOn = 1U << 12U,      // from a place short of the goal to a nearer one
  };

  struct In {  // latched at dispatch
    std::array<TouchEvent, kMaxEvents> events{};
    int event_count = 0;
    std::optional<OperatorAct> act;              // beside the hand's; after them
    const perception::CostMap* map = nullptr;    // null: never published
    const drivers::RobotState* robot = nullptr;  // its pose in W; null: none
    const ObjectList* objects = nullptr;         // null: none, or objects are switched off
    ModeMsg mode;                                // seq 0: none yet
    bool may_plan = true;    // false: map or mode are silent or old; the present path stays
    bool touch_live = true;  // false: a mark is open and its events have stopped
  };
  struct Out {  // committed at completion
    Path path;
    TaskState state;
    std::uint32_t flags = 0;
    PlanStatus status = PlanStatus::kFound;  // of the last plan of this job
    std::uint32_t work = 0;                  // planner iterations: deterministic
    Grasp grasp;                             // of the goal, while it is one
  };

  // Throws std::logic_error on a bad schema default only. Allocates everything of ours.
  PlanningTask(rt::NonRealtime&, const PlanningConfig&, std::uint64_t seed);

  // One cycle. Never throws; what OMPL throws is caught and becomes a fault.
  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;
  // A mark has begun and not ended.
  [[nodiscard]] bool mark_open() const noexcept { return state_.mark.open; }
  // The job was aborted: back to the state before its step(). Only the count of such jobs stays.
  void abandon() noexcept {
    state_ = before_;
    if (tried_) ++aborted_;
    tried_ = false;
  }

 private:
  static constexpr int kMaxStroke = 128;
  struct Mark {
    bool open = false;
    std::uint64_t seq = 0;
    rt::Time stamp{};
    Vec3 sum = Vec3::Zero();
    int count = 0;               // points seen
    int stride = 1, stored = 0;  // every stride-th is stored
    std::array<Vec3, kMaxStroke> points{};
    std::array<Vec3, kMaxStroke> normals{};
  };
  struct Goal {
    bool pending = false;  // a path is wanted
    bool have = false;     // a mark is being answered
    std::uint64_t mark_seq = 0;
    rt::Time mark_stamp{};
    Vec3 p_W = Vec3::Zero(), normal_W = Vec3::Zero();
    int attempts = 0, waited = 0;
    int moving = 0;  // jobs waited for what moves
    double best_m =
        -1;  // from the mark to the place chosen with nothing moving there; -1: not known yet
    bool second =
        false;  // its place was chosen with something moving at the mark: may be a better one
    std::uint32_t object = 0;      // serial of the object that the mark named; 0: none known
    bool object_placed = false;    // the next one is set
    Vec3 object_W = Vec3::Zero();  // its centre when p_W was last set
    bool grasp_due = false;        // from `box`, which is new
    bool probe = false;            // pending only if there is a place nearer to the goal
    int looks = 0;                 // jobs that it has looked for one
    bool turns = false;            // the base is to end at yaw_rad, W
    double yaw_rad = 0;
    ObjectBox box;
    Grasp grasp;  // kind kNone: the goal is no grasp
  };
  struct State {  // everything step() changes: abandon() restores it
    Mark mark;
    Goal goal;
    Path path;
    Path driven;  // the one before, where it was withdrawn: the robot may still be driving it
    TaskState task;
    std::uint64_t path_seq = 0;
    std::uint64_t last_event_seq = 0;
    TouchEvent::Kind last_event_kind = TouchEvent::Kind::kContactEnd;
    bool any_event = false;
    bool path_truncated = false;
    bool pauses = false;    // ramped down by a silence from which the engagement may resume
    int escape_points = 0;  // leading points of the path that cross unseen floor
  };

  // The ground plane of a map, seen from W.
  struct Ground;

  rt::Health take_events(const In& in, Out& out) noexcept;
  rt::Health take_act(const OperatorAct& act, Out& out) noexcept;
  void pursue(const Goal& goal, Out& out) noexcept;
  rt::Health follow_object(const ObjectList& list, Out& out) noexcept;
  rt::Health choose_grasp(const Ground& ground, const drivers::RobotState& robot,
                          Out& out) noexcept;
  void begin_mark(const TouchEvent& e) noexcept;
  void add_point(const TouchEvent& e) noexcept;
  void end_mark(Out& out) noexcept;
  void drop_path(Out& out) noexcept;
  void give_up(Out& out, TaskState::Failure why) noexcept;
  enum class Holds : std::uint8_t { kYes, kNo, kExtend };  // kExtend: passable, but plan again
  [[nodiscard]] Holds path_holds(const Ground& ground, const perception::CostMap& map,
                                 Point2 robot) const noexcept;
  [[nodiscard]] bool arrived(const drivers::RobotState& robot) const noexcept;
  [[nodiscard]] bool look_for_nearer() noexcept;
  void stand() noexcept;
  [[nodiscard]] double reached_within(const Ground& ground) const noexcept;
  [[nodiscard]] bool worth_waiting(const perception::CostMap& map, Point2 mark,
                                   Point2 goal) const noexcept;
  [[nodiscard]] bool moves_near(const perception::CostMap& map, Point2 mark) const noexcept;
  void watch_path(const Ground& ground, const In& in, Out& out) noexcept;
  // False: planning for this mark has run out of time too often.
  [[nodiscard]] bool may_try(std::uint64_t mark_seq) noexcept;
  void stop_if_asked(const In& in, Out& out) noexcept;
  rt::Health wait_for_inputs(const In& in, bool robot_ok, Out& out) noexcept;
  rt::Health pursue_goal(const rt::Tick& tick, const In& in, const Ground& ground,
                         Out& out) noexcept;
  rt::Health make_path(const rt::Tick& tick, const In& in, const Ground& ground, Out& out) noexcept;
  rt::Health answer_failure(const perception::CostMap& map, Out& out) noexcept;
  void publish_path(const rt::Tick& tick, const In& in, const Ground& ground, Point2 goal,
                    Out& out) noexcept;
  void look_ahead(const rt::Tick& tick, const Ground& ground, const perception::CostMap& map,
                  const drivers::RobotState& robot) noexcept;
  [[nodiscard]] bool along_old_path(const Ground& ground, const perception::CostMap& map,
                                    Point2 robot, Point2 direction, double way_m) noexcept;
  bool go_on(const perception::CostMap& map, Point2 next) noexcept;
  [[nodiscard]] PlanStatus find_start(const perception::CostMap& map, Point2 robot,
                                      const rt::Tick& tick, bool& escape) noexcept;
  std::size_t find_escapes(const perception::CostMap& map, Point2 robot,
                           const rt::Tick& tick) noexcept;
  [[nodiscard]] bool find_goal(const perception::CostMap& map, Point2 mark, Point2 facing,
                               Point2& goal) const noexcept;
  [[nodiscard]] bool find_stand(const perception::CostMap& map, Point2 mark, Point2 facing,
                                Point2& goal) const noexcept;
  void lay_points(const Ground& ground, bool escape, Out& out) noexcept;
  void lay_headings(double robot_yaw, const Ground& ground, Point2 mark, Point2 facing) noexcept;

  PlanningConfig config_;
  std::uint64_t seed_;
  Planner planner_;
  State state_, before_;
  // Not part of State, since it must survive an aborted job.
  std::uint64_t tried_mark_ = 0;  // whose plan was tried last
  int aborted_ = 0;               // jobs in a row that were aborted at it
  bool tried_ = false;            // this job planned; its end is not known yet
  std::array<Planner::Source, 4096> sources_{};
  // Scratch of a job: the path that the robot still drives, from its place now, before a new path
  // takes effect.
  static constexpr int kMostAhead = 64;
  std::array<Point2, kMostAhead> ahead_{};
  int ahead_size_ = 0;
  struct Near {  // an occupied cell that an escape must not come nearer to than `least_m`
    Point2 p;
    double least_m = 0;
  };
  std::array<Near, 2048> near_{};
};

}  // namespace tasks

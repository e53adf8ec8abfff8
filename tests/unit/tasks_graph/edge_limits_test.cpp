// Every row of kLimitTable that a task reads, in the nodes as they run: a writer that falls silent,
// and one that goes on publishing data of long ago. Within the limit nothing changes; beyond it the
// row's consequence is there, the task's log says so, and it ends when the value is in time again.
// (The console's rows: tests/fault/messages.)
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <set>
#include <string>

#include "tasks/graph/capture_node.hpp"
#include "tasks/graph/fusion_node.hpp"
#include "tasks/graph/haptic_node.hpp"
#include "tasks/graph/planning_node.hpp"
#include "tasks/graph/prediction_node.hpp"
#include "tasks/graph/robot_io_node.hpp"
#include "tasks/graph/supervision_nodes.hpp"

namespace {

using perception::Vec3;
using rt::Nanos;
using rt::Time;
using std::chrono::milliseconds;
using tasks::EdgeId;
using tasks::Mode;
using tasks::OperatorCells;
using tasks::RobotCells;
using tasks::TaskId;
using Watch = tasks::LimitWatch;

constexpr Nanos kUnsure = milliseconds{20};  // of the link's conversions

class Hand final : public drivers::HapticDevice {
 public:
  drivers::DeviceProperties properties() const noexcept override { return {}; }
  bool sense(Time now, drivers::StylusSample& out) noexcept override {
    out = {};
    out.seq = ++seq_;
    out.taken = now;
    out.state = drivers::DeviceState::kForce;
    return true;
  }
  void act(Time, const drivers::ForceCommand&) noexcept override {}
  void make_safe() noexcept override {}

 private:
  std::uint64_t seq_ = 0;
};

class Bus final : public drivers::MotorBus {
 public:
  drivers::BusStatus act(Time, const drivers::MotorSetpoints&) noexcept override {
    return drivers::BusStatus::kOk;
  }
  drivers::BusStatus sense(Time now, drivers::MotorStates& out) noexcept override {
    out = {};
    out.seq = ++seq_;
    out.taken = now;
    return drivers::BusStatus::kOk;
  }
  void make_safe() noexcept override {}

 private:
  std::uint64_t seq_ = 0;
};

// A frame at every poll.
class Camera final : public drivers::Camera {
 public:
  perception::Intrinsics intrinsics() const noexcept override { return {60, 60, 3.5, 2.5, 8, 6}; }
  double rate_hz() const noexcept override { return 30; }
  drivers::CameraStatus poll(Time now, perception::RgbdFrame& out) noexcept override {
    out.seq = ++seq_;
    out.exposure = now;
    out.intrinsics = intrinsics();
    out.has_colour = false;
    return drivers::CameraStatus::kFrame;
  }

 private:
  std::uint64_t seq_ = 0;
};

// The readers, and a writer of each edge that is this test.
struct Boxes {
  rt::Startup startup;
  Hand hand;
  Bus bus;
  Camera camera;
  tasks::GraphConfig config;
  tasks::OperatorSetup setup;
  tasks::RobotSetup robot_setup;
  std::unique_ptr<OperatorCells> cells;
  std::unique_ptr<RobotCells> robot_cells;
  tasks::LinkStatus link;
  tasks::OperatorRequests requests;
  std::unique_ptr<tasks::HapticNode> haptic;
  std::unique_ptr<tasks::FusionNode> fusion;
  std::unique_ptr<tasks::PlanningNode> planning;
  std::unique_ptr<tasks::PredictionNode> prediction;
  std::unique_ptr<tasks::SupervisionNode> supervision;
  std::unique_ptr<tasks::RobotIoNode> robot_io;
  std::unique_ptr<tasks::CaptureNode> capture;
  std::unique_ptr<tasks::RobotSupervisionNode> robot_supervision;
  rt::JobRecord record;
  std::uint64_t seq = 0;

  explicit Boxes(const std::function<void(tasks::GraphConfig&)>& change = {}) {
    if (change) change(config);
    auto& nrt = startup.token();
    config.fusion.tsdf.max_blocks = 2000;
    config.haptic.method = "force_shading";  // so that every edge is there
    setup.device = &hand;
    setup.fusion.camera = {60, 60, 31.5, 23.5, 64, 48};
    config.capture.pictures.depth_codec = "faithful";
    robot_setup.bus = &bus;
    robot_setup.camera = &camera;
    cells = std::make_unique<OperatorCells>(nrt, config);
    robot_cells = std::make_unique<RobotCells>(nrt, rt::FaultPlan{}, true);
    haptic = std::make_unique<tasks::HapticNode>(nrt, config, setup, *cells, 1e-3);
    fusion = std::make_unique<tasks::FusionNode>(nrt, config, setup, *cells, requests);
    planning = std::make_unique<tasks::PlanningNode>(nrt, config, setup, *cells, requests);
    prediction = std::make_unique<tasks::PredictionNode>(nrt, config, setup, *cells, link);
    supervision =
        std::make_unique<tasks::SupervisionNode>(nrt, config, *cells, link, requests, setup);
    robot_io = std::make_unique<tasks::RobotIoNode>(nrt, config, robot_setup, *robot_cells, link);
    capture = std::make_unique<tasks::CaptureNode>(nrt, config, robot_setup, *robot_cells);
    robot_supervision = std::make_unique<tasks::RobotSupervisionNode>(nrt, config, *robot_cells,
                                                                      link, requests, robot_setup);
    link.round_trip_ns = 1000;
  }

  rt::TaskBody& body(TaskId id) {
    switch (id) {
      case TaskId::kHaptic:
        return *haptic;
      case TaskId::kFusion:
        return *fusion;
      case TaskId::kPlanning:
        return *planning;
      case TaskId::kPrediction:
        return *prediction;
      case TaskId::kSupervision:
        return *supervision;
      case TaskId::kRobotIo:
        return *robot_io;
      case TaskId::kCapture:
        return *capture;
      default:
        return *robot_supervision;
    }
  }

  template <class T>
  T& slot(rt::Latest<T>& cell) {
    T& m = cell.begin_write();
    return m;
  }
  // Published at `at`, of data of `taken`.
  void write(EdgeId edge, Time at, Time taken) {
    ++seq;
    switch (edge) {
      case EdgeId::kFrame: {
        auto& m = slot(cells->of<EdgeId::kFrame>().cell);
        m.exposure = taken;
        cells->of<EdgeId::kFrame>().cell.publish(at, kUnsure);
        break;
      }
      case EdgeId::kRobotState: {
        auto& m = slot(cells->of<EdgeId::kRobotState>().cell);
        m = {};
        m.seq = seq;
        m.made = m.taken = taken;
        m.mode = static_cast<std::uint8_t>(Mode::kEngaged);
        cells->of<EdgeId::kRobotState>().cell.publish(at, kUnsure);
        break;
      }
      case EdgeId::kGoal: {
        auto& m = slot(robot_cells->of<EdgeId::kGoal>().cell);
        m = {};
        m.seq = seq;
        m.made = taken;
        m.valid_until = taken + milliseconds{config.prediction.goal_valid_ms};
        m.engaged = m.operator_engaged = 1;
        robot_cells->of<EdgeId::kGoal>().cell.publish(at, kUnsure);
        break;
      }
      case EdgeId::kPatch: {
        auto& m = slot(cells->of<EdgeId::kPatch>().cell);
        m.map_id = 1;
        m.seq = seq;
        m.fused = at;
        m.exposure = taken;
        m.voxel_size = 0.01;
        m.metres_per_unit = 1e-6F;
        m.nodes = 8;
        cells->of<EdgeId::kPatch>().cell.publish(at);
        break;
      }
      case EdgeId::kSurface: {
        auto& m = slot(cells->of<EdgeId::kSurface>().cell);
        m.seq = seq;
        m.fused = at;
        m.exposure = taken;
        cells->of<EdgeId::kSurface>().cell.publish(at);
        break;
      }
      case EdgeId::kCostMap: {
        auto& m = slot(cells->of<EdgeId::kCostMap>().cell);
        m.seq = seq;
        m.fused = at;
        m.exposure = taken;
        cells->of<EdgeId::kCostMap>().cell.publish(at);
        break;
      }
      case EdgeId::kCameraPose: {
        auto& m = slot(cells->of<EdgeId::kCameraPose>().cell);
        m = {};
        m.seq = seq;
        m.exposure = at;
        m.seen = taken;
        m.claimed = true;
        m.X_WC.linear() = Eigen::AngleAxisd(1.5707963, Vec3::UnitY()).toRotationMatrix();  // level
        cells->of<EdgeId::kCameraPose>().cell.publish(at);
        break;
      }
      case EdgeId::kObjects: {
        auto& m = slot(cells->of<EdgeId::kObjects>().cell);
        m.seq = seq;
        m.exposure = taken;
        cells->of<EdgeId::kObjects>().cell.publish(at);
        break;
      }
      case EdgeId::kHand: {
        auto& m = slot(cells->of<EdgeId::kHand>().cell);
        m = {};
        m.seq = seq;
        m.stamp = taken;
        m.v_WH = Vec3(1, 0, 0);
        cells->of<EdgeId::kHand>().cell.publish(at);
        break;
      }
      case EdgeId::kTouch: {
        tasks::TouchEvent e;
        e.seq = seq;
        e.stamp = taken;
        e.kind = planning_mark_ ? tasks::TouchEvent::Kind::kMarkPoint
                                : tasks::TouchEvent::Kind::kMarkBegin;
        planning_mark_ = true;
        cells->of<EdgeId::kTouch>().cell.try_push(e);
        break;
      }
      case EdgeId::kEdit:
      case EdgeId::kAct:
        requests.console_ns = rt::ns_of(at);
        break;
      case EdgeId::kDrive: {
        auto& m = slot(cells->of<EdgeId::kDrive>().cell);
        m = {seq, taken, true, 0.1, 0, 0};
        cells->of<EdgeId::kDrive>().cell.publish(at);
        break;
      }
      case EdgeId::kOdometryFrame: {
        auto& m = slot(cells->of<EdgeId::kOdometryFrame>().cell);
        m = {};
        m.seq = seq;
        m.taken = taken;
        m.known = true;
        cells->of<EdgeId::kOdometryFrame>().cell.publish(at);
        break;
      }
      case EdgeId::kPath: {
        auto& m = slot(cells->of<EdgeId::kPath>().cell);
        m.seq = 1;
        m.size = 1;
        m.points[0] = {1, 0, 0};
        m.seen = taken;
        cells->of<EdgeId::kPath>().cell.publish(at);
        break;
      }
      case EdgeId::kMode:
      case EdgeId::kRobotMode: {
        auto& cell = edge == EdgeId::kMode ? cells->of<EdgeId::kMode>().cell
                                           : robot_cells->of<EdgeId::kRobotMode>().cell;
        auto& m = slot(cell);
        m = {};
        m.seq = seq;
        m.stamp = taken;
        m.mode = Mode::kEngaged;
        cell.publish(at);
        break;
      }
      case EdgeId::kDemand: {
        auto& m = slot(robot_cells->of<EdgeId::kDemand>().cell);
        m = {seq, taken};
        robot_cells->of<EdgeId::kDemand>().cell.publish(at);
        break;
      }
      default:
        FAIL() << "no reader of it is a task";
    }
  }
  bool planning_mark_ = false;

  // One job of the reader. Fusion and planning only latch: what their steps do without an input is
  // for their own tests.
  rt::Health job(TaskId id, Time now) {
    rt::Tick tick;
    tick.k = ++k_;
    tick.release = tick.start = now;
    tick.period = Nanos{1'000'000'000 / tasks::kTaskTable[tasks::index_of(id)].rate_hz};
    record = {};
    rt::TaskBody& b = body(id);
    b.latch(tick, record);
    if (id == TaskId::kFusion) return {};
    const rt::Health health = b.step(tick, record);
    b.commit(tick, record);
    return health;
  }
  std::uint64_t k_ = 0;
};

// Is the row's consequence there, after a job that ended with `health`?
using Answer = std::function<bool(const Boxes&, const rt::Health&)>;
struct Case {
  EdgeId edge;
  TaskId reader;
  Answer silent, old;
};

std::vector<Case> cases() {
  const auto fault = [](rt::FaultId id) -> Answer {
    return [id](const Boxes&, const rt::Health& h) { return h.fault == id; };
  };
  const Answer told = [](const Boxes&, const rt::Health& h) { return h.fault == rt::kNoFault; };
  const auto both = [](EdgeId e, TaskId r, Answer a) { return Case{e, r, a, a}; };
  return {
      {EdgeId::kFrame, TaskId::kFusion,
       [](const Boxes& b, auto&) { return !b.fusion->in().frame_fresh; },
       [](const Boxes& b, auto&) { return !b.fusion->in().frame_fresh; }},
      both(EdgeId::kRobotState, TaskId::kPrediction, fault(tasks::prediction_fault::kStateStale)),
      both(EdgeId::kRobotState, TaskId::kPlanning,
           [](const Boxes& b, auto&) { return b.planning->in().robot == nullptr; }),
      both(EdgeId::kOdometryFrame, TaskId::kPlanning,
           [](const Boxes& b, auto&) { return b.planning->in().robot == nullptr; }),
      both(EdgeId::kRobotState, TaskId::kFusion,
           [](const Boxes& b, auto&) { return !b.fusion->in().odometry; }),
      both(EdgeId::kRobotState, TaskId::kSupervision, fault(tasks::kFaultLinkSilent)),
      {EdgeId::kGoal, TaskId::kRobotIo, fault(tasks::robot_io_fault::kLinkSilent),
       fault(tasks::robot_io_fault::kGoalExpired)},
      {EdgeId::kGoal, TaskId::kRobotSupervision, fault(tasks::kFaultLinkSilent),
       [](const Boxes& b, auto&) {
         return b.robot_supervision->in().requests.engage ==
                tasks::SupervisionTask::Engage::kAbsent;
       }},
      {EdgeId::kPatch, TaskId::kHaptic, fault(tasks::kFaultHapticPatchStale), told},
      {EdgeId::kSurface, TaskId::kHaptic, fault(tasks::kFaultHapticSurfaceStale), told},
      both(EdgeId::kCostMap, TaskId::kPlanning,
           [](const Boxes& b, auto&) { return !b.planning->in().may_plan; }),
      both(EdgeId::kCameraPose, TaskId::kPrediction,
           [](const Boxes& b, auto&) { return b.prediction->in().camera == nullptr; }),
      both(EdgeId::kCameraPose, TaskId::kHaptic,
           [](const Boxes& b, auto&) { return !b.haptic->in().view_yaw_rad; }),
      both(EdgeId::kObjects, TaskId::kPlanning,
           [](const Boxes& b, auto&) { return b.planning->in().objects == nullptr; }),
      both(EdgeId::kHand, TaskId::kFusion,
           [](const Boxes& b, auto&) { return b.fusion->in().hand.v_WH.isZero(); }),
      {EdgeId::kTouch, TaskId::kPlanning, fault(tasks::kFaultPlanningEventsLost), {}},
      {EdgeId::kEdit, TaskId::kFusion, told, {}},
      {EdgeId::kAct, TaskId::kPlanning, told, {}},
      both(EdgeId::kDrive, TaskId::kPrediction,
           [](const Boxes& b, auto&) { return b.prediction->in().drive == nullptr; }),
      both(EdgeId::kPath, TaskId::kPrediction,
           [](const Boxes& b, auto&) { return b.prediction->in().path == nullptr; }),
      both(EdgeId::kMode, TaskId::kHaptic,
           [](const Boxes& b, auto&) { return b.haptic->in().mode.mode == Mode::kRampDown; }),
      both(EdgeId::kMode, TaskId::kPrediction,
           [](const Boxes& b, auto&) {
             const auto goal = b.cells->read_by_link<EdgeId::kGoal>();
             EXPECT_EQ(goal->operator_engaged, 1) << "asked is asked";
             return goal->engaged == 0;
           }),
      both(EdgeId::kMode, TaskId::kPlanning,
           [](const Boxes& b, auto&) { return !b.planning->in().may_plan; }),
      both(EdgeId::kDemand, TaskId::kCapture,
           [](const Boxes& b, auto&) { return b.capture->in().demand == nullptr; }),
      both(EdgeId::kRobotMode, TaskId::kRobotIo,
           [](const Boxes& b, auto&) {
             const auto state = b.robot_cells->read_by_link<EdgeId::kRobotState>();
             EXPECT_EQ(static_cast<Mode>(state->mode), Mode::kEngaged) << "nobody has left it";
             return b.robot_io->in().mode->mode == Mode::kRampDown;
           }),
  };
}

struct Told {
  bool silent = false, old = false, back = false;
};

// Plays one row: good for a while, bad from `bad`, good again.
void play(const Case& c, bool stall, Boxes& b) {
  const auto& row = [&]() -> const tasks::LimitRow& {
    for (const auto& r : tasks::kLimitTable) {
      if (r.edge == c.edge && r.reader == c.reader) return r;
    }
    throw std::logic_error("no row");
  }();
  const std::size_t index = static_cast<std::size_t>(&row - tasks::kLimitTable.data());
  const std::string name = std::string(tasks::kEdgeTable[tasks::index_of(c.edge)].name) + " to " +
                           std::string(tasks::reader_name(c.reader)) +
                           (stall ? ", silent" : ", old");
  SCOPED_TRACE(name);
  const tasks::Limit limit = tasks::limit_in_force(b.config, index);
  const Answer& beyond = stall ? c.silent : c.old;
  const Nanos period{1'000'000'000 / tasks::kTaskTable[tasks::index_of(c.reader)].rate_hz};
  auto* const logs =
      tasks::box_of(c.reader) == rt::Box::kRobot ? b.robot_cells->logs.get() : b.cells->logs.get();
  Told told;
  const auto listen = [&] {
    for (rt::LogRecord r; logs->of(c.reader).try_pop(r);) {
      if (r.site != logs->limits[index].id) continue;
      told.back |= r.words[0] == 0;
      told.silent |= r.words[0] == 1;
      told.old |= r.words[0] == 2;
    }
  };
  Time now = rt::time_from_ns(100'000'000'000);
  Time last_bad{}, heard = now;
  const auto tick = [&](bool bad) {
    now += period;
    for (const auto& r : tasks::kLimitTable) {
      if (r.reader != c.reader || r.edge == c.edge) continue;
      if (r.edge != EdgeId::kTouch && r.edge != EdgeId::kObjects) b.write(r.edge, now, now);
    }
    const bool stalled = bad && stall;
    if (!stalled) {
      // Bad: on time, of when it was last good.
      b.write(c.edge, now, bad ? last_bad : now);
      heard = now;
    }
    // Of the goal the line's own silence counts.
    b.link.last_heard_ns = rt::ns_of(c.edge == EdgeId::kGoal ? heard : now);
    const rt::Health health = b.job(c.reader, now);
    listen();
    return beyond ? beyond(b, health) : false;
  };
  // Where all that happens is that it is told, the answer says no more than that nothing else does.
  const bool always = c.edge == EdgeId::kEdit || c.edge == EdgeId::kAct ||
                      ((c.edge == EdgeId::kPatch || c.edge == EdgeId::kSurface) && !stall);
  for (int i = 0; i < 5; ++i) {
    const bool yet = tick(false);
    if (always || i < 3) continue;  // prediction needs some states first
    ASSERT_FALSE(yet) << "before anything is wrong, job " << i;
  }
  ASSERT_FALSE(told.silent || told.old);
  last_bad = now;
  const bool remote = tasks::kEdgeTable[tasks::index_of(c.edge)].kind == tasks::EdgeKind::kRemote;
  const Nanos most = stall ? limit.liveness : limit.age - (remote ? kUnsure : Nanos{0});
  const Time began = now;
  bool yet = false;
  while (now + period - began <= most) {
    yet = tick(true);
    if (always || (c.edge == EdgeId::kFrame && stall)) continue;  // no frame comes at once
    ASSERT_FALSE(yet) << "early, after " << rt::seconds(now - began) << " s";
  }
  EXPECT_FALSE(told.silent || told.old) << "told early";
  yet = tick(true);
  EXPECT_TRUE(yet) << row.beyond << ": after " << rt::seconds(now - began) << " s, limit "
                   << rt::seconds(most);
  // Haptic looks at a patch when its last blend has ended.
  for (int i = 0; i < 40 && c.edge == EdgeId::kPatch && !told.old; ++i)
    static_cast<void>(tick(true));
  EXPECT_EQ(told.silent, stall);
  EXPECT_EQ(told.old, !stall);
  EXPECT_FALSE(told.back);
  for (int i = 0; i < (c.edge == EdgeId::kPatch ? 80 : 3); ++i) yet = tick(false);
  EXPECT_TRUE(always || c.edge == EdgeId::kTouch || !yet) << "in time again";
  EXPECT_TRUE(told.back || c.edge == EdgeId::kTouch);
}

TEST(EdgeLimits, EveryRowOfATaskHasACase) {
  std::set<std::pair<EdgeId, TaskId>> here;
  for (const auto& c : cases()) here.insert({c.edge, c.reader});
  for (const auto& r : tasks::kLimitTable) {
    if (r.reader == tasks::kConsole) continue;
    EXPECT_EQ(here.count({r.edge, r.reader}), 1U)
        << tasks::kEdgeTable[tasks::index_of(r.edge)].name;
  }
}

TEST(EdgeLimits, AStalledWriterHasTheRowsConsequence) {
  for (const auto& c : cases()) {
    Boxes b;
    play(c, true, b);
  }
}

TEST(EdgeLimits, AnOldDatumPublishedOnTimeHasTheRowsConsequence) {
  for (const auto& c : cases()) {
    if (!c.old) continue;  // does not age: below
    Boxes b;
    play(c, false, b);
  }
}

TEST(EdgeLimits, MarksAndEditsDoNotAge) {
  Boxes b;
  const Time now = rt::time_from_ns(100'000'000'000), long_ago = now - std::chrono::hours{1};
  b.write(EdgeId::kMode, now, now);
  b.write(EdgeId::kTouch, now, long_ago);
  const rt::Health health = b.job(TaskId::kPlanning, now);
  EXPECT_NE(health.fault, tasks::kFaultPlanningEventsLost);
  EXPECT_TRUE(b.planning->in().touch_live);
  tasks::SceneEdit edit;
  edit.seq = 1;
  edit.stamp = long_ago;
  edit.half_m = {0.1, 0.1, 0.1};
  ASSERT_TRUE(b.cells->of<EdgeId::kEdit>().cell.try_push(edit));
  b.write(EdgeId::kEdit, now, now);
  (void)b.job(TaskId::kFusion, now);
  EXPECT_TRUE(b.fusion->in().clear_W);
}

// A scene's keys are in force; bad ones are one clear error.
TEST(EdgeLimits, ASceneSetsThem) {
  tasks::GraphConfig c;
  config::Section root;
  c.describe(root);
  ASSERT_TRUE(config::load_override("limits.planning.cost_map_age_ms=300", root));
  ASSERT_TRUE(config::load_override("prediction.state_liveness_ms=200", root));
  const auto map = tasks::limit_row(EdgeId::kCostMap, TaskId::kPlanning);
  EXPECT_EQ(tasks::limit_in_force(c, map).age, milliseconds{300});
  EXPECT_EQ(tasks::limit_in_force(c, map).liveness, milliseconds{500});
  const auto state = tasks::limit_row(EdgeId::kRobotState, TaskId::kPrediction);
  EXPECT_EQ(tasks::limit_in_force(c, state).age, milliseconds{200});
  Boxes b([](tasks::GraphConfig& x) {
    x.limits.data_age_ms[tasks::limit_row(EdgeId::kCostMap, TaskId::kPlanning)] = 300;
  });
  play({EdgeId::kCostMap,
        TaskId::kPlanning,
        {},
        [](const Boxes& x, auto&) { return !x.planning->in().may_plan; }},
       false, b);
  const auto low = config::load_override("limits.haptic.mode_liveness_ms=15", root);
  ASSERT_FALSE(low) << "less than two periods of supervision";
  EXPECT_NE(low.error().find("mode_liveness_ms"), std::string::npos) << low.error();
  EXPECT_NE(low.error().find("20"), std::string::npos) << low.error();
  EXPECT_FALSE(config::load_override("limits.planning.touch_age_ms=100", root))
      << "marks do not age";
  EXPECT_THROW(Boxes([](tasks::GraphConfig& x) { x.haptic.mark_rate_hz = 3; }), std::runtime_error)
      << "an open mark would be dropped between two points";
}

}  // namespace

#include "tests/fault/walk/walk.hpp"

namespace walk {
namespace {

// Releases of a task in so many seconds.
int releases(const std::string& task, double s) {
  for (const auto& row : tasks::kTaskTable)
    if (row.name == task) return static_cast<int>(s * static_cast<double>(row.rate_hz));
  throw std::logic_error(task + " is no task");
}
const std::vector<std::string> kDirect{R"(robot.bus.kind="direct")"},
    kChain{R"(robot.bus.kind="ethercat-twin")"}, kCan{R"(robot.bus.kind="can-twin")"},
    kLines{R"(robot.gpio.kind="twin")", "robot.gpio.estop_line_2=1", "robot.gpio.enable_line=2",
           "robot.gpio.heartbeat_line=3", "robot.gpio.lamp_line=4"};

// A job that begins 10 s late, from 3 s on: the task is silent.
std::vector<Planned> silent(const std::string& task) {
  return {{"late_release", task, releases(task, kFrom_s), 1, 1e4}};
}
// Each message of those 10 s.
std::vector<Planned> each(const std::string& kind, const std::string& edge, int rate_hz,
                          double magnitude_ms = 0) {
  return {{kind, edge, static_cast<int>(kFrom_s * rate_hz),
           static_cast<int>((kUntil_s - kFrom_s) * rate_hz), magnitude_ms}};
}

Story camera(const char* code, const char* what, FaultyCamera::Fault fault) {
  return {.code = code,
          .what = what,
          .begin = [fault](World& w) { w.camera->fault = fault; },
          .end = [](World& w) { w.camera->fault = FaultyCamera::Fault::kNone; }};
}
Story hand(const char* code, const char* what, FaultyHand::Fault fault) {
  return {.code = code,
          .what = what,
          .begin = [fault](World& w) { w.hand->fault = fault; },
          .end = [](World& w) { w.hand->fault = FaultyHand::Fault::kNone; }};
}
using Act = std::function<void(World&)>;
Story chain(const char* code, const char* what, Act begin, Act end, Act lasts = {}) {
  return {.code = code,
          .what = what,
          .overrides = kChain,
          .begin = std::move(begin),
          .lasts = std::move(lasts),
          .end = std::move(end)};
}
Story can(const char* code, const char* what, Act begin, Act end) {
  return {.code = code,
          .what = what,
          .overrides = kCan,
          .begin = std::move(begin),
          .end = std::move(end)};
}
Story lines(const char* code, const char* what, Act begin, Act end, Act lasts = {}) {
  return {.code = code,
          .what = what,
          .overrides = kLines,
          .begin = std::move(begin),
          .lasts = std::move(lasts),
          .end = std::move(end)};
}

Story nothing_crosses(const char* code) {
  return {.code = code,
          .what = "nothing crosses",
          .overrides = {"link.shape.delay_ms=0", "link.shape.jitter_ms=0",
                        "link.shape.rate_Mbit_per_s=0", "link.network.delay_ms=30",
                        "link.network.rate_Mbit_per_s=60"},
          .set_up = [](teletact::Scene& s) {
            s.link.network.stalls.push_back({kFrom_s, 1000 * (kUntil_s - kFrom_s), 0});
          }};
}

drivers::youbot_bus::YoubotChain& slaves(World& w) { return w.twins.chain->chain(); }
drivers::ethercat::WireFaults& wire(World& w) { return w.twins.chain->port().faults(); }
rt::Time wire_now(World& w) { return w.twins.chain->port().now(); }
drivers::can::CanTwinPort& bus(World& w) { return w.twins.can->port(); }

void operators_side(std::vector<Story>& all) {
  using Camera = FaultyCamera::Fault;
  using Hand = FaultyHand::Fault;
  all.push_back(camera("F-CAP-01", "an image of no size", Camera::kInvalid));
  all.push_back({.code = "F-CAP-90", .what = "capture silent", .plan = silent("capture")});
  all.push_back(camera("F-FUS-01", "the camera sees another place", Camera::kElsewhere));
  all.back().short_run = true;
  all.push_back({.code = "F-FUS-03",
                 .what = "the map is full",
                 .overrides = {"fusion.tsdf.max_blocks=1024"}});
  all.back().short_run = true;
  all.push_back(camera("F-FUS-01", "no depth at all", Camera::kDark));
  all.push_back(camera("F-FUS-04", "the same instant again", Camera::kStale));
  all.push_back({.code = "F-FUS-90", .what = "fusion silent", .plan = silent("fusion")});
  all.back().short_run = true;
  all.push_back(hand("F-HAP-01", "the device tells no number", Hand::kNotFinite));
  all.back().short_run = true;
  all.push_back({.code = "F-HAP-02", .what = "no patch", .plan = each("drop", "patch", 30)});
  all.push_back(hand("F-HAP-03", "the device is silent", Hand::kSilent));
  all.push_back(
      {.code = "F-HAP-04", .what = "no number in a patch", .plan = each("nan", "patch", 30)});
  all.push_back({.code = "F-HAP-05",
                 .what = "no ray cast",
                 .overrides = {R"(haptic.method="force_shading")"},
                 .plan = {{"drop", "surface", 20, 40}}});
  all.push_back({.code = "F-HAP-90", .what = "haptic silent", .plan = silent("haptic")});
  all.push_back(
      {.code = "F-PRE-01", .what = "no robot state", .plan = each("drop", "robot_state", 100)});
  all.push_back(
      {.code = "F-PRE-02", .what = "no number in it", .plan = each("nan", "robot_state", 100)});
  all.push_back({.code = "F-PRE-90", .what = "prediction silent", .plan = silent("prediction")});
  all.push_back({.code = "F-PLN-90", .what = "planning silent", .plan = silent("planning")});
}

void robots_bus(std::vector<Story>& all) {
  all.push_back(
      chain("F-RIO-01", "each tenth frame lost", {}, {}, [](World& w) { wire(w).lose_back = 1; }));
  all.push_back(chain(
      "F-RIO-02", "no frame comes back", [](World& w) { wire(w).lose_back = 1 << 20; },
      [](World& w) { wire(w).lose_back = 0; }));
  all.push_back({.code = "F-RIO-03", .what = "no goal", .plan = each("drop", "goal", 20)});
  all.push_back(
      {.code = "F-RIO-04", .what = "no number in a goal", .plan = each("nan", "goal", 20)});
  all.push_back(nothing_crosses("F-RIO-05"));
  all.push_back(can("F-RIO-06", "module 4: timeout",
                    [](World& w) { bus(w).modules()[3].timed_out = true; }, {}));
  all.push_back({.code = "F-RIO-07",
                 .what = "the encoder tells no number",
                 .overrides = kDirect,
                 .begin = [](World& w) { w.twins.base->faults().nan_angle = true; },
                 .end = [](World& w) { w.twins.base->faults().nan_angle = false; }});
  all.push_back(chain("F-RIO-10", "each tenth counter wrong", {}, {},
                      [](World& w) { wire(w).wrong_counter = 1; }));
  all.push_back(chain("F-RIO-11", "a wheel's slave left OP",
                      [](World& w) { slaves(w).wire().slave(3).fall(0x0050, wire_now(w)); }, {}));
  all.push_back(chain(
      "F-RIO-12", "cable cut behind slave 2", [](World& w) { slaves(w).wire().cut_behind(2); },
      [](World& w) { slaves(w).wire().cut_behind(5); }));
  // Released, its boards are not in OP: no fresh measurement of the motors before a clear.
  all.push_back(chain(
      "F-RIO-12", "emergency stop of the chain", [](World& w) { slaves(w).emergency_stop(); },
      [](World& w) { slaves(w).release_emergency_stop(wire_now(w)); }));
  all.back().short_run = all.back().holding_too = true;
  all.push_back(chain(
      "F-RIO-13", "no link", [](World& w) { wire(w).link_down = true; },
      [](World& w) { wire(w).link_down = false; }));
  all.push_back(chain(
      "F-RIO-14", "stuck encoder", [](World& w) { slaves(w).drive(2)->stick_encoder(true); },
      [](World& w) { slaves(w).drive(2)->stick_encoder(false); }));
  all.push_back(chain("F-RIO-15", "I2t trip",
                      [](World& w) { slaves(w).drive(3)->trip_i2t(wire_now(w)); }, {}));
  all.push_back(chain(
      "F-RIO-16", "overcurrent (bit 0)",
      [](World& w) { slaves(w).drive(3)->set_faults(1U, wire_now(w)); },
      [](World& w) { slaves(w).drive(3)->set_faults(0, wire_now(w)); }));
  all.push_back(chain("F-RIO-17", "commutation lost",
                      [](World& w) { slaves(w).drive(2)->set_commutated(false, wire_now(w)); },
                      {}));
  all.back().short_run = true;  // final
  all.push_back(can(
      "F-RIO-26", "bus-off", [](World& w) { bus(w).bus_off(); },
      [](World& w) { bus(w).restart(); }));
  all.push_back(can(
      "F-RIO-27", "module 3 silent", [](World& w) { bus(w).modules()[2].silent = true; },
      [](World& w) { bus(w).modules()[2].silent = false; }));
  all.back().short_run = true;
  all.push_back(can(
      "F-RIO-28", "nobody acknowledges", [](World& w) { bus(w).faults().cable_cut = true; },
      [](World& w) { bus(w).faults().cable_cut = false; }));
  all.push_back(can(
      "F-RIO-29", "interface down", [](World& w) { bus(w).faults().interface_down = true; },
      [](World& w) { bus(w).faults().interface_down = false; }));
  all.push_back(can(
      "F-RIO-30", "module 2 refuses", [](World& w) { bus(w).modules()[1].status_instead = 4; },
      [](World& w) { bus(w).modules()[1].status_instead = 0; }));
  all.push_back({.code = "F-RIO-90", .what = "robot_io silent", .plan = silent("robot_io")});
}

void robots_lines(std::vector<Story>& all) {
  const auto at = [](World& w) { return w.robot_now; };
  all.push_back(lines(
      "F-RIO-20", "emergency stop", [at](World& w) { w.twins.lines->press(at(w)); },
      [at](World& w) { w.twins.lines->release(at(w)); }));
  all.back().short_run = true;
  all.push_back(lines(
      "F-RIO-21", "lines not readable", [](World& w) { w.twins.lines->unreadable(true); },
      [](World& w) { w.twins.lines->unreadable(false); }));
  all.push_back(lines(
      "F-RIO-22", "contacts disagree",
      [at](World& w) {
        w.twins.lines->weld_second(true);
        w.twins.lines->press(at(w));
      },
      [at](World& w) {
        w.twins.lines->release(at(w));
        w.twins.lines->weld_second(false);
      }));
  all.push_back(lines("F-RIO-23", "enable switch let go",
                      [at](World& w) { w.twins.lines->let_go(at(w)); }, {}));
  all.push_back(lines(
      "F-RIO-25", "heartbeat not set", [](World& w) { w.twins.lines->unwritable(true); },
      [](World& w) { w.twins.lines->unwritable(false); }));
}

void between_the_boxes(std::vector<Story>& all) {
  all.push_back(nothing_crosses("F-SUP-02"));
  all.back().short_run = true;
  all.push_back(lines("F-SUP-04", "enable switch let go",
                      [](World& w) { w.twins.lines->let_go(w.robot_now); }, {}));
  all.push_back(lines(
      "F-SUP-05", "emergency stop", [](World& w) { w.twins.lines->press(w.robot_now); },
      [](World& w) { w.twins.lines->release(w.robot_now); }));
}

}  // namespace

std::vector<Story> stories() {
  std::vector<Story> all;
  operators_side(all);
  robots_bus(all);
  robots_lines(all);
  between_the_boxes(all);
  return all;
}

std::vector<Elsewhere> elsewhere() {
  const std::string unit = "tests/unit/";
  return {
      {"F-CAP-02", unit + "tasks_capture/capture_test.cpp ColourThatDoesNotFitIsLeftOutAndReported",
       "no twin of a camera makes such colour"},
      {"F-FUS-02",
       unit + "tasks_fusion/test_task.cpp OdometryCarriesAlongAWallUntilItsErrorIsTooLarge",
       "a flat wall alone is a lost camera in the scene's room"},
      {"F-FUS-05", unit + "tasks_body/body_test.cpp WithoutGoodJointsTheImageIsRefused",
       "only a scene with an arm has joints"},
      {"F-PRE-03", unit + "tasks_prediction/prediction_task_test.cpp BadPathAndBadStateAreRefused",
       "ends a goal, not the engagement"},
      {"F-PRE-04",
       unit + "tasks_prediction/prediction_task_test.cpp "
              "AStateThatWasTooOldHoldsTheBaseForAWhileAndItSaysWhy",
       "the virtual link measures the round trip before the start"},
      {"F-PRE-05", unit + "tasks_prediction/camera_pose_test.cpp UnbelievableCameraPoseIsRefused",
       "counted alone"},
      {"F-PRE-06",
       unit + "tasks_prediction/camera_pose_test.cpp "
              "ADarkCameraStopsTheBaseBeforeItIsOffByTheLimit",
       "in 10 s of darkness the base does not drive far enough"},
      {"F-PLN-01", unit + "tasks_planning/give_up_test.cpp GivesUpWhatIsUnreachable",
       "ends a goal"},
      {"F-PLN-02", unit + "tasks_planning/give_up_test.cpp SpendsItsAttemptsThenGivesUp",
       "no input is known by which OMPL throws; the goal ends as one whose attempts are spent"},
      {"F-PLN-03",
       unit + "tasks_planning/planning_task_test.cpp DuplicatesLoneEndsAndNonsenseAreNoMarks",
       "ends a goal"},
      {"F-PLN-04", unit + "tasks_planning/planning_task_test.cpp AGapDropsTheOpenMark",
       "ends a goal"},
      {"F-PLN-05", unit + "tasks_planning/give_up_test.cpp AnAbortedJobLeavesNoTrace",
       "ends a goal"},
      {"F-PLN-06", unit + "tasks_planning/give_up_test.cpp AGoalOutOfTimeAgainAndAgainIsGivenUp",
       "ends a goal"},
      {"F-PLN-07", unit + "tasks_planning/grasp_test.cpp IsGivenUpWithAReasonWhereThereIsNone",
       "ends a goal"},
      {"F-RIO-08", unit + "tasks_robot_io/robot_io_test.cpp ABaseThatLagsIsReported",
       "a base without the torque is a scene of its own"},
      {"F-RIO-24", unit + "tasks_safety/safety_test.cpp LostEdgesAreCounted", "counted alone"},
      {"F-RIO-32",
       unit + "desk_run/acts_test.cpp ARobotThatIsAlwaysLateIsToldAndClearingItIsRefused",
       "the executor's stop wants jobs that are late for ever"},
      {"F-RIO-31",
       unit + "tasks_robot_io/arm_fault_test.cpp EachIsNamedStopsAndIsRecoveredFromByAnAct",
       "the chain of a virtual run is the base alone"},
      {"F-SUP-01",
       unit + "tasks_supervision/supervision_test.cpp EmergencyStopNeedsReleaseClearAndEngage",
       "no node of this stack gives supervision an input of its own"},
      {"F-SUP-03", unit + "tasks_supervision/restart_test.cpp LinkRefusedNeedsARestart",
       "both boxes of a virtual run are one program"},
      {"F-SUP-06", unit + "desk_run/desk_run_test.cpp DrivingByHandEndsWithItsTokensAndReplays",
       "an act of the person's own"},
      {"F-SUP-07", unit + "desk_run/desk_run_test.cpp AStopOvertakesWhateverWaits",
       "an act of the person's own"},
      {"F-SUP-08", unit + "tasks_supervision/supervision_test.cpp RequestedStop",
       "an act of the program's end"},
      {"F-SUP-09",
       unit + "tasks_supervision/restart_test.cpp WhatWantsARestartIsToldWhateverCameFirst",
       "the executor's watchdog exists on the real clock only"},
      {"F-SUP-10",
       unit + "tasks_supervision/supervision_test.cpp "
              "UnknownFaultIsAsSevereAsItSaysAtLeastDegraded",
       "no task of this stack reports one"},
      {"F-SUP-11",
       unit + "tasks_supervision/supervision_test.cpp NoEngageWhereTheHostHasNoRoomForIt",
       "a property of the host"},
  };
}

}  // namespace walk

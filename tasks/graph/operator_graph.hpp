// The operator box: its cells, its five tasks bound to them, and the link edges it ends.
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <vector>

#include "drivers/haptic/haptic_device.hpp"
#include "drivers/link/command_gate.hpp"
#include "drivers/link/endpoint.hpp"
#include "rt/sched/mode_gate.hpp"
#include "rt/sched/task.hpp"
#include "tasks/contract/operator_act.hpp"
#include "tasks/edges/edge_cells.hpp"
#include "tasks/graph/graph_config.hpp"
#include "tasks/graph/node_parts.hpp"
#include "tasks/graph/samples.hpp"
#include "tasks/graph/task_log.hpp"

namespace tasks {

// The operator box's ends of the edges, and what is no edge: health, logs, samples.
struct OperatorCells : EdgeCells<rt::Box::kOperator> {
  OperatorCells(rt::NonRealtime& nrt, const GraphConfig& config, const rt::FaultPlan& faults = {});

  // health of the watched tasks, by TaskId
  std::vector<std::unique_ptr<HealthCell>> health;

  // For people and reports.
  std::unique_ptr<TaskLogs> logs;
  HapticSamples haptic_samples;
  FusionSamples fusion_samples;
  LinkSamples link_samples;
};

// Written by the link's thread (or the virtual link), read by supervision and prediction.
struct LinkStatus {
  std::atomic<std::int64_t> last_heard_ns{0};  // local box time of the last valid message; 0 never
  std::atomic<std::int64_t> round_trip_ns{0};
  std::atomic<std::int64_t> uncertainty_ns{0};
  std::atomic<bool> refused{false};  // handshake failed
  std::atomic<bool> closed{false};   // the connection has ended: known at once, unlike a silence
  std::atomic<bool> expected{true};
  std::atomic<std::uint64_t> session{0};  // number of the connection
  // Of the operator's goals at the robot's box (CommandGate::Report): how many, and the newest
  // fault. On the operator's box as the robot's last said. For people; no task reads them.
  std::atomic<std::uint64_t> commands_refused{0};
  std::atomic<std::uint8_t> commands_newest{0};
  // What is spared of the pictures now (drivers::Spared), as the robot's end says; and of the
  // newest picture that arrived on the operator's box, the middle of its exposure in local time,
  // ns. For people, likewise.
  std::atomic<std::uint8_t> spared_rungs{0}, spared_why{0};
  std::atomic<std::int64_t> picture_ns{0};
  std::atomic<std::uint64_t> pictures{0};  // that crossed: sent by the robot's box, or arrived

  void tell_refused(std::uint64_t commands, drivers::CommandFault newest) noexcept {
    commands_refused.store(commands);
    commands_newest.store(static_cast<std::uint8_t>(newest));
  }
  void tell_spared(drivers::Spared spared) noexcept {
    spared_why.store(static_cast<std::uint8_t>(spared.why));
    spared_rungs.store(spared.rungs);
  }
  [[nodiscard]] drivers::Spared spared() const noexcept {
    return {spared_rungs.load(), static_cast<drivers::Spared::Why>(spared_why.load())};
  }
};

// Written by the console: what the operator asks for.
struct OperatorRequests {
  std::atomic<int> engage{0};  // 0 absent, 1 no, 2 yes (SupervisionTask::Engage)
  std::atomic<bool> ramp_down{false}, stop{false}, clear{false};
  std::atomic<bool> watchdog_bit{false};
  std::atomic<std::int64_t> console_ns{0};  // when the console last looked, local box time; 0 never
  std::atomic<std::uint64_t> mesh_taken{0};  // seq of the newest mesh delta that the console took
};

// The values of LinkStatus and OperatorRequests that a latch took: no sequence number names them,
// so whoever records a run asks for them.
struct LatchedStatus {
  std::int64_t last_heard_ns = 0, round_trip_ns = 0, uncertainty_ns = 0;
  std::uint64_t session = 0;
  int engage = 0;
  bool refused = false, expected = false, closed = false;
  bool ramp_down = false, stop = false, clear = false, watchdog_bit = false;
  bool events_full = false;  // planning took all the touch events it had room for
  std::uint64_t mesh_taken = 0;
  std::optional<SceneEdit> edit;   // fusion took it off the ring
  std::optional<OperatorAct> act;  // planning took it off the ring
  DriveIntent drive;               // prediction's newest, with its number and when it was published
  std::uint64_t drive_number = 0;  // 0: none yet
  rt::Time drive_at{};
};

// What the graphs of both boxes hold beside their tasks.
template <class Cells>
class BoxGraph {
 public:
  BoxGraph(const BoxGraph&) = delete;
  BoxGraph& operator=(const BoxGraph&) = delete;

  [[nodiscard]] Cells& cells() noexcept { return *cells_; }
  [[nodiscard]] const GraphConfig& config() const noexcept { return config_; }
  [[nodiscard]] LinkStatus& link() noexcept { return link_; }
  [[nodiscard]] OperatorRequests& requests() noexcept { return requests_; }

 protected:
  explicit BoxGraph(const GraphConfig& config) : config_(config) {}
  ~BoxGraph() = default;

  GraphConfig config_;
  std::unique_ptr<Cells> cells_;  // made by the box's own constructor
  LinkStatus link_;
  OperatorRequests requests_;
};

struct OperatorSetup {
  FusionSetup fusion;
  drivers::HapticDevice* device = nullptr;
  std::function<std::int64_t()> device_twin_cpu;  // empty: a real device
  bool odometry_prior = true;                     // false: the camera does not ride on the robot
  bool hash_outputs = false;                      // fill JobRecord::output_hash
  rt::FaultPlan faults;                           // message faults on edges; empty = none
  rt::ModeGate mode_gate;                         // from the admission; open = every mode fits
  std::function<void()> decoded;                  // a picture, for fusion; by the link's thread
};

class OperatorGraph : public BoxGraph<OperatorCells> {
 public:
  OperatorGraph(rt::NonRealtime&, const GraphConfig&, const OperatorSetup&, double haptic_period_s);
  ~OperatorGraph();

  [[nodiscard]] rt::TaskBody& body(TaskId id);
  // Registers the link edges: frame and robot_state in, goal out.
  void bind_link(rt::NonRealtime&, drivers::LinkEndpoint& endpoint);

  // What the operator asks of the scene; by the console's thread. False: no room now, ask again.
  [[nodiscard]] bool edit(const SceneEdit& edit) noexcept;
  // The same for planning.
  [[nodiscard]] bool act(const OperatorAct& act) noexcept;
  // To prediction; by the console's thread.
  void drive(const DriveIntent& intent, rt::Time now) noexcept;
  // Of the newest latch of `id`; by that task's thread, before its next latch.
  [[nodiscard]] LatchedStatus latched(TaskId id) const noexcept;
  [[nodiscard]] const FusionTask& fusion() const noexcept;
  [[nodiscard]] const HapticTask& haptic() const noexcept;

 private:
  struct Nodes;
  perception::Intrinsics camera_;
  std::function<void()> decoded_;
  std::unique_ptr<Nodes> nodes_;
};

}  // namespace tasks

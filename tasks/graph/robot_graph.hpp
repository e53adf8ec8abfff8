// The robot box: its cells, its three tasks bound to them, and the link edges it ends.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <vector>

#include "drivers/camera/camera.hpp"
#include "drivers/gpio/safety_io.hpp"
#include "drivers/link/command_gate.hpp"
#include "drivers/link/endpoint.hpp"
#include "drivers/link/frame_asker.hpp"
#include "drivers/youbot/motor_bus.hpp"
#include "rt/sched/task.hpp"
#include "tasks/graph/graph_config.hpp"
#include "tasks/graph/node_parts.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tasks/graph/samples.hpp"

namespace tasks {

// The robot box's ends of the edges, and what is no edge.
struct RobotCells : EdgeCells<rt::Box::kRobot> {
  // on_demand: with the edge `demand`, for a codec that needs its previous frame.
  explicit RobotCells(rt::NonRealtime& nrt, const rt::FaultPlan& faults = {},
                      bool on_demand = false);
  std::vector<std::unique_ptr<HealthCell>> health;  // by TaskId

  std::unique_ptr<TaskLogs> logs;
  RobotSamples robot_samples;
};

// The demand that capture's newest latch took: a recording keeps it, since the link made it.
struct LatchedDemand {
  std::uint64_t number = 0;  // of the value in its cell
  rt::Time at{};             // of its publication
  drivers::FrameDemand demand;
};

struct RobotSetup {
  drivers::MotorBus* bus = nullptr;
  drivers::Camera* camera = nullptr;
  drivers::SafetyIo* safety = nullptr;  // null: the robot has no safety lines
  std::function<std::int64_t()> bus_twin_cpu, camera_twin_cpu;  // empty: real devices
  bool hash_outputs = false;
  rt::FaultPlan faults;
  rt::ModeGate mode_gate;  // from the admission; open = every mode fits
};

class RobotGraph : public BoxGraph<RobotCells> {
 public:
  RobotGraph(rt::NonRealtime&, const GraphConfig&, const RobotSetup&);
  ~RobotGraph();

  [[nodiscard]] rt::TaskBody& body(TaskId id);
  // Registers the link edges: frame and robot_state out, goal in; where frames are coded on demand
  // also who asks for them.
  void bind_link(rt::NonRealtime&, drivers::LinkEndpoint& endpoint);

  // Of the newest latch of `id`; by that task's thread, before its next latch.
  [[nodiscard]] LatchedStatus latched(TaskId id) const noexcept;
  [[nodiscard]] const LatchedDemand& latched_demand() const noexcept;
  // By the link's thread, or when it rests.
  [[nodiscard]] const drivers::FrameAsker& asker() const noexcept { return asker_; }
  [[nodiscard]] const CaptureTask& capture() const noexcept;

 private:
  struct Nodes;
  drivers::CommandGate gate_;
  drivers::FrameAsker asker_;
  std::unique_ptr<Nodes> nodes_;
};

}  // namespace tasks

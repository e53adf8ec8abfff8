// What comes into the tasks of a box from beside its own tasks, as the latch that comes next in a
// replay is to find it.
#pragma once

#include <vector>

#include "drivers/youbot/motor_bus.hpp"
#include "rt/hash.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tasks/graph/robot_graph.hpp"
#include "tools/record/input_record.hpp"

namespace teletact {

// The shared words.
void set_words(tasks::LinkStatus& link, tasks::OperatorRequests& requests, const StatusInput& s);
// What the console asked of the scene, for fusion.
void set_scene(tasks::OperatorGraph& graph, const SceneInput& s, rt::Hash64& inputs);
// What the operator asked of planning; the velocity by hand, for prediction, under its number.
void set_act(tasks::OperatorGraph& graph, const TouchInput& in, rt::Hash64& inputs);
void set_drive(tasks::OperatorGraph& graph, const DriveInput& in, rt::Hash64& inputs);
// The link's demand for a frame, for capture, under the number that it had.
void set_demand(tasks::RobotGraph& graph, const CameraInput& in, rt::Hash64& inputs);

// The motor bus: what each job of robot_io read, and what became of what it wrote.
class FedBus final : public drivers::MotorBus {
 public:
  explicit FedBus(const Recording& recording) {
    for (const JobOp& op : recording.ops) {
      if (op.kind == JobOp::Kind::kLatch &&
          op.task == static_cast<std::uint16_t>(tasks::TaskId::kRobotIo))
        jobs_.push_back(op.get<MotorInput>());
    }
    jobs_.emplace_back();  // behind the last one
  }
  // The next job of robot_io begins.
  const MotorInput& feed() noexcept {
    if (next_ + 1 < jobs_.size()) ++next_;
    return now();
  }
  [[nodiscard]] drivers::BusStatus sense(rt::Time, drivers::MotorStates& states) noexcept override {
    const MotorInput& fed = now();
    wrote_ = false;
    // Whatever the status: a bus that is down may have told what the wheels do.
    states.seq = fed.seq;
    states.taken = rt::time_from_ns(fed.taken_ns);
    states.wheel_rad = fed.wheel_rad;
    states.wheel_rad_per_s = fed.wheel_rad_per_s;
    states.current_A = fed.current_A;
    states.flags = fed.flags;
    return fed.status();
  }
  // What became of it was noted with the next job's input.
  [[nodiscard]] drivers::BusStatus act(rt::Time, const drivers::MotorSetpoints&) noexcept override {
    wrote_ = true;
    return jobs_[next_].sent();
  }
  [[nodiscard]] drivers::BusDetail detail() const noexcept override {
    return (wrote_ ? jobs_[next_] : now()).detail();
  }
  void make_safe() noexcept override {}

 private:
  [[nodiscard]] const MotorInput& now() const noexcept { return jobs_[next_ > 0 ? next_ - 1 : 0]; }

  std::vector<MotorInput> jobs_;
  std::size_t next_ = 0;  // the job behind the one that is fed
  bool wrote_ = false;
};

}  // namespace teletact

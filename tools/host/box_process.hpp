// One box of the demo as a process of its own: build, hand-shake, arm, run, ramp down, save.
// Exit codes of a child: 0 orderly, 3 could not start, 4 stopped by a fault.
#pragma once

#include "tools/host/host_admission.hpp"
#include "tools/host/run_demo.hpp"

namespace teletact {

struct BoxPlan {
  std::int64_t epoch_host_ns = 0;
  HostPlan host;  // of the union of both boxes
  tasks::Calibration calibration;
  rt::FaultPlan faults;
  bool planned = false;  // run the planned executor
  std::string folder;    // where the halves go
};

// Throws what the registry says when another program's tasks leave no room for both boxes.
void check_room(const BoxPlan& plan);

// Tasks of one box as the header of its run log, with calibration's range of the work count.
[[nodiscard]] rt::RunLog log_header(const std::vector<rt::PlacedTask>& placed, rt::Box box,
                                    const tasks::Calibration& calibration);

[[nodiscard]] int run_operator_process(rt::NonRealtime&, const Scene&, const DemoOptions&,
                                       const BoxPlan&);
[[nodiscard]] int run_robot_process(rt::NonRealtime&, const Scene&, const DemoOptions&,
                                    const BoxPlan&);

}  // namespace teletact

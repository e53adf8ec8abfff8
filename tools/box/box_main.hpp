// One box as a process: build, hand-shake, arm, run, ramp down, save. A box of the demo runs for so
// many seconds over one connection, from an epoch that both agree on. A box of its own (teletact
// robot, teletact operator) has its own epoch and a link that lasts (BoxPlan::open_link).
// Exit codes: 0 orderly, 3 could not start, 4 stopped by a fault, 5 the disk refused a file of it.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "drivers/link/link_transport.hpp"
#include "rt/result.hpp"
#include "tools/host/host_admission.hpp"
#include "tools/host/run_options.hpp"

namespace teletact {

inline constexpr int kTaskHung = 4, kFileRefused = 5;

struct BoxPlan {
  std::int64_t epoch_host_ns = 0;
  rt::BoxTime clock[2] = {kOperatorClock, kRobotClock};  // by rt::Box
  HostPlan host;
  tasks::Calibration calibration;
  rt::FaultPlan faults;
  bool planned = false;  // run the planned executor
  std::string folder;    // where the halves go
  // Of a box of its own: a lasting transport. Empty: a box of the demo.
  std::function<rt::Result<std::unique_ptr<drivers::LinkTransport>>()> open_link{};

  [[nodiscard]] bool lasting() const noexcept { return static_cast<bool>(open_link); }
  [[nodiscard]] const rt::BoxTime& clock_of(rt::Box box) const noexcept {
    return clock[static_cast<std::size_t>(box)];
  }
};

// Throws what the registry says when another program's tasks leave no room: for both boxes, or for
// one of them.
void check_room(const BoxPlan& plan, std::optional<rt::Box> box = std::nullopt);

[[nodiscard]] int run_operator_process(rt::NonRealtime&, const Scene&, const DemoOptions&,
                                       const BoxPlan&);
[[nodiscard]] int run_robot_process(rt::NonRealtime&, const Scene&, const DemoOptions&,
                                    const BoxPlan&);

}  // namespace teletact

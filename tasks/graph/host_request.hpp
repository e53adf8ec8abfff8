// What the demo asks of the host: both boxes' tasks, fusion's pool workers, sentinels, watchdogs,
// declared ordinary threads; and what each mode of supervision asks of it.
#pragma once

#include <vector>

#include "config/schema.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/mode_table.hpp"
#include "rt/sched/task_spec.hpp"
#include "tasks/graph/calibration.hpp"

namespace tasks {

// Section [pool]: threads beside fusion's own that take part of each image, each a row of the
// admission.
struct PoolConfig {
  int fusion_workers = 0;  // 0: fusion runs on one core, as two cores want it
  void describe(config::Section& s);
};

// Declared figures of the pool. The first two are shares of what a fusion job costs one thread; a
// calibration with workers has rows of its own for both. The others are shares of fusion's own
// budget.
inline constexpr double kOwnShare = 0.7;     // what is left to fusion itself
inline constexpr double kWorkerShare = 0.5;  // what one worker may cost
inline constexpr double kBeforeShare =
    1.0;  // fusion's own, before the last fork: the view is near the end
inline constexpr double kOverlapShare = 0.4;  // fusion's own, while workers run
inline constexpr int kForksPerImage =
    30;  // at most: the tracking's iterations, filter, fusion, casts

// Of a core. link, console: of each box; camera_twin: the robot's; page: the operator's, beside its
// console.
struct BestEffortShares {
  double camera_twin = 0, link = 0.065, console = 0.02, page = 0;
};

// Of both ends of the link together, of a core: kLinkMargin times what they took on the simulated
// clock, where they have neither sockets nor TLS and nobody wakes up for them, and kSocketsShare
// for each box. Where nobody measured it: twice BestEffortShares::link; what other codecs take is
// not in that (picture_cost.hpp).
[[nodiscard]] double declared_link_share(const Calibration& calibration) noexcept;
// chosen on: default room, rounds, 2 cores; judged on: nothing else
// On the real clock both ends took .04 to .05 more than on the simulated one over loopback, and .07
// to .10 more with TLS over a road of packets.
inline constexpr double kLinkMargin = 1.2;
inline constexpr double kSocketsShare = 0.05;

// Of the camera's twin, of a core: kTwinMargin times what it took on the simulated clock, or
// kTwinShare where nobody measured it.
[[nodiscard]] double declared_twin_share(const Calibration& calibration) noexcept;
inline constexpr double kTwinShare = 0.30;
// chosen on: default room, 2 cores; judged on: nothing else
// On the real clock the twin shares its caches with every task.
inline constexpr double kTwinMargin = 1.5;

// `specs`: the task table (make_specs). The pool's rows follow them, so row i of the answer is task
// i.
[[nodiscard]] rt::AdmissionRequest make_request(const std::vector<rt::TaskSpec>& specs,
                                                const std::vector<int>& cpus,
                                                const BestEffortShares& shares,
                                                const PoolConfig& pool = {},
                                                const Calibration& calibration = {});

// One set a mode (tasks::Mode), for rt::analyse_modes. Today every task runs in every mode, at the
// level that it was admitted at: a mode changes what the tasks put out, not what they cost. So no
// change is ever refused, and the table says so instead of assuming it; a task that is given less
// or more to do in one mode is entered here. Only engaged may be refused: all others are what a
// fault leads to.
[[nodiscard]] std::vector<rt::ModeSet> mode_sets(const rt::AdmissionRequest& request,
                                                 const rt::Admission& admission);

}  // namespace tasks

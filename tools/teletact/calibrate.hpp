// Measures what each variant of each task costs on this machine: the whole stack on the virtual
// clock with real bodies, every task forced to one level after the other, thread CPU of each job; again for
// each static choice that the scene allows, where only the tasks that choose are measured.
#pragma once

#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tasks/graph/calibration.hpp"
#include "tools/teletact/run_demo.hpp"

namespace teletact {

// `seconds` of simulated time a level and choice. Tasks with policy abort are not measured: their budget is what
// they are given, and they end when it is spent.
[[nodiscard]] tasks::Calibration calibrate(rt::NonRealtime&, Scene&, double seconds, bool quiet);

// The calibration of this host: the file named, or ~/.cache/teletact/calibration.toml if it is of this
// host, else measured now and stored there. `text` says which it was.
[[nodiscard]] tasks::Calibration host_calibration(rt::NonRealtime&, Scene&, const DemoOptions&,
                                                  std::string& text);

// config/limits/reference_costs.toml: shipped, so that virtual runs are the same everywhere.
[[nodiscard]] tasks::Calibration reference_calibration();

}  // namespace teletact

// The end of a run, from either clock: both halves to figures, report, what is said and the exit
// code.
#pragma once

#include <string>

#include "tools/host/run_options.hpp"

namespace teletact {

// 0: a run without problems; 1: info.problems says which. json_path: figures to this file; empty:
// none.
int finish_run(const DemoOptions&, const Scene&, RunInfo& info, const OperatorHalf&,
               const RobotHalf&, const std::string& json_path);

}  // namespace teletact

// Cost of each effect of the catalogue: thread CPU of the task (or thread) that pays for it, in a
// run that asks for the effect, minus the same in a run without it.
//
// Both runs are of the default scene on the simulated clock, where the same keys give the same jobs
// to the last bit. Of each job the least time of several rounds counts, which leaves out what else
// the machine did. Costs below a floor can not be told from none. The floor is the difference in
// the payer's cost between runs that differ only in effects which others pay for.
#pragma once

#include <ostream>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tools/host/effect_costs.hpp"

namespace teletact {

// `only`: an effect's name; empty: all. Says on `progress` what it does. Throws std::runtime_error
// with one line.
[[nodiscard]] EffectCosts measure_effects(rt::NonRealtime&, std::ostream& progress, double seconds,
                                          int rounds, const std::string& only = {});

}  // namespace teletact

// What each effect of the catalogue costs: thread CPU of the one that pays for it, of a run in which it is asked for less
// that of the same run without it.
//
// The runs are of the default scene on the simulated clock, where the same keys give the same jobs to the last bit: of
// each job the least of several rounds counts, so what else the machine did is left out. The floor below which a cost is
// not told from none is what the same payer's cost differs by in runs that change what others pay for.
#pragma once

#include <ostream>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tools/host/effect_costs.hpp"

namespace teletact {

// `only`: an effect's name; empty: all. Says on `progress` what it does. Throws std::runtime_error with one line.
[[nodiscard]] EffectCosts measure_effects(rt::NonRealtime&, std::ostream& progress, double seconds,
                                          int rounds, const std::string& only = {});

}  // namespace teletact

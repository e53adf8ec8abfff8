// Read once for the command line and all that runs once for a person's command, where
// TELETACT_PRECOMPILE is on. Each file still includes what it uses.
#pragma once

#include "tools/cli/options.hpp"
#include "tools/cmake/graph.hpp"

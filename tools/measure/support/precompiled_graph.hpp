// Read once for the measurements of a box as a whole, where TELETACT_PRECOMPILE is on. Each file
// still includes what it uses.
#pragma once

#include "tools/host/console.hpp"
#include "tools/host/run_options.hpp"
#include "tools/measure/support/precompiled.hpp"

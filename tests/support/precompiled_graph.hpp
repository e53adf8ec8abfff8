// Read once for all tests of the graph of a box and of what stands above it, where
// TELETACT_PRECOMPILE is on. Each file still includes what it uses.
#pragma once

#include <nlohmann/json.hpp>

#include "tests/support/precompiled.hpp"
#include "tools/host/console.hpp"
#include "tools/host/run_options.hpp"

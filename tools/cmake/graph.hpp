// Read once for all libraries that need the graph of a box, where TELETACT_PRECOMPILE is on. Each
// file still includes what it uses.
#pragma once

#include "tasks/edges/edge_cells.hpp"
#include "tasks/graph/graph_config.hpp"
#include "tools/cmake/geometry.hpp"

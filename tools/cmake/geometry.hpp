// Read once for all libraries that need geometry, where TELETACT_PRECOMPILE is on. Each file still
// includes what it uses.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "config/schema.hpp"
#include "perception/geometry/pose.hpp"

// What every file of cases begins with.
#pragma once

#include <cstdio>
#include <string>

#include "tools/measure/stability/cases.hpp"

namespace stability {

using rig::Path;
using rig::Rig;
using rig::Row;
using rig::Scene;
using rig::Vec3;

// Share of the ticks in the surface that the optimum may leave unjudged.
inline constexpr double kUnjudged = 0.01;

inline std::string text(const char* format, auto... values) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

}  // namespace stability

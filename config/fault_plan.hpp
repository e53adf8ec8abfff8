// Fault plans as TOML. What the kinds do and when an entry fires: rt/fault/plan.hpp.
//
//   name = "theft_7_7ms"
//   seed = 1
//   [[fault]]
//   kind = "theft"
//   target = "haptic"       # a task for timing faults, "<writer>.<message>" for message faults
//   first = 500             # release index, or sequence number
//   every = 1000
//   magnitude_us = 7700
#pragma once

#include <deque>
#include <string>

#include "config/schema.hpp"
#include "rt/fault/plan.hpp"
#include "rt/result.hpp"

namespace config {

struct FaultEntryConfig {
  std::string kind = "late_release";
  std::string target;
  int first = 0;
  int every = 1;
  int count = 0;
  double probability = 1.0;
  std::uint64_t seed = 0;
  double magnitude_us = 0.0;

  void describe(Section& s);
};

struct FaultPlanConfig {
  std::string name;
  std::string purpose;
  std::uint64_t seed = 1;
  std::deque<FaultEntryConfig> faults;

  void describe(Section& s);
  [[nodiscard]] rt::FaultPlan plan() const;
};

// Reads and checks one plan; an unnamed one is called by its path. Targets are checked
// with rt::check() by whoever knows the tasks and edges.
[[nodiscard]] rt::Result<rt::FaultPlan> load_fault_plan(const std::string& path);

}  // namespace config

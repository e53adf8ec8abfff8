// Ordinary threads, each task on a core of its own where there is one: the kernel then interleaves
// them in more ways than priorities on one core allow, and needs no right for it.
#pragma once

#include "tests/timing/real_executor/rig.hpp"

namespace rig {

inline rt::RealOptions ordinary() {
  rt::RealOptions o = light();
  o.fifo = false;
  o.hang_limit = rt::Nanos{60 * kSecond};  // a job of a loaded machine is not a hung one
  return o;
}

inline rt::PlacedTask spread(std::string name, std::int64_t hz, Body& body, std::uint16_t id) {
  rt::PlacedTask t = placed(std::move(name), hz, body, id);
  const std::vector<int> cpus = rt::affinity_cpus();
  t.core = cpus[id % cpus.size()];
  return t;
}

inline rt::FaultPlan one_fault(rt::FaultKind kind, const char* target, std::uint64_t first,
                               std::int64_t magnitude = 0, std::uint64_t every = 1) {
  rt::FaultPlan plan;
  rt::FaultEntry e;
  e.kind = kind;
  e.target = target;
  e.magnitude = rt::Nanos{magnitude};
  e.first = first;
  e.every = every;
  plan.entries.push_back(e);
  return plan;
}

}  // namespace rig

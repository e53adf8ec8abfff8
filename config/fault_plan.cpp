#include "config/fault_plan.hpp"

#include <limits>

namespace config {

void FaultEntryConfig::describe(Section& s) {
  constexpr int kMax = std::numeric_limits<int>::max();
  s.text("kind", kind, rt::fault_kind_names(), "what happens");
  s.text("target", target, {}, "task, or edge as <writer>.<message>");
  s.integer("first", first, 0, kMax, "first release index or sequence number");
  s.integer("every", every, 1, kMax, "distance between candidates");
  s.integer("count", count, 0, kMax, "number of candidates; 0: no end");
  s.number("probability", probability, 0.0, 1.0, "of a candidate to fire");
  s.seed("seed", seed, "of this entry's draws, mixed with the plan's");
  s.number("magnitude_us", magnitude_us, 0.0, 60e6, "how long, late, or much CPU, in microseconds");
}

void FaultPlanConfig::describe(Section& s) {
  s.text("name", name, {}, "of the plan, for reports");
  s.text("purpose", purpose, {}, "what the plan shows");
  s.seed("seed", seed, "of all draws of the plan");
  s.list(
      "fault", [this](Section& item) { faults.emplace_back().describe(item); },
      "one entry; all that fire at an index act together");
}

rt::FaultPlan FaultPlanConfig::plan() const {
  rt::FaultPlan out;
  out.name = name;
  out.seed = seed;
  for (const FaultEntryConfig& f : faults) {
    rt::FaultEntry e;
    e.kind = rt::fault_kind(f.kind).value();  // the schema has checked the name
    e.target = f.target;
    e.first = static_cast<std::uint64_t>(f.first);
    e.every = static_cast<std::uint64_t>(f.every);
    e.count = static_cast<std::uint64_t>(f.count);
    e.probability = f.probability;
    e.seed = f.seed;
    e.magnitude = rt::nanos_from_seconds(f.magnitude_us * 1e-6);
    out.entries.push_back(e);
  }
  return out;
}

rt::Result<rt::FaultPlan> load_fault_plan(const std::string& path) {
  FaultPlanConfig file;
  Section root;
  file.describe(root);
  if (const auto loaded = load_file(path, root); !loaded) return rt::Error{loaded.error()};
  if (file.name.empty()) file.name = path;
  rt::FaultPlan plan = file.plan();
  if (const auto good = rt::check(plan, {}, {}); !good) {
    return rt::Error{path + ": " + good.error()};
  }
  return plan;
}

}  // namespace config

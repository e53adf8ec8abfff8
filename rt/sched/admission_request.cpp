// The input side of admission: what a request must be, and the CPUs it may name.
#include <sched.h>

#include <algorithm>

#include "rt/sched/admission.hpp"

namespace rt {
namespace {

std::string quoted(const std::string& name) { return std::string("'").append(name).append("'"); }

std::string variant_note(const TaskSpec& spec, int level) {
  if (spec.variants.empty()) return {};
  return std::string(" (").append(spec.variants[static_cast<std::size_t>(level)].name).append(")");
}

std::string malformed_task(const TaskSpec& spec, int cores) {
  const std::string who = "task " + quoted(spec.name) + ": ";
  if (spec.name.empty()) return "a task has no name";
  if (spec.rate.num <= 0 || spec.rate.den <= 0) return who + "rate must be positive";
  if (spec.deadline.count() < 0) return who + "deadline is negative";
  if (spec.jitter.count() < 0 || spec.blocking.count() < 0) {
    return who + "jitter or blocking is negative";
  }
  if (spec.core && (*spec.core < 0 || *spec.core >= cores)) {
    return who + "core " + std::to_string(*spec.core) + " (allowed: 0 to " +
           std::to_string(cores - 1) + ", the process's CPUs)";
  }
  for (int l = 0; l < spec.levels(); ++l) {
    if (spec.budget_of(l).count() <= 0) {
      return who + "budget of level " + std::to_string(l) + variant_note(spec, l) + " is " +
             std::to_string(spec.budget_of(l).count()) + " ns (allowed: above 0)";
    }
  }
  return {};
}

}  // namespace

std::string problem_of(const AdmissionRequest& r) {
  const int cores = static_cast<int>(r.cpus.size());
  if (cores == 0) return "no CPU given";
  if (r.tasks.size() >= static_cast<std::size_t>(kTopTaskPriority)) {
    return std::to_string(r.tasks.size()) + " tasks, but there are priorities for " +
           std::to_string(kTopTaskPriority - 1);
  }
  for (const TaskSpec& spec : r.tasks) {
    if (const std::string text = malformed_task(spec, cores); !text.empty()) return text;
  }
  for (const PlatformTask& p : r.platform) {
    if (const std::string text = malformed_task(p.spec, cores); !text.empty()) return text;
    if (p.priority <= kTopTaskPriority) {
      return "platform task " + quoted(p.spec.name) + ": priority " + std::to_string(p.priority) +
             " is not above " + std::to_string(kTopTaskPriority);
    }
  }
  for (const BestEffortLoad& load : r.best_effort) {
    if (!(load.share >= 0 && load.share <= 1)) {
      return "best-effort load '" + load.name + "': share " + std::to_string(load.share) +
             " (allowed: 0 to 1)";
    }
    if (load.core && (*load.core < 0 || *load.core >= cores)) {
      return "best-effort load '" + load.name + "': core " + std::to_string(*load.core) +
             " (allowed: 0 to " + std::to_string(cores - 1) + ")";
    }
  }
  for (const std::string& name : r.degrade_order) {
    const bool known = std::any_of(r.tasks.begin(), r.tasks.end(),
                                   [&](const TaskSpec& t) { return t.name == name; });
    if (!known) return "degrade_order names '" + name + "', which is no task";
  }
  return {};
}

std::vector<TaskSpec> pinned_as(const Admission& admission, std::span<const TaskSpec> tasks) {
  std::vector<TaskSpec> pinned(tasks.begin(), tasks.end());
  for (TaskSpec& spec : pinned) {
    for (const AdmittedTask& row : admission.tasks) {
      if (row.name == spec.name && row.box == spec.box && row.core >= 0) spec.core = row.core;
    }
  }
  return pinned;
}

std::vector<int> affinity_cpus() {
  std::vector<int> cpus;
  // The kernel's mask may be wider than cpu_set_t: ask with growing sets.
  for (int bits = CPU_SETSIZE; bits <= CPU_SETSIZE * 64; bits *= 2) {
    cpu_set_t* set = CPU_ALLOC(static_cast<std::size_t>(bits));
    if (set == nullptr) return cpus;
    const std::size_t size = CPU_ALLOC_SIZE(static_cast<std::size_t>(bits));
    const bool ok = sched_getaffinity(0, size, set) == 0;
    for (int c = 0; ok && c < bits; ++c) {
      if (CPU_ISSET_S(static_cast<std::size_t>(c), size, set)) cpus.push_back(c);
    }
    CPU_FREE(set);
    if (ok) break;
  }
  return cpus;
}

}  // namespace rt

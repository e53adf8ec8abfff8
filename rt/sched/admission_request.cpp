// The input side of admission: what a request must be, and the CPUs it may name.
#include <sched.h>

#include <algorithm>

#include "rt/sched/admission.hpp"

namespace rt {
namespace {

std::string quoted(const std::string& name) { return std::string("'").append(name).append("'"); }

std::string levels_problem(const std::string& who, const std::vector<Variant>& levels,
                           const std::string& choice) {
  for (std::size_t l = 0; l < levels.size(); ++l) {
    const Variant& v = levels[l];
    const std::string where = "level " + std::to_string(l) +
                              (v.name.empty() ? "" : " (" + v.name + ")") +
                              (choice.empty() ? "" : " of choice '" + choice + "'");
    if (v.budget.count() <= 0) {
      return who + "budget of " + where + " is " + std::to_string(v.budget.count()) +
             " ns (allowed: above 0)";
    }
    if (v.until_last_fork.count() < 0 || v.overlap.count() < 0 || v.until_last_fork > v.budget ||
        v.overlap > v.budget) {
      return who + "until_last_fork and overlap of " + where + " (allowed: 0 to its budget)";
    }
  }
  return {};
}

// A worker must be able to follow its parent through every choice and level.
std::string worker_problem(const std::vector<TaskSpec>& tasks, const TaskSpec& w) {
  const std::string who = "task " + quoted(w.name) + ": ";
  if (w.forks != 0) return who + "a pool worker forks no further";
  const auto parent = std::find_if(tasks.begin(), tasks.end(), [&](const TaskSpec& t) {
    return t.name == w.parent && t.box == w.box;
  });
  if (parent == tasks.end() || parent->is_worker())
    return who + "parent " + quoted(w.parent) + " is no task of its box";
  const auto same_levels = [&] {
    if (w.variants.size() != parent->variants.size()) return false;
    if (w.choices.size() != parent->choices.size()) return false;
    for (std::size_t c = 0; c < w.choices.size(); ++c) {
      if (w.choices[c].variants.size() != parent->choices[c].variants.size()) return false;
    }
    return true;
  };
  const bool same = w.rate.num * parent->rate.den == parent->rate.num * w.rate.den &&
                    w.offset == parent->offset && w.policy == parent->policy &&
                    w.relative_deadline() == parent->relative_deadline() && same_levels();
  return same ? std::string()
              : who +
                    "rate, offset, deadline, policy, choices and levels must be those of its "
                    "parent " +
                    quoted(w.parent);
}

std::string fork_problem(const std::vector<TaskSpec>& tasks, const TaskSpec& spec) {
  const std::string who = "task " + quoted(spec.name) + ": ";
  if (spec.forks < 0) return who + "forks is negative";
  if (spec.forks > 0 && spec.policy == MissPolicy::kCatchUp)
    return who + "a task that forks can not catch up: its workers have one job at a time";
  if (spec.is_worker()) return worker_problem(tasks, spec);
  const bool has_workers = std::any_of(tasks.begin(), tasks.end(), [&](const TaskSpec& t) {
    return t.parent == spec.name && t.box == spec.box;
  });
  if (has_workers && spec.forks == 0) return who + "has workers, so forks must be at least 1";
  return {};
}

std::string choices_problem(const AdmissionRequest& r) {
  constexpr std::size_t kMost = 256;
  std::size_t n = 1;
  for (const TaskSpec& spec : r.tasks) {
    if (!spec.is_worker()) n *= std::max<std::size_t>(1, spec.choices.size());
    if (n > kMost) {
      return "static choices of all tasks make more than " + std::to_string(kMost) +
             " combinations";
    }
  }
  return {};
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
  if (spec.policy == MissPolicy::kCatchUp && (spec.catch_up_max < 1 || !spec.ring_fed)) {
    return who + "catch_up needs a Ring as its input (ring_fed) and catch_up_max of at least 1";
  }
  if (spec.spin_lead.count() < 0) return who + "spin lead is negative";
  for (const StaticChoice& c : spec.choices) {
    if (c.name.empty() || c.variants.empty())
      return who + "a static choice has no name or no level";
    if (std::string text = levels_problem(who, c.variants, c.name); !text.empty()) return text;
  }
  if (!spec.choices.empty()) return {};
  if (!spec.variants.empty()) return levels_problem(who, spec.variants, {});
  return levels_problem(who, {{"", spec.budget}}, {});
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
    if (std::string text = malformed_task(spec, cores); !text.empty()) return text;
    if (std::string text = fork_problem(r.tasks, spec); !text.empty()) return text;
  }
  if (std::string text = choices_problem(r); !text.empty()) return text;
  for (const PlatformTask& p : r.platform) {
    if (std::string text = malformed_task(p.spec, cores); !text.empty()) return text;
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

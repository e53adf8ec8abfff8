#include "rt/sched/admission.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <optional>

namespace rt {
namespace {

std::string format(const char* pattern, double value) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), pattern, value);
  return text.data();
}

std::string milliseconds(Nanos d) {
  if (d == kUnbounded) return "unbounded";
  return format("%.3f ms", static_cast<double>(d.count()) * 1e-6);
}

std::string shown_name(const TaskSpec& spec) {
  return std::string("'").append(spec.name).append("'");
}

std::string variant_name(const TaskSpec& spec, int level) {
  if (spec.variants.empty()) return "level 0";
  const Variant& v = spec.variants[static_cast<std::size_t>(level)];
  return v.name.empty() ? "level " + std::to_string(level) : v.name;
}

// What stands on one core: analysis rows, and whose they are.
struct CoreSet {
  std::vector<AnalysisTask> rows;
  std::vector<std::string> names;
  std::vector<std::size_t> tasks;  // rows platform_rows.. belong to these tasks of the request
  std::size_t platform_rows = 0;
};

struct Placement {
  std::vector<int> core;  // per task; -1: nowhere
  bool fits = false;
  std::string why;  // what does not fit, with figures
};

class Admitter {
 public:
  explicit Admitter(const AdmissionRequest& request)
      : req_(request), ranks_(rate_monotonic_ranks(request.tasks)) {
    pinned_load_.assign(req_.cpus.size(), 0.0);
    for (const BestEffortLoad& load : req_.best_effort) {
      if (load.core)
        pinned_load_[static_cast<std::size_t>(*load.core)] += load.share;
      else
        floating_load_ += load.share;
    }
  }

  Admission run() {
    std::vector<int> levels(req_.tasks.size(), 0);
    std::vector<std::size_t> lowered = lower_until_it_fits(levels);
    const bool fits = place(levels).fits;
    if (fits) lowered = take_back(levels, lowered);
    return describe(levels, lowered, fits);
  }

 private:
  // ---- one core ----
  CoreSet core_set(int core, const std::vector<int>& placed, const std::vector<int>& levels) const {
    CoreSet set;
    bool used = false;
    for (const int c : placed) used = used || c == core;
    for (const PlatformTask& p : req_.platform) {
      if (p.spec.core ? *p.spec.core != core : !used) continue;
      set.rows.push_back(analysis_task(p.spec, 0, -p.priority));
      set.names.push_back(shown_name(p.spec));
    }
    set.platform_rows = set.rows.size();
    for (std::size_t i = 0; i < placed.size(); ++i) {
      if (placed[i] != core) continue;
      set.rows.push_back(analysis_task(req_.tasks[i], levels[i], ranks_[i]));
      set.names.push_back(shown_name(req_.tasks[i]));
      set.tasks.push_back(i);
    }
    return set;
  }

  // Empty if the core is fine; else the figures.
  std::string core_problem(int core, const CoreSet& set) const {
    const double load = pinned_load_[static_cast<std::size_t>(core)];
    const double u = utilisation(set.rows, req_.analysis);
    const std::string where =
        "core " + std::to_string(core) + " (cpu " + std::to_string(cpu(core)) + "): ";
    if (u + load > req_.core_limit) {
      return where + "utilisation " + format("%.4f", u + load) + " above " +
             format("%.2f", req_.core_limit) + " (real-time " + format("%.3f", u) +
             ", best effort " + format("%.3f", load) + ")";
    }
    for (std::size_t i = 0; i < set.rows.size(); ++i) {
      const ResponseTime r = response_time(set.rows, i, req_.analysis);
      if (r.meets) continue;
      return where + set.names[i] + " R = " + milliseconds(r.R) +
             " > D = " + milliseconds(set.rows[i].D) + " (C = " + milliseconds(set.rows[i].C) +
             ", T = " + milliseconds(set.rows[i].T) + ", utilisation of the core " +
             format("%.3f", u) + ")";
    }
    return {};
  }

  // ---- placing ----
  // First-fit decreasing at these levels.
  Placement place(const std::vector<int>& levels) const {
    Placement p;
    p.core.assign(req_.tasks.size(), -1);
    for (std::size_t i = 0; i < req_.tasks.size(); ++i) {
      if (!req_.tasks[i].core) continue;
      p.core[i] = *req_.tasks[i].core;
      p.why = core_problem(p.core[i], core_set(p.core[i], p.core, levels));
      if (!p.why.empty()) {
        p.why = "task " + shown_name(req_.tasks[i]) + " pinned to " + p.why;
        return p;
      }
    }
    for (const std::size_t i : free_by_size(levels)) {
      if (!place_one(i, levels, p)) return p;
    }
    p.why = floating_problem(p.core, levels);
    p.fits = p.why.empty();
    return p;
  }

  bool place_one(std::size_t i, const std::vector<int>& levels, Placement& p) const {
    std::string reasons;
    for (int c = 0; c < cores(); ++c) {
      p.core[i] = c;
      const std::string problem = core_problem(c, core_set(c, p.core, levels));
      if (problem.empty()) return true;
      reasons += (reasons.empty() ? "" : "; ") + problem;
    }
    p.core[i] = -1;
    p.why = "task " + shown_name(req_.tasks[i]) + " fits on no core: " + reasons;
    return false;
  }

  std::vector<std::size_t> free_by_size(const std::vector<int>& levels) const {
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < req_.tasks.size(); ++i) {
      if (!req_.tasks[i].core) order.push_back(i);
    }
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return task_utilisation(a, levels[a]) > task_utilisation(b, levels[b]);
    });
    return order;
  }

  double task_utilisation(std::size_t i, int level) const {
    const AnalysisTask row = analysis_task(req_.tasks[i], level, 0);
    return utilisation(std::span(&row, 1), req_.analysis);
  }

  // Best effort without a core needs room below the limit somewhere.
  std::string floating_problem(const std::vector<int>& placed,
                               const std::vector<int>& levels) const {
    double room = 0;
    for (int c = 0; c < cores(); ++c) {
      const double u = utilisation(core_set(c, placed, levels).rows, req_.analysis);
      room += std::max(0.0, req_.core_limit - u - pinned_load_[static_cast<std::size_t>(c)]);
    }
    if (floating_load_ <= room) return {};
    return "best-effort load without a core is " + format("%.3f", floating_load_) +
           " of a core, but only " + format("%.3f", room) + " is left below " +
           format("%.2f", req_.core_limit) + " on " + std::to_string(cores()) + " core(s)";
  }

  // ---- levels ----
  bool can_lower(std::size_t i, const std::vector<int>& levels) const {
    return levels[i] + 1 < req_.tasks[i].levels();
  }

  // The task to lower next, or none.
  std::optional<std::size_t> next_to_lower(const std::vector<int>& levels,
                                           std::size_t& entry) const {
    if (!req_.degrade_order.empty()) {
      while (entry < req_.degrade_order.size()) {
        const std::string& name = req_.degrade_order[entry++];
        for (std::size_t i = 0; i < req_.tasks.size(); ++i) {
          if (req_.tasks[i].name == name && can_lower(i, levels)) return i;
        }
      }
      return std::nullopt;
    }
    std::optional<std::size_t> best;
    for (std::size_t i = 0; i < req_.tasks.size(); ++i) {
      if (!can_lower(i, levels)) continue;
      if (!best || cheaper(i, *best, levels)) best = i;
    }
    return best;
  }

  bool cheaper(std::size_t a, std::size_t b, const std::vector<int>& levels) const {
    const double ua = task_utilisation(a, levels[a]), ub = task_utilisation(b, levels[b]);
    if (ua != ub) return ua > ub;
    return req_.tasks[a].task_class == TaskClass::kFirm &&
           req_.tasks[b].task_class == TaskClass::kHard;
  }

  std::vector<std::size_t> lower_until_it_fits(std::vector<int>& levels) const {
    std::vector<std::size_t> lowered;
    std::size_t entry = 0;
    while (!place(levels).fits) {
      const std::optional<std::size_t> task = next_to_lower(levels, entry);
      if (!task) break;
      ++levels[*task];
      lowered.push_back(*task);
    }
    return lowered;
  }

  // A later step may have made an earlier one unnecessary.
  std::vector<std::size_t> take_back(std::vector<int>& levels,
                                     std::vector<std::size_t> lowered) const {
    for (std::size_t s = lowered.size(); s-- > 0;) {
      const std::size_t task = lowered[s];
      --levels[task];
      if (place(levels).fits)
        lowered.erase(lowered.begin() + static_cast<std::ptrdiff_t>(s));
      else
        ++levels[task];
    }
    return lowered;
  }

  // ---- the answer ----
  Admission describe(const std::vector<int>& levels, const std::vector<std::size_t>& lowered,
                     bool fits) const {
    Admission a;
    const Placement p = place(levels);
    a.admitted = fits && p.fits;
    a.floating_best_effort = floating_load_;
    a.core_limit = req_.core_limit;
    describe_steps(lowered, a);
    if (!a.admitted) {
      a.refusal = p.why;
      if (!lowered.empty()) a.refusal += " (even after lowering: " + last_variants(levels) + ")";
    }
    for (std::size_t i = 0; i < req_.tasks.size(); ++i) a.tasks.push_back(task_row(i, levels, p));
    for (int c = 0; c < cores(); ++c) describe_core(c, levels, p, a);
    finish_growth(a);
    return a;
  }

  // Replays the lowering, so that each reason speaks of the set as it was before that step.
  void describe_steps(const std::vector<std::size_t>& lowered, Admission& a) const {
    std::vector<int> levels(req_.tasks.size(), 0);
    for (const std::size_t i : lowered) {
      const TaskSpec& spec = req_.tasks[i];
      std::string why = place(levels).why;
      if (why.empty()) why = "needed together with the other steps";
      const int from = levels[i]++;
      const bool is_static =
          !spec.variants.empty() && spec.variants[static_cast<std::size_t>(from) + 1].is_static;
      a.steps.push_back(
          spec.name + ": " + variant_name(spec, from) + " (" + milliseconds(spec.budget_of(from)) +
          ") -> " + variant_name(spec, from + 1) + " (" + milliseconds(spec.budget_of(from + 1)) +
          ", " + (is_static ? "static" : "dynamic") + " knob), because " + why);
    }
  }

  std::string last_variants(const std::vector<int>& levels) const {
    std::string text;
    for (std::size_t i = 0; i < levels.size(); ++i) {
      if (levels[i] == 0) continue;
      text += (text.empty() ? "" : ", ") + req_.tasks[i].name + " to " +
              variant_name(req_.tasks[i], levels[i]);
    }
    return text;
  }

  AdmittedTask task_row(std::size_t i, const std::vector<int>& levels, const Placement& p) const {
    const TaskSpec& spec = req_.tasks[i];
    AdmittedTask row = common_row(spec, levels[i]);
    row.core = p.core[i];
    row.cpu = row.core < 0 ? -1 : cpu(row.core);
    row.rank = ranks_[i];
    row.priority = kTopTaskPriority - ranks_[i];
    row.last_level = last_dynamic_level(spec, levels[i]);
    if (!spec.variants.empty()) row.variant = variant_name(spec, levels[i]);
    return row;
  }

  AdmittedTask common_row(const TaskSpec& spec, int level) const {
    AdmittedTask row;
    const AnalysisTask t = analysis_task(spec, level, 0);
    row.name = spec.name;
    row.box = spec.box;
    row.level = level;
    row.C = t.C;
    row.T = t.T;
    row.D = t.D;
    row.J = t.J;
    row.B = t.B;
    row.R = kUnbounded;
    row.slack = Nanos::min();
    row.utilisation = utilisation(std::span(&t, 1), req_.analysis);
    return row;
  }

  void describe_core(int c, const std::vector<int>& levels, const Placement& p,
                     Admission& a) const {
    const CoreSet set = core_set(c, p.core, levels);
    const CoreAnalysis analysis = analyse(set.rows, req_.analysis);
    AdmittedCore core;
    core.cpu = cpu(c);
    core.utilisation = analysis.utilisation;
    core.best_effort = pinned_load_[static_cast<std::size_t>(c)];
    core.liu_layland = analysis.liu_layland;
    core.hyperbolic = analysis.hyperbolic;
    core.schedulable =
        analysis.schedulable && core.utilisation + core.best_effort <= req_.core_limit;
    core.growth = set.rows.empty()
                      ? std::numeric_limits<double>::infinity()
                      : growth_factor(set.rows, req_.core_limit - core.best_effort, req_.analysis);
    a.cores.push_back(core);
    for (std::size_t r = 0; r < set.tasks.size(); ++r) {
      a.tasks[set.tasks[r]].R = analysis.tasks[set.platform_rows + r].R;
      a.tasks[set.tasks[r]].slack = analysis.tasks[set.platform_rows + r].slack;
    }
    std::size_t r = 0;
    for (const PlatformTask& platform : req_.platform) {
      const bool here = platform.spec.core ? *platform.spec.core == c : !set.tasks.empty();
      if (!here) continue;
      AdmittedTask row = common_row(platform.spec, 0);
      row.name.append("@").append(std::to_string(core.cpu));
      row.core = c;
      row.cpu = core.cpu;
      row.rank = -1;
      row.priority = platform.priority;
      row.R = analysis.tasks[r].R;
      row.slack = analysis.tasks[r].slack;
      a.platform.push_back(row);
      ++r;
    }
  }

  // All budgets of the host grow together; best effort without a core takes its room first.
  void finish_growth(Admission& a) const {
    a.growth = std::numeric_limits<double>::infinity();
    double budgets = 0, fixed = 0;
    for (const AdmittedCore& core : a.cores) a.growth = std::min(a.growth, core.growth);
    const auto add = [&](const AdmittedTask& t) {
      const double u = static_cast<double>(t.C.count()) / static_cast<double>(t.T.count());
      budgets += u;
      fixed += t.utilisation - u;
    };
    for (const AdmittedTask& t : a.tasks) add(t);
    for (const AdmittedTask& t : a.platform) add(t);
    for (const double load : pinned_load_) fixed += load;
    if (floating_load_ <= 0 || budgets <= 0) return;
    const double room = req_.core_limit * cores() - fixed - floating_load_;
    a.growth = std::min(a.growth, std::max(0.0, room / budgets));
  }

  int cores() const { return static_cast<int>(req_.cpus.size()); }
  int cpu(int core) const { return req_.cpus[static_cast<std::size_t>(core)]; }

  const AdmissionRequest& req_;
  std::vector<int> ranks_;
  std::vector<double> pinned_load_;
  double floating_load_ = 0;
};

}  // namespace

Admission admit(const AdmissionRequest& request) {
  const std::string problem = problem_of(request);
  if (!problem.empty()) {
    Admission refused;
    refused.refusal = problem;
    return refused;
  }
  return Admitter(request).run();
}

}  // namespace rt

#include <algorithm>
#include <limits>
#include <optional>

#include "rt/sched/host_rows.hpp"

namespace rt {
namespace {

using detail::CoreSet;
using detail::Coupling;
using detail::format;
using detail::milliseconds;
using detail::shown_name;

std::string variant_name(const TaskSpec& spec, int level) {
  if (spec.variants.empty()) return "level 0";
  const Variant& v = spec.variants[static_cast<std::size_t>(level)];
  return v.name.empty() ? "level " + std::to_string(level) : v.name;
}

struct Placement {
  std::vector<int> core;  // per task; -1: nowhere
  bool fits = false;
  std::string why;  // what does not fit, with figures
};

class Admitter : private detail::HostRows {
 public:
  using HostRows::HostRows;

  Admission run() {
    std::vector<int> levels(req_.tasks.size(), 0);
    std::vector<std::size_t> lowered = lower_until_it_fits(levels);
    const bool fits = place(levels).fits;
    if (fits) lowered = take_back(levels, lowered);
    return describe(levels, lowered, fits);
  }

 private:
  // ---- placing ----
  // First-fit decreasing at these levels.
  Placement place(const std::vector<int>& levels) const {
    Placement p;
    p.core.assign(req_.tasks.size(), -1);
    for (std::size_t i = 0; i < req_.tasks.size(); ++i) {
      if (!req_.tasks[i].core) continue;
      p.core[i] = *req_.tasks[i].core;
      p.why = problem_after(i, p.core, levels);
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
      const std::string problem = problem_after(i, p.core, levels);
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
      return task_utilisation(a, level_of(a, levels)) > task_utilisation(b, level_of(b, levels));
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
    const Coupling k = couple(placed, levels);
    for (int c = 0; c < cores(); ++c) {
      const double u = utilisation(core_set(c, placed, levels, k).rows, req_.analysis);
      room += std::max(0.0, req_.core_limit - u - pinned_load_[static_cast<std::size_t>(c)]);
    }
    if (floating_load_ <= room) return {};
    return "best-effort load without a core is " + format("%.3f", floating_load_) +
           " of a core, but only " + format("%.3f", room) + " is left below " +
           format("%.2f", req_.core_limit) + " on " + std::to_string(cores()) + " core(s)";
  }

  // ---- levels ----
  bool can_lower(std::size_t i, const std::vector<int>& levels) const {
    return parent_[i] < 0 && levels[i] + 1 < req_.tasks[i].levels();
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
    const Coupling k = couple(p.core, levels);
    for (std::size_t i = 0; i < req_.tasks.size(); ++i)
      a.tasks.push_back(task_row(i, levels, p, k));
    for (int c = 0; c < cores(); ++c) describe_core(c, levels, p, k, a);
    if (has_workers_ && a.admitted) {
      const double together = joint_growth(levels, p);
      for (AdmittedCore& core : a.cores) core.growth = std::min(core.growth, together);
    }
    finish_growth(a);
    a.spare = -a.floating_best_effort;
    for (const AdmittedCore& core : a.cores)
      a.spare += std::max(0.0, a.core_limit - core.utilisation - core.best_effort);
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
      a.steps.push_back(spec.name + ": " + variant_name(spec, from) + " (" +
                        milliseconds(spec.budget_of(from)) + ") -> " +
                        variant_name(spec, from + 1) + " (" +
                        milliseconds(spec.budget_of(from + 1)) + "), because " + why);
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

  AdmittedTask task_row(std::size_t i, const std::vector<int>& levels, const Placement& p,
                        const Coupling& k) const {
    const TaskSpec& spec = req_.tasks[i];
    const int level = level_of(i, levels);
    AdmittedTask row = common_row(spec, level, row_of(i, levels, k));
    row.core = p.core[i];
    row.cpu = row.core < 0 ? -1 : cpu(row.core);
    row.rank = ranks_[i];
    row.priority = kTopTaskPriority - ranks_[i];
    row.last_level = spec.levels() - 1;
    row.choice = spec.choice;
    row.parent = spec.parent;
    row.join_wait = k.wait[i];
    if (!spec.variants.empty()) row.variant = variant_name(spec, level);
    return row;
  }

  AdmittedTask common_row(const TaskSpec& spec, int level, const AnalysisTask& t) const {
    AdmittedTask row;
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

  void describe_core(int c, const std::vector<int>& levels, const Placement& p, const Coupling& k,
                     Admission& a) const {
    const CoreSet set = core_set(c, p.core, levels, k);
    const CoreAnalysis analysis = analyse(set.rows, req_.analysis);
    AdmittedCore core;
    core.cpu = cpu(c);
    core.utilisation = analysis.utilisation;
    core.best_effort = pinned_load_[static_cast<std::size_t>(c)];
    core.liu_layland = analysis.liu_layland;
    core.hyperbolic = analysis.hyperbolic;
    core.schedulable =
        analysis.schedulable && core.utilisation + core.best_effort <= req_.core_limit;
    core.growth = set.rows.empty() || has_workers_
                      ? std::numeric_limits<double>::infinity()
                      : growth_factor(set.rows, req_.core_limit - core.best_effort, req_.analysis);
    a.cores.push_back(core);
    for (std::size_t r = 0; r < set.tasks.size(); ++r) {
      a.tasks[set.tasks[r]].R = analysis.tasks[set.platform_rows + r].R;
      a.tasks[set.tasks[r]].slack = analysis.tasks[set.platform_rows + r].slack;
    }
    std::size_t r = 0;
    for (const PlatformTask& platform : platform_on(c, p.core)) {
      AdmittedTask row = common_row(platform.spec, 0, analysis_task(platform.spec, 0, 0));
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

  // Where cores are tied together by fork and join, a core's rows do not say what happens when all
  // budgets grow: the whole placement is analysed again with grown ones.
  double joint_growth(const std::vector<int>& levels, const Placement& p) const {
    constexpr std::int64_t kUnit = 10'000;
    const auto fits = [&](std::int64_t n) {
      AdmissionRequest grown = req_;
      const auto grow = [n](Nanos& d) { d = Nanos{(d.count() * n + kUnit - 1) / kUnit}; };
      for (TaskSpec& t : grown.tasks) {
        grow(t.budget);
        grow(t.spin_lead);
        for (Variant& v : t.variants) {
          grow(v.budget);
          grow(v.until_last_fork);
          v.overlap = Nanos{v.overlap.count() * n / kUnit};
        }
      }
      for (PlatformTask& t : grown.platform) grow(t.spec.budget);
      const HostRows again(grown);
      const Coupling k = again.couple(p.core, levels);
      bool ok = k.problem.empty();
      for (int c = 0; ok && c < cores(); ++c)
        ok = again.core_problem(c, again.core_set(c, p.core, levels, k)).empty();
      return ok;
    };
    std::int64_t lo = kUnit, hi = 2 * kUnit;
    while (hi < 1000 * kUnit && fits(hi)) {
      lo = hi;
      hi *= 2;
    }
    while (hi - lo > 1) {
      const std::int64_t mid = lo + (hi - lo) / 2;
      (fits(mid) ? lo : hi) = mid;
    }
    return static_cast<double>(lo) / static_cast<double>(kUnit);
  }
};

}  // namespace

namespace detail {

Admission admit_levels(const AdmissionRequest& settled) { return Admitter(settled).run(); }

}  // namespace detail
}  // namespace rt

#include "rt/sched/host_rows.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

namespace rt::detail {

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

HostRows::HostRows(const AdmissionRequest& request)
    : req_(request), ranks_(rate_monotonic_ranks(request.tasks)) {
  pinned_load_.assign(req_.cpus.size(), 0.0);
  for (const BestEffortLoad& load : req_.best_effort) {
    if (load.core)
      pinned_load_[static_cast<std::size_t>(*load.core)] += load.share;
    else
      floating_load_ += load.share;
  }
  parent_.assign(req_.tasks.size(), -1);
  for (std::size_t i = 0; i < req_.tasks.size(); ++i) {
    for (std::size_t p = 0; p < req_.tasks.size() && req_.tasks[i].is_worker(); ++p) {
      if (req_.tasks[p].name == req_.tasks[i].parent && req_.tasks[p].box == req_.tasks[i].box)
        parent_[i] = static_cast<int>(p);
    }
    has_workers_ = has_workers_ || parent_[i] >= 0;
  }
}

// A worker's level is its parent's.
int HostRows::level_of(std::size_t i, const std::vector<int>& levels) const {
  return levels[parent_[i] < 0 ? i : static_cast<std::size_t>(parent_[i])];
}
int HostRows::forks_of(std::size_t i) const {
  return req_.tasks[parent_[i] < 0 ? i : static_cast<std::size_t>(parent_[i])].forks;
}
AnalysisTask HostRows::row_of(std::size_t i, const std::vector<int>& levels,
                              const Coupling& k) const {
  AnalysisTask row = analysis_task(req_.tasks[i], level_of(i, levels), ranks_[i]);
  if (!has_workers_) return row;
  row.C += k.wait[i];
  if (parent_[i] < 0) return row;
  row.J = std::max(row.J, k.fork[i]);
  row.C += (forks_of(i) - 1) * 2 * req_.analysis.switch_cost;  // it is woken at each fork
  return row;
}

namespace {

// Is every release of `slow` an instant of `fast` too? Rates are exact fractions and release k is
// rounded the same way in both, so a whole multiple on the same offset is enough.
bool covers(const TaskSpec& fast, const TaskSpec& slow) {
  return fast.offset == slow.offset &&
         (fast.rate.num * slow.rate.den) % (fast.rate.den * slow.rate.num) == 0;
}

// The tasks at whose releases the sentinel of a core wakes up: all instants, each once.
std::vector<const TaskSpec*> wake_ups(const std::vector<const TaskSpec*>& there) {
  std::vector<const TaskSpec*> kept;
  for (std::size_t i = 0; i < there.size(); ++i) {
    bool covered = false;
    for (std::size_t j = 0; j < there.size() && !covered; ++j) {
      covered = j != i && covers(*there[j], *there[i]) && (j < i || !covers(*there[i], *there[j]));
    }
    if (!covered) kept.push_back(there[i]);
  }
  return kept;
}

}  // namespace

std::vector<PlatformTask> HostRows::platform_on(int core, const std::vector<int>& placed) const {
  std::vector<PlatformTask> out;
  const bool used = std::find(placed.begin(), placed.end(), core) != placed.end();
  for (const PlatformTask& p : req_.platform) {
    std::vector<const TaskSpec*> there;  // of its box, on this core
    int last_cpu = -1;                   // of its box
    for (std::size_t i = 0; i < placed.size(); ++i) {
      if (placed[i] < 0 || req_.tasks[i].box != p.spec.box) continue;
      last_cpu = std::max(last_cpu, cpu(placed[i]));
      if (placed[i] == core) there.push_back(&req_.tasks[i]);
    }
    switch (p.wakes) {
      case PlatformWakes::kItself:
        if (p.spec.core ? *p.spec.core == core : used) out.push_back(p);
        break;
      case PlatformWakes::kAtReleases:
        for (const TaskSpec* t : wake_ups(there)) {
          out.push_back(p);
          out.back().spec.rate = t->rate;
        }
        break;
      case PlatformWakes::kOnceABox:
        if (cpu(core) == last_cpu) out.push_back(p);
        break;
    }
  }
  return out;
}

CoreSet HostRows::core_set(int core, const std::vector<int>& placed, const std::vector<int>& levels,
                           const Coupling& k) const {
  CoreSet set;
  for (const PlatformTask& p : platform_on(core, placed)) {
    set.rows.push_back(analysis_task(p.spec, 0, -p.priority));
    set.names.push_back(shown_name(p.spec));
  }
  set.platform_rows = set.rows.size();
  for (std::size_t i = 0; i < placed.size(); ++i) {
    if (placed[i] != core) continue;
    set.rows.push_back(row_of(i, levels, k));
    set.names.push_back(shown_name(req_.tasks[i]));
    set.tasks.push_back(i);
  }
  return set;
}

// ---- fork and join
// Both figures only grow from one round to the next, so this ends: at the least fixed point, or
// where a parent's wait alone is beyond its period.
Coupling HostRows::couple(const std::vector<int>& placed, const std::vector<int>& levels) const {
  Coupling k{std::vector<Nanos>(req_.tasks.size(), Nanos{0}),
             std::vector<Nanos>(req_.tasks.size(), Nanos{0}),
             {}};
  for (bool changed = has_workers_; changed && k.problem.empty();) {
    changed = false;
    for (std::size_t p = 0; p < req_.tasks.size(); ++p) {
      if (req_.tasks[p].forks > 0 && placed[p] >= 0) couple_one(p, placed, levels, k, changed);
    }
  }
  return k;
}

void HostRows::couple_one(std::size_t p, const std::vector<int>& placed,
                          const std::vector<int>& levels, Coupling& k, bool& changed) const {
  const TaskSpec& parent = req_.tasks[p];
  const Variant fork_join = worst_fork(parent, levels[p]);
  const CoreSet home = core_set(placed[p], placed, levels, k);
  // Beyond the first fork, earlier joins come before the last fork.
  const Nanos spent =
      fork_join.until_last_fork + parent.spin_lead + (parent.forks > 1 ? k.wait[p] : Nanos{0});
  const Nanos fork = latest_fork(home.rows, row_in(home, p), spent, req_.analysis);
  std::vector<WorkerJoin> joins;
  for (std::size_t w = 0; w < req_.tasks.size(); ++w) {
    if (parent_[w] != static_cast<int>(p) || placed[w] < 0) continue;
    CoreSet there = core_set(placed[w], placed, levels, k);
    const std::size_t row = row_in(there, w);
    there.rows[row] = analysis_task(req_.tasks[w], levels[p], ranks_[w]);
    joins.push_back({there.rows[row].C, join_time(there.rows, row, parent.forks, req_.analysis)});
    if (fork != kUnbounded && fork != k.fork[w]) {
      k.fork[w] = fork;
      changed = true;
    }
  }
  if (joins.empty()) return;
  Nanos wait = wait_beyond(joins, parent.forks, fork_join.overlap);
  if (fork == kUnbounded || wait == kUnbounded || wait > 2 * parent.period()) {
    k.problem = "task " + shown_name(parent) +
                ": fork and join with its workers have no bound below two periods (latest fork " +
                milliseconds(fork) + ", wait " + milliseconds(wait) + ")";
    return;
  }
  wait += parent.forks * 2 * req_.analysis.switch_cost;  // it gives up its core at each join
  if (wait != k.wait[p]) {
    k.wait[p] = wait;
    changed = true;
  }
}

// Over the levels that run-time degradation can reach.
Variant HostRows::worst_fork(const TaskSpec& spec, int level) {
  if (spec.variants.empty()) return {};
  Variant worst = spec.variants[static_cast<std::size_t>(level)];
  for (int l = level + 1; spec.policy == MissPolicy::kDegrade && l < spec.levels(); ++l) {
    const Variant& v = spec.variants[static_cast<std::size_t>(l)];
    worst.until_last_fork = std::max(worst.until_last_fork, v.until_last_fork);
    worst.overlap = std::min(worst.overlap, v.overlap);
  }
  return worst;
}

std::size_t HostRows::row_in(const CoreSet& set, std::size_t task) {
  const auto at = std::find(set.tasks.begin(), set.tasks.end(), task);
  return set.platform_rows + static_cast<std::size_t>(at - set.tasks.begin());
}

bool HostRows::one_pool(std::size_t i, std::size_t j) const {
  return parent_[i] == static_cast<int>(j) || parent_[j] == static_cast<int>(i) ||
         (parent_[i] >= 0 && parent_[i] == parent_[j]);
}

// What is wrong when task i has just been put on its core: there, or, where fork and join ties
// cores together, anywhere.
std::string HostRows::problem_after(std::size_t i, const std::vector<int>& placed,
                                    const std::vector<int>& levels) const {
  const int own = placed[i];
  for (std::size_t j = 0; has_workers_ && j < placed.size(); ++j) {
    if (j == i || placed[j] != own || !one_pool(i, j)) continue;
    return "core " + std::to_string(own) + " (cpu " + std::to_string(cpu(own)) + "): has " +
           shown_name(req_.tasks[j]) + " of the same pool";
  }
  const Coupling k = couple(placed, levels);
  if (!k.problem.empty()) return k.problem;
  if (!has_workers_) return core_problem(own, core_set(own, placed, levels, k));
  for (int c = 0; c < cores(); ++c) {
    std::string problem = core_problem(c, core_set(c, placed, levels, k));
    if (!problem.empty()) return problem;
  }
  return {};
}

// Empty if the core is fine; else the figures.
std::string HostRows::core_problem(int core, const CoreSet& set) const {
  const double load = pinned_load_[static_cast<std::size_t>(core)];
  const double u = utilisation(set.rows, req_.analysis);
  const std::string where =
      "core " + std::to_string(core) + " (cpu " + std::to_string(cpu(core)) + "): ";
  if (u + load > req_.core_limit) {
    return where + "utilisation " + format("%.4f", u + load) + " above " +
           format("%.2f", req_.core_limit) + " (real-time " + format("%.3f", u) + ", best effort " +
           format("%.3f", load) + ")";
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

}  // namespace rt::detail

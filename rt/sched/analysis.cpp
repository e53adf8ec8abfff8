#include "rt/sched/analysis.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace rt {
namespace {

__extension__ using Wide = __int128;

// Fixed-point steps of one task after which it is called unbounded; only sets at the very edge of a
// full core come near.
constexpr std::int64_t kMaxSteps = 10'000'000;
constexpr std::int64_t kGrowthUnit = 10'000;
constexpr std::int64_t kMaxGrowth = 1'000'000 * kGrowthUnit;

std::int64_t ceil_div(std::int64_t a, std::int64_t b) noexcept {
  return a <= 0 ? 0 : (a - 1) / b + 1;
}

// What the response of one task depends on: itself and everything of its rank or more important.
struct Level {
  std::int64_t C, T, D, J, B;
  std::vector<AnalysisTask> above;  // C with switch costs
};

Level level_of(std::span<const AnalysisTask> tasks, std::size_t i, const AnalysisOptions& options) {
  const Nanos switches = 2 * options.switch_cost;
  const AnalysisTask& own = tasks[i];
  Level level{
      (own.C + switches).count(), own.T.count(), own.D.count(), own.J.count(), own.B.count(), {}};
  for (std::size_t j = 0; j < tasks.size(); ++j) {
    if (j == i || tasks[j].rank > own.rank) continue;
    level.above.push_back(tasks[j]);
    level.above.back().C += switches;
  }
  return level;
}

// True only if the utilisation is certainly above 1 (each term rounded down at 2^-62).
bool surely_overloaded(const Level& level) noexcept {
  Wide sum = (static_cast<Wide>(level.C) << 62U) / level.T;
  for (const AnalysisTask& t : level.above) {
    sum += (static_cast<Wide>(t.C.count()) << 62U) / t.T.count();
  }
  return sum > (static_cast<Wide>(1) << 62U);
}

Wide demand_above(const Level& level, std::int64_t w) noexcept {
  Wide sum = 0;
  for (const AnalysisTask& t : level.above) {
    sum += static_cast<Wide>(ceil_div(w + t.J.count(), t.T.count())) * t.C.count();
  }
  return sum;
}

// `quit_late`: stop as soon as R > D is known (R is then only a lower bound).
ResponseTime solve(const Level& level, const AnalysisOptions& options, bool quit_late) {
  constexpr ResponseTime kDiverges{kUnbounded, Nanos::min(), 0, false};
  if (surely_overloaded(level)) return kDiverges;
  ResponseTime result;
  std::int64_t steps = 0;
  std::int64_t w = level.B;  // end of the last job looked at, from the start of the busy period
  for (std::int64_t q = 0;; ++q) {
    // Smallest w with w = B + (q + 1) C + demand above in w, searched upwards: the job before ended
    // at the old w, so this one can not end before w + C.
    w += level.C;
    for (;;) {
      const Wide next =
          static_cast<Wide>(level.B) + static_cast<Wide>(q + 1) * level.C + demand_above(level, w);
      if (next > options.horizon.count() || ++steps > kMaxSteps) return kDiverges;
      if (next == w) break;
      w = static_cast<std::int64_t>(next);
    }
    result.R = std::max(result.R, Nanos{w + level.J - q * level.T});
    result.jobs = q + 1;
    if (quit_late && result.R.count() > level.D) break;
    // The busy period ends here if the next job can not have arrived before w.
    if (w + level.J <= (q + 1) * level.T) break;
  }
  result.slack = Nanos{level.D} - result.R;
  result.meets = result.R.count() <= level.D;
  return result;
}

bool all_meet(std::span<const AnalysisTask> tasks, double limit, const AnalysisOptions& options) {
  if (utilisation(tasks, options) > limit) return false;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    if (!solve(level_of(tasks, i, options), options, true).meets) return false;
  }
  return true;
}

}  // namespace

double utilisation(std::span<const AnalysisTask> tasks, const AnalysisOptions& options) {
  double u = 0;
  for (const AnalysisTask& t : tasks) {
    u += static_cast<double>((t.C + 2 * options.switch_cost).count()) /
         static_cast<double>(t.T.count());
  }
  return u;
}

ResponseTime response_time(std::span<const AnalysisTask> tasks, std::size_t i,
                           const AnalysisOptions& options) {
  return solve(level_of(tasks, i, options), options, false);
}

CoreAnalysis analyse(std::span<const AnalysisTask> tasks, const AnalysisOptions& options) {
  CoreAnalysis a;
  a.utilisation = utilisation(tasks, options);
  a.schedulable = true;
  a.bounds_apply = true;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const AnalysisTask& t = tasks[i];
    a.hyperbolic *= 1.0 + static_cast<double>((t.C + 2 * options.switch_cost).count()) /
                              static_cast<double>(t.T.count());
    if (t.D < t.T || t.J.count() > 0 || t.B.count() > 0) a.bounds_apply = false;
    a.tasks.push_back(response_time(tasks, i, options));
    if (!a.tasks.back().meets) a.schedulable = false;
  }
  if (!tasks.empty()) {
    const auto n = static_cast<double>(tasks.size());
    a.liu_layland = n * (std::exp2(1.0 / n) - 1.0);
  }
  // Both bounds speak of rate-monotonic ranks only.
  for (const AnalysisTask& x : tasks) {
    for (const AnalysisTask& y : tasks) {
      if (x.rank < y.rank && x.T > y.T) a.bounds_apply = false;
    }
  }
  a.passes_liu_layland = a.bounds_apply && a.utilisation <= a.liu_layland;
  a.passes_hyperbolic = a.bounds_apply && a.hyperbolic <= 2.0;
  return a;
}

double growth_factor(std::span<const AnalysisTask> tasks, double limit,
                     const AnalysisOptions& options) {
  std::vector<AnalysisTask> grown(tasks.begin(), tasks.end());
  const auto fits = [&](std::int64_t n) {
    for (std::size_t i = 0; i < grown.size(); ++i) {
      const Wide c = (static_cast<Wide>(tasks[i].C.count()) * n + kGrowthUnit - 1) / kGrowthUnit;
      if (c > options.horizon.count()) return false;
      grown[i].C = Nanos{static_cast<std::int64_t>(c)};
    }
    return all_meet(grown, limit, options);
  };
  if (!fits(0)) return 0;
  std::int64_t lo = 0, hi = kGrowthUnit;
  while (hi < kMaxGrowth && fits(hi)) {
    lo = hi;
    hi *= 2;
  }
  constexpr std::int64_t kMost = kMaxGrowth / kGrowthUnit;
  if (hi >= kMaxGrowth) return static_cast<double>(kMost);
  while (hi - lo > 1) {
    const std::int64_t mid = lo + (hi - lo) / 2;
    (fits(mid) ? lo : hi) = mid;
  }
  return static_cast<double>(lo) / static_cast<double>(kGrowthUnit);
}

std::vector<std::size_t> rate_monotonic_order(std::span<const TaskSpec> specs) {
  std::vector<std::size_t> order(specs.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto faster = [&](std::size_t a, std::size_t b) {
    const Rate& x = specs[a].rate;
    const Rate& y = specs[b].rate;
    const Wide left = static_cast<Wide>(x.num) * y.den;
    const Wide right = static_cast<Wide>(y.num) * x.den;
    if (left != right) return left > right;
    const Nanos dx = specs[a].relative_deadline(), dy = specs[b].relative_deadline();
    return dx < dy;
  };
  std::stable_sort(order.begin(), order.end(), faster);
  return order;
}

std::vector<int> rate_monotonic_ranks(std::span<const TaskSpec> specs) {
  const std::vector<std::size_t> order = rate_monotonic_order(specs);
  std::vector<int> ranks(specs.size());
  for (std::size_t r = 0; r < order.size(); ++r) ranks[order[r]] = static_cast<int>(r);
  return ranks;
}

Nanos minimum_distance(const Rate& rate) noexcept {
  return Nanos{static_cast<std::int64_t>(static_cast<Wide>(1'000'000'000) * rate.den / rate.num)};
}

Nanos effective_deadline(const TaskSpec& spec) noexcept {
  const Nanos deadline = spec.relative_deadline();
  if (spec.policy == MissPolicy::kCatchUp) return deadline;
  return std::min(deadline, minimum_distance(spec.rate));
}

AnalysisTask analysis_task(const TaskSpec& spec, int level, int rank) noexcept {
  Nanos c = spec.budget_of(level);
  if (spec.policy == MissPolicy::kDegrade) {
    for (int l = level + 1; l < spec.levels(); ++l) c = std::max(c, spec.budget_of(l));
  }
  return {c + spec.spin_lead,
          minimum_distance(spec.rate),
          effective_deadline(spec),
          spec.jitter,
          spec.blocking,
          rank};
}

Nanos latest_fork(std::span<const AnalysisTask> tasks, std::size_t i, Nanos spent,
                  const AnalysisOptions& options) {
  const Level level = level_of(tasks, i, options);
  if (surely_overloaded(level)) return kUnbounded;
  const std::int64_t part = (spent + 2 * options.switch_cost).count();
  std::int64_t latest = 0, steps = 0;
  std::int64_t w = level.B;  // end of the job before, from the start of the busy period
  // Smallest x with x = B + q C + part + demand above in x; again with part = C for the job's end.
  const auto reach = [&](std::int64_t from, std::int64_t q, std::int64_t own) {
    std::int64_t x = from + own;
    for (;;) {
      const Wide next = static_cast<Wide>(level.B) + static_cast<Wide>(q) * level.C + own +
                        demand_above(level, x);
      if (next > options.horizon.count() || ++steps > kMaxSteps) return std::int64_t{-1};
      if (next == x) return x;
      x = static_cast<std::int64_t>(next);
    }
  };
  for (std::int64_t q = 0;; ++q) {
    const std::int64_t fork = reach(w, q, part), end = reach(w, q, level.C);
    if (fork < 0 || end < 0) return kUnbounded;
    latest = std::max(latest, fork + level.J - q * level.T);
    w = end;
    if (w + level.J <= (q + 1) * level.T) return Nanos{latest};
  }
}

Nanos join_time(std::span<const AnalysisTask> tasks, std::size_t i, int forks,
                const AnalysisOptions& options) {
  const Level level = level_of(tasks, i, options);
  const std::int64_t n = std::max(1, forks);
  const std::int64_t own = tasks[i].C.count() + n * (level.B + 2 * options.switch_cost.count());
  if (surely_overloaded(level)) return kUnbounded;
  std::int64_t w = own, steps = 0;
  for (;;) {
    Wide next = own;
    for (const AnalysisTask& t : level.above) {
      // n windows of together w: each is met by at most floor((w_i + J) / T) + 1 jobs.
      const std::int64_t jobs =
          n == 1 ? ceil_div(w + t.J.count(), t.T.count()) : (w + n * t.J.count()) / t.T.count() + n;
      next += static_cast<Wide>(jobs) * t.C.count();
    }
    if (next > options.horizon.count() || ++steps > kMaxSteps) return kUnbounded;
    if (next == w) return Nanos{w};
    w = static_cast<std::int64_t>(next);
  }
}

Nanos wait_beyond(std::span<const WorkerJoin> workers, int forks, Nanos overlap) {
  Nanos longest{0}, largest{0}, delays{0};
  for (const WorkerJoin& w : workers) {
    if (w.join == kUnbounded) return kUnbounded;
    longest = std::max(longest, w.join);
    largest = std::max(largest, w.C);
    delays += w.join - w.C;
  }
  if (forks <= 1) return std::max(Nanos{0}, longest - overlap);
  return std::max(Nanos{0}, largest - overlap) + delays;
}

}  // namespace rt

// The analysis against a simulation that shares no code with it, on 10,000 random task sets of
// integer ticks: equal worst responses without jitter, blocking and offsets (deadlines beyond the
// period included), never below the simulation with them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <numeric>

#include "rt/random.hpp"
#include "rt/sched/analysis.hpp"
#include "tests/support/reference_sim.hpp"

namespace {

using rt::AnalysisTask;
using rt::Nanos;
using support::SimConfig;
using support::SimPolicy;
using support::SimTask;
using support::Ticks;

const rt::AnalysisOptions kTicks{Nanos{0}, Nanos{1'000'000'000}};
constexpr int kSets = 10'000;
constexpr std::uint64_t kSeed = 20'240'601;

struct Set {
  std::vector<AnalysisTask> tasks;  // T, C, D in ticks; rank by position
  Ticks hyperperiod = 1;
};

// Half the sets: 2 or 3 arbitrary periods (near-primes give the long busy periods); the others: 3
// to 8 divisors of one number with many. The least common multiple stays small, so that a whole
// hyperperiod is simulated. Total utilisation at most 1 (exactly 1 occurs), deadlines up to four
// periods.
std::vector<Ticks> random_periods(rt::Random& rng) {
  constexpr std::array<Ticks, 6> kMany{2520, 4620, 7560, 9240, 10'080, 18'480};
  std::vector<Ticks> periods;
  if (rng.integer(0, 1) == 0) {
    const auto n = rng.integer(2, 3);
    for (std::int64_t i = 0; i < n; ++i) periods.push_back(rng.integer(5, 150));
  } else {
    const auto n = static_cast<std::size_t>(rng.integer(3, 8));
    const Ticks h = kMany[static_cast<std::size_t>(rng.integer(0, 5))];
    while (periods.size() < n) {
      const Ticks t = rng.integer(5, 300);
      if (h % t == 0) periods.push_back(t);
    }
  }
  std::sort(periods.begin(), periods.end());
  return periods;
}

Set random_set(rt::Random& rng) {
  for (;;) {
    Set s;
    const std::vector<Ticks> periods = random_periods(rng);
    for (const Ticks t : periods) s.hyperperiod = std::lcm(s.hyperperiod, t);
    if (s.hyperperiod > 30'000) continue;
    Ticks demand = 0;
    double left = rng.uniform(0.75, 1.05);
    for (std::size_t i = 0; i < periods.size(); ++i) {
      const Ticks t = periods[i];
      const double share = i + 1 == periods.size() ? left : left * rng.uniform(0.05, 0.6);
      left -= share;
      const Ticks c = std::max<Ticks>(1, static_cast<Ticks>(share * static_cast<double>(t) + 0.5));
      demand += c * (s.hyperperiod / t);
      const Ticks d = rng.integer(0, 2) == 0 ? t : rng.integer(c, 4 * t);
      s.tasks.push_back({Nanos{c}, Nanos{t}, Nanos{d}, Nanos{0}, Nanos{0}, static_cast<int>(i)});
    }
    if (demand <= s.hyperperiod) return s;
  }
}

// Every release is kept, however late: the model of the analysis.
SimTask sim_task(const AnalysisTask& a, int priority) {
  SimTask t;
  t.name = std::string("t").append(std::to_string(a.rank));
  t.period = a.T.count();
  t.cost = a.C.count();
  t.deadline = a.D.count();
  t.priority = priority;
  t.policy = SimPolicy::kCatchUp;
  t.catch_up_max = 1'000'000'000;
  return t;
}

TEST(AnalysisAgainstReference, EqualWorstResponsesTaskByTask) {
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random rng(kSeed, 1);
  int tasks = 0, beyond_period = 0, several_jobs = 0, full = 0, verdicts_no = 0;
  for (int n = 0; n < kSets; ++n) {
    const Set set = random_set(rng);
    SimConfig c;
    c.horizon = set.hyperperiod;  // U <= 1: all work released before it is done by then
    c.keep_jobs = false;
    for (const AnalysisTask& t : set.tasks) c.tasks.push_back(sim_task(t, 100 - t.rank));
    const auto sim = simulate(c);
    const auto analysis = rt::analyse(set.tasks, kTicks);
    for (std::size_t i = 0; i < set.tasks.size(); ++i) {
      ASSERT_EQ(sim.tasks[i].open, 0U) << "set " << n << " task " << i;
      ASSERT_EQ(analysis.tasks[i].R.count(), sim.tasks[i].worst_response)
          << "set " << n << " task " << i;
      ASSERT_EQ(analysis.tasks[i].meets, sim.tasks[i].late == 0) << "set " << n << " task " << i;
      ++tasks;
      beyond_period += analysis.tasks[i].R > set.tasks[i].T ? 1 : 0;
      several_jobs += analysis.tasks[i].jobs > 1 ? 1 : 0;
      verdicts_no += analysis.tasks[i].meets ? 0 : 1;
    }
    full += analysis.utilisation > 1.0 - 1e-12 ? 1 : 0;
    // The bounds never promise what the exact test denies.
    if (analysis.passes_liu_layland || analysis.passes_hyperbolic) {
      ASSERT_TRUE(analysis.schedulable) << "set " << n;
    }
    ASSERT_TRUE(!analysis.passes_liu_layland || analysis.passes_hyperbolic) << "set " << n;
  }
  std::printf(
      "%d sets, %d tasks: all equal; %d respond later than their period, %d need more than "
      "one job, %d miss, %d sets at U = 1\n",
      kSets, tasks, beyond_period, several_jobs, verdicts_no, full);
  EXPECT_GT(beyond_period, 100);
  EXPECT_GT(full, 10);
  EXPECT_GT(verdicts_no, 100);
}

TEST(AnalysisAgainstReference, NeverBelowWithJitterBlockingAndOffsets) {
  rt::Random rng(kSeed, 2);
  double excess = 0, largest = 0;
  int tasks = 0, equal = 0, unbounded = 0;
  for (int n = 0; n < kSets; ++n) {
    Set set = random_set(rng);
    SimConfig c;
    c.horizon = 2 * set.hyperperiod + 400;
    c.keep_jobs = false;
    Ticks below = 0;  // longest locked section of less important tasks
    for (std::size_t i = set.tasks.size(); i-- > 0;) {
      AnalysisTask& a = set.tasks[i];
      a.B = Nanos{std::max<Ticks>(0, below - 1)};  // it began at least one tick before
      if (rng.integer(0, 1) == 0) a.J = Nanos{rng.integer(0, a.T.count() + a.T.count() / 2)};
      SimTask t = sim_task(a, 100 - a.rank);
      t.offset = rng.integer(0, 1) == 0 ? 0 : rng.integer(0, a.T.count());
      t.locked = rng.integer(0, 2) == 0 ? rng.integer(0, a.C.count()) : 0;
      below = std::max(below, t.locked);
      const auto seed = rng();
      // Full jitter for the first release and none later is the worst case of the analysis; half
      // the tasks get it, the others a draw a job.
      const bool worst = rng.integer(0, 1) == 0;
      t.jitter_of = [j = a.J.count(), seed, worst](std::uint64_t k) -> Ticks {
        if (worst) return k == 0 ? j : 0;
        return static_cast<Ticks>(rt::mix64(seed, k) % static_cast<std::uint64_t>(j + 1));
      };
      c.tasks.insert(c.tasks.begin(), t);
    }
    const auto sim = simulate(c);
    const auto analysis = rt::analyse(set.tasks, kTicks);
    for (std::size_t i = 0; i < set.tasks.size(); ++i) {
      const Ticks seen = sim.tasks[i].worst_response;
      if (!analysis.tasks[i].bounded()) {
        ++unbounded;
        continue;
      }
      const Ticks bound = analysis.tasks[i].R.count();
      ASSERT_GE(bound, seen) << "set " << n << " task " << i;
      ASSERT_TRUE(!analysis.tasks[i].meets || sim.tasks[i].late == 0) << "set " << n;
      const double e = static_cast<double>(bound - seen) / static_cast<double>(bound);
      excess += e;
      largest = std::max(largest, e);
      equal += bound == seen ? 1 : 0;
      ++tasks;
    }
  }
  std::printf(
      "%d sets, %d tasks: analysis >= simulation; mean excess %.1f %% of the bound, largest "
      "%.1f %%, reached exactly %d times; %d tasks unbounded (U = 1)\n",
      kSets, tasks, 100.0 * excess / tasks, 100.0 * largest, equal, unbounded);
  EXPECT_GT(equal, tasks / 20);  // a bound that is never reached would prove nothing
  EXPECT_LT(unbounded, tasks / 10);
}

TEST(AnalysisAgainstReference, OverloadGrowsWithoutEndInBoth) {
  rt::Random rng(kSeed, 3);
  int checked = 0;
  while (checked < 300) {
    Set set = random_set(rng);
    AnalysisTask& last = set.tasks.back();
    last.C += last.T / 2;  // may push U beyond 1
    Ticks demand = 0;
    for (const AnalysisTask& t : set.tasks) demand += t.C.count() * (set.hyperperiod / t.T.count());
    if (demand <= set.hyperperiod) continue;
    ++checked;
    EXPECT_FALSE(rt::response_time(set.tasks, set.tasks.size() - 1, kTicks).bounded());
    SimConfig c;
    c.keep_jobs = false;
    for (const AnalysisTask& t : set.tasks) c.tasks.push_back(sim_task(t, 100 - t.rank));
    c.horizon = set.hyperperiod;
    const auto once = simulate(c);
    c.horizon = 2 * set.hyperperiod;
    const auto twice = simulate(c);
    EXPECT_GT(once.tasks.back().open, 0U);
    EXPECT_GE(twice.tasks.back().open, once.tasks.back().open);
  }
}

// A test that can not fail proves nothing: a wrong analysis has to be seen.
TEST(AnalysisAgainstReference, OneJobPerBusyPeriodIsNotEnough) {
  rt::Random rng(kSeed, 1);
  int differ = 0;
  for (int n = 0; n < 2000; ++n) {
    const Set set = random_set(rng);
    for (std::size_t i = 0; i < set.tasks.size(); ++i) {
      Ticks w = set.tasks[i].C.count(), before = 0;
      while (w != before && w < 1'000'000) {
        before = w;
        w = set.tasks[i].C.count();
        for (std::size_t j = 0; j < i; ++j) {
          w += (before + set.tasks[j].T.count() - 1) / set.tasks[j].T.count() *
               set.tasks[j].C.count();
        }
      }
      differ += w != rt::response_time(set.tasks, i, kTicks).R.count() ? 1 : 0;
    }
  }
  EXPECT_GT(differ, 20);
}

}  // namespace

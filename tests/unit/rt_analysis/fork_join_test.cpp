// Pool workers in the admission, against the reference simulator: what a fork-join job really does
// on two or three cores (a chain of pieces, each arriving when what it waits for has ended) never
// takes longer than the admission says, for the parent, its workers and every task beside them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>

#include "rt/random.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/mode_table.hpp"
#include "rt/sched/registry.hpp"
#include "tests/support/reference_sim.hpp"

namespace {

using rt::Nanos;
using rt::TaskSpec;
using support::SimConfig;
using support::SimTask;
using support::Ticks;
using testing::HasSubstr;

TaskSpec periodic(std::string name, Ticks period, Ticks budget, int core) {
  TaskSpec s;
  s.name = std::move(name);
  s.rate = {1'000'000'000, period};
  s.budget = Nanos{budget};
  s.core = core;
  return s;
}

// One job of the parent: pre[0] fork par[0] join pre[1] fork ... par[n-1] join tail. piece[w][s] is
// what worker w does at fork s.
struct Job {
  std::vector<Ticks> pre, par;
  std::vector<std::vector<Ticks>> piece;
  Ticks tail = 0;
};

struct Case {
  rt::AdmissionRequest request;  // row 0 is the parent, rows 1.. its workers, then the others
  Job job;
  std::size_t workers = 1;
};

Case random_case(rt::Random& rng) {
  constexpr std::array<Ticks, 8> kPeriods{200, 300, 400, 600, 840, 1200, 1800, 2400};
  Case c;
  c.workers = static_cast<std::size_t>(rng.integer(1, 2));
  const auto forks = static_cast<std::size_t>(rng.integer(1, 3));
  const Ticks period = kPeriods[static_cast<std::size_t>(rng.integer(2, 6))];
  const auto part = [&](double share) {
    return std::max<Ticks>(
        1, static_cast<Ticks>(static_cast<double>(period) * share * rng.uniform(0.2, 1.0) /
                              static_cast<double>(forks)));
  };
  c.job.piece.resize(c.workers);
  Ticks own = 0, until = 0, most = 0, overlap = 0;
  for (std::size_t s = 0; s < forks; ++s) {
    c.job.pre.push_back(part(0.1));
    c.job.par.push_back(part(0.25));
    Ticks largest = 0;
    for (auto& w : c.job.piece) {
      w.push_back(part(0.25));
      largest = std::max(largest, w.back());
    }
    until = own + c.job.pre[s];
    own = until + c.job.par[s];
    most += largest;
    overlap += std::min(c.job.par[s], largest);
  }
  c.job.tail = part(0.1);
  own += c.job.tail;
  auto& r = c.request;
  r.cpus = {0, 1, 2};
  r.cpus.resize(c.workers + 1);
  r.core_limit = 1.0;
  r.analysis.switch_cost = Nanos{0};
  r.tasks.push_back(periodic("parent", period, own, 0));
  r.tasks[0].forks = static_cast<int>(forks);
  r.tasks[0].variants = {{"", Nanos{own}, Nanos{until}, Nanos{overlap}}};
  for (std::size_t w = 0; w < c.workers; ++w) {
    r.tasks.push_back(
        periodic("worker" + std::to_string(w), period, most, static_cast<int>(w) + 1));
    r.tasks.back().parent = "parent";
    r.tasks.back().variants = {{"", Nanos{most}}};
  }
  const auto others = rng.integer(1, 5);
  for (std::int64_t i = 0; i < others; ++i) {
    const Ticks t = kPeriods[static_cast<std::size_t>(rng.integer(0, 7))];
    const auto budget = static_cast<Ticks>(static_cast<double>(t) * rng.uniform(0.03, 0.3));
    r.tasks.push_back(periodic("other" + std::to_string(i), t, budget,
                               static_cast<int>(rng.integer(0, static_cast<int>(c.workers)))));
    r.tasks.back().offset = Nanos{rng.integer(0, 1) == 0 ? 0 : rng.integer(0, t)};
  }
  return c;
}

SimTask piece(const std::string& name, Ticks period, Ticks cost, int core, int priority) {
  SimTask t;
  t.name = name;
  t.period = period;
  t.deadline = 100 * period;
  t.cost = cost;
  t.core = core;
  t.priority = priority;
  t.policy = support::SimPolicy::kCatchUp;
  t.catch_up_max = 1'000'000;
  return t;
}

struct Seen {
  Ticks parent = 0, last_fork = 0;
  std::vector<Ticks> worker, other;  // worst responses from the nominal release
  bool settled = false;
};

// Arrivals are found by running again until none of them moves: each piece waits for pieces before
// it only.
Seen run(const Case& c, const rt::Admission& a) {
  const std::size_t forks = c.job.pre.size();
  const Ticks period = c.request.tasks[0].period().count();
  const auto jobs = static_cast<std::size_t>(12'000 / period);
  SimConfig sim;
  sim.cores = static_cast<int>(c.workers) + 1;
  sim.horizon = static_cast<Ticks>(jobs) * period;
  using Arrivals = std::vector<Ticks>;
  std::vector<Arrivals> after;  // by piece of the pool: delay from the nominal release
  const auto add = [&](Ticks cost, std::size_t row, int step) {
    sim.tasks.push_back(piece("p" + std::to_string(sim.tasks.size()), period, cost,
                              a.tasks[row].core, a.tasks[row].priority * 100 - step));
    after.emplace_back(jobs + 2, 0);
    return sim.tasks.size() - 1;
  };
  std::vector<std::size_t> pre, par;
  std::vector<std::vector<std::size_t>> work(c.workers);
  for (std::size_t s = 0; s < forks; ++s) {
    pre.push_back(add(c.job.pre[s], 0, static_cast<int>(3 * s)));
    par.push_back(add(c.job.par[s], 0, static_cast<int>(3 * s + 1)));
    for (std::size_t w = 0; w < c.workers; ++w)
      work[w].push_back(add(c.job.piece[w][s], 1 + w, static_cast<int>(s)));
  }
  const std::size_t tail = add(c.job.tail, 0, static_cast<int>(3 * forks));
  for (std::size_t i = 0; i < sim.tasks.size(); ++i)
    sim.tasks[i].jitter_of = [&after, i](std::uint64_t k) { return after[i][k]; };
  const std::size_t first_other = sim.tasks.size();
  for (std::size_t i = 1 + c.workers; i < c.request.tasks.size(); ++i) {
    const auto& t = c.request.tasks[i];
    sim.tasks.push_back(piece(t.name, t.period().count(), t.budget.count(), a.tasks[i].core,
                              a.tasks[i].priority * 100));
    sim.tasks.back().offset = t.offset.count();
  }
  Seen seen;
  support::SimResult result;
  for (int round = 0; round < 20 && !seen.settled; ++round) {
    result = simulate(sim);
    const auto end_of = [&](std::size_t p, std::size_t k) {
      const auto& done = result.tasks[p].jobs;
      return k < done.size() && done[k].end >= 0 ? done[k].end - done[k].release : Ticks{0};
    };
    const std::vector<Arrivals> before = after;
    for (std::size_t k = 0; k < jobs; ++k) {
      for (std::size_t s = 0; s < forks; ++s) {
        const Ticks fork = end_of(pre[s], k);
        after[par[s]][k] = fork;
        Ticks join = end_of(par[s], k);
        for (std::size_t w = 0; w < c.workers; ++w) {
          after[work[w][s]][k] = fork;
          join = std::max(join, end_of(work[w][s], k));
        }
        after[s + 1 < forks ? pre[s + 1] : tail][k] = join;
      }
    }
    seen.settled = before == after;
  }
  seen.parent = result.tasks[tail].worst_response;
  for (std::size_t k = 0; k < jobs; ++k)
    seen.last_fork = std::max(seen.last_fork, after[par[forks - 1]][k]);
  for (std::size_t w = 0; w < c.workers; ++w)
    seen.worker.push_back(result.tasks[work[w][forks - 1]].worst_response);
  for (std::size_t i = first_other; i < sim.tasks.size(); ++i)
    seen.other.push_back(result.tasks[i].worst_response);
  return seen;
}

TEST(ForkJoin, NeverSlowerThanAdmitted) {
  constexpr std::uint64_t kSeed = 20'261'120;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random rng(kSeed);
  int sets = 0, exact = 0, several = 0, late_without_wait = 0;
  double excess = 0;
  for (int n = 0; n < 3000; ++n) {
    Case c = random_case(rng);
    const auto a = rt::admit(c.request);
    if (!a.admitted) continue;
    // Half the runs do less than the budgets.
    if (rng.integer(0, 1) == 0) {
      const auto less = [&](Ticks& t) { t = rng.integer(1, t); };
      for (auto& t : c.job.pre) less(t);
      for (auto& t : c.job.par) less(t);
      for (auto& w : c.job.piece) {
        for (auto& t : w) less(t);
      }
    }
    const Seen seen = run(c, a);
    ASSERT_TRUE(seen.settled) << "set " << n;
    const auto& parent = a.tasks[0];
    ASSERT_LE(seen.parent, parent.R.count()) << "set " << n;
    for (std::size_t w = 0; w < c.workers; ++w) {
      ASSERT_LE(seen.last_fork, a.tasks[1 + w].J.count()) << "set " << n;
      ASSERT_LE(seen.worker[w], a.tasks[1 + w].R.count()) << "set " << n;
    }
    for (std::size_t i = 0; i < seen.other.size(); ++i)
      ASSERT_LE(seen.other[i], a.tasks[1 + c.workers + i].R.count()) << "set " << n << " " << i;
    ++sets;
    several += c.job.pre.size() > 1 ? 1 : 0;
    exact += seen.parent == parent.R.count() ? 1 : 0;
    excess +=
        static_cast<double>(parent.R.count() - seen.parent) / static_cast<double>(parent.R.count());
    // Without the wait in its execution the answer would be wrong, and this test would see it.
    late_without_wait += seen.parent > (parent.R - parent.join_wait).count() ? 1 : 0;
  }
  std::printf(
      "%d admitted sets (%d with several forks): simulation <= admission; parent's mean excess "
      "%.1f %%, reached exactly %d times; %d would be too late without the join wait\n",
      sets, several, 100.0 * excess / sets, exact, late_without_wait);
  EXPECT_GT(sets, 800);
  EXPECT_GT(several, 200);
  EXPECT_GT(exact, 20);
  EXPECT_GT(late_without_wait, 100);
}

// By hand, one fork, no switch cost. Core 0: high (T 10, C 2), parent (T 40: 3 before the fork, 4
// beside the worker, 2 after). Core 1: busy (T 8, C 1), worker (C 6), low (T 80, C 5).
//   latest fork   w = 3 + ceil(w/10) 2 = 5
//   join          w = 6 + ceil(w/8) 1 = 7;  wait = 7 - 4 = 3;  C of the parent = 9 + 3 = 12
//   R parent      w = 12 + ceil(w/10) 2 = 16
//   R worker      5 + 7 = 12
//   R low         w = 5 + ceil(w/8) + ceil((w + 5)/40) 6 = 13
TEST(ForkJoin, WorkedOutByHand) {
  rt::AdmissionRequest r;
  r.cpus = {0, 1};
  r.core_limit = 1;
  r.analysis.switch_cost = Nanos{0};
  r.tasks = {periodic("high", 10, 2, 0), periodic("parent", 40, 9, 0), periodic("busy", 8, 1, 1),
             periodic("worker", 40, 6, 1), periodic("low", 80, 5, 1)};
  r.tasks[1].forks = 1;
  r.tasks[1].variants = {{"", Nanos{9}, Nanos{3}, Nanos{4}}};
  r.tasks[3].variants = {{"", Nanos{6}}};
  r.tasks[3].parent = "parent";
  const auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted) << a.refusal;
  EXPECT_EQ(a.tasks[3].J.count(), 5);
  EXPECT_EQ(a.tasks[1].join_wait.count(), 3);
  EXPECT_EQ(a.tasks[1].C.count(), 12);
  EXPECT_EQ(a.tasks[1].R.count(), 16);
  EXPECT_EQ(a.tasks[3].R.count(), 12);
  EXPECT_EQ(a.tasks[4].R.count(), 13);
  const std::string table = rt::report_table(a);
  EXPECT_THAT(table, HasSubstr("worker of parent"));
  EXPECT_THAT(table, HasSubstr("waits"));
  // The registry holds both sides to what they were computed with; the rest keeps its slack.
  const auto rows = rt::registry_entries(r, a);
  ASSERT_EQ(rows.size(), 5U);
  EXPECT_EQ(rows[1].D.count(), 16);
  EXPECT_EQ(rows[3].D.count(), 12);
  EXPECT_EQ(rows[3].J.count(), 5);
  EXPECT_EQ(rows[4].D.count(), 80);
}

// Free tasks: a worker is placed on another core than its parent and its siblings.
TEST(ForkJoin, WorkersFindCoresOfTheirOwn) {
  rt::AdmissionRequest r;
  r.cpus = {4, 5, 6};
  TaskSpec parent = periodic("fusion", 33'000'000, 12'000'000, 0);
  parent.core.reset();
  parent.forks = 4;
  parent.choices = {
      {"10 mm", {{"full", Nanos{40'000'000}, Nanos{30'000'000}, Nanos{8'000'000}}}, {}},
      {"20 mm",
       {{"full", Nanos{14'000'000}, Nanos{9'000'000}, Nanos{6'000'000}},
        {"step2", Nanos{8'000'000}, Nanos{5'000'000}, Nanos{3'000'000}}},
       {}}};
  TaskSpec worker = parent;
  worker.forks = 0;
  worker.parent = "fusion";
  worker.choices = {{"10 mm", {{"full", Nanos{9'000'000}}}, {}},
                    {"20 mm", {{"full", Nanos{6'000'000}}, {"step2", Nanos{3'000'000}}}, {}}};
  r.tasks = {parent, worker, worker};
  r.tasks[1].name = "fusion_worker1";
  r.tasks[2].name = "fusion_worker2";
  r.platform = {{periodic("sentinel", 1'000'000, 5000, 0), rt::kSentinelPriority}};
  r.platform[0].spec.core.reset();
  r.best_effort = {{"link", 0.1, 1}};
  const auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted) << a.refusal;
  EXPECT_NE(a.tasks[0].core, a.tasks[1].core);
  EXPECT_NE(a.tasks[0].core, a.tasks[2].core);
  EXPECT_NE(a.tasks[1].core, a.tasks[2].core);
  for (const auto& t : a.tasks) {
    EXPECT_EQ(t.choice, "20 mm");
    EXPECT_EQ(t.variant, "full");
    EXPECT_LE(t.R, t.D);
  }
  EXPECT_GT(a.tasks[1].J.count(), 9'000'000);
  EXPECT_EQ(a.platform.size(), 3U) << "a sentinel on the workers' cores too";
  // Growth is what the admission itself accepts.
  const auto grown = [&](double f) {
    auto g = r;
    for (auto& t : g.tasks) {
      t = rt::settled_as(a, g.tasks)[static_cast<std::size_t>(&t - g.tasks.data())];
      t.variants.resize(1);
      for (auto& v : t.variants) {
        for (Nanos* d : {&v.budget, &v.until_last_fork})
          *d = Nanos{static_cast<std::int64_t>(static_cast<double>(d->count()) * f) + 1};
        v.overlap = Nanos{static_cast<std::int64_t>(static_cast<double>(v.overlap.count()) * f)};
      }
    }
    for (auto& p : g.platform)
      p.spec.budget =
          Nanos{static_cast<std::int64_t>(static_cast<double>(p.spec.budget.count()) * f) + 1};
    return rt::admit(g).admitted;
  };
  EXPECT_GT(a.growth, 1.0);
  EXPECT_TRUE(grown(a.growth - 1e-4));
  EXPECT_FALSE(grown(a.growth + 2e-3));
  // On two cores there is no room for two workers, whatever their size.
  r.cpus = {4, 5};
  const auto refused = rt::admit(r);
  EXPECT_FALSE(refused.admitted);
  EXPECT_THAT(refused.refusal, HasSubstr("of the same pool"));
  r.tasks.pop_back();
  EXPECT_TRUE(rt::admit(r).admitted);
}

TEST(ForkJoin, AModeCarriesItsWorkersAlong) {
  rt::AdmissionRequest r;
  r.cpus = {0, 1};
  r.tasks = {periodic("parent", 40'000'000, 9'000'000, 0),
             periodic("worker", 40'000'000, 6'000'000, 1)};
  r.tasks[0].forks = 1;
  r.tasks[0].variants = {{"full", Nanos{9'000'000}, Nanos{3'000'000}, Nanos{4'000'000}},
                         {"small", Nanos{4'000'000}, Nanos{1'000'000}, Nanos{1'000'000}}};
  r.tasks[1].variants = {{"full", Nanos{6'000'000}}, {"small", Nanos{2'000'000}}};
  r.tasks[1].parent = "parent";
  const auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted) << a.refusal;
  const auto t = rt::analyse_modes(r, a,
                                   {{"small", true, {{true, 1, 1}, {}}},
                                    {"off", true, {{false, 0, 0}, {}}},
                                    {"any", false, {{true, 0, 1}, {}}}});
  EXPECT_EQ(t.refusal, "");
  EXPECT_GT(t.verdict(2, 2).utilisation, 2 * t.verdict(0, 0).utilisation);
  EXPECT_LT(t.verdict(1, 1).utilisation, 1e-9);
}

}  // namespace

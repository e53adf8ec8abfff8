// The virtual executor against the tick-by-tick reference, job by job: start, end, outcome and
// level of every job, and all totals, for every shipped fault plan on the design's task table and
// for 1,000 random task sets with random plans.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "config/fault_plan.hpp"
#include "rt/fault/planned.hpp"
#include "rt/random.hpp"
#include "rt/sched/virtual_executor.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/schedule_compare.hpp"

namespace {

using support::compare_task;
using support::policy_of;
using support::SimConfig;
using support::SimPolicy;
using support::SimTask;
using support::Sums;
using support::Ticks;

class SameCosts final : public rt::CostModel {
 public:
  explicit SameCosts(const SimConfig& config) : config_(config) {}
  rt::Nanos cost(std::uint16_t task, std::uint64_t k, int level) noexcept override {
    return rt::Nanos{config_.tasks[task].cost_of(k, level)};
  }

 private:
  const SimConfig& config_;
};

struct Executed {
  std::vector<rt::TaskTotals> totals;
  std::vector<std::map<std::uint64_t, rt::JobRecord>> jobs;
};

Executed execute(const SimConfig& c) {
  std::vector<rt::PlacedTask> placed;
  std::vector<std::string> names;
  for (const SimTask& t : c.tasks) {
    rt::PlacedTask p;
    p.spec.name = t.name;
    p.spec.rate = {t.rate_num, t.rate_den};
    p.spec.offset = rt::Nanos{t.offset};
    p.spec.deadline = rt::Nanos{t.deadline};
    p.spec.policy = policy_of(t.policy);
    p.spec.catch_up_max = t.catch_up_max;
    // One level more than admission reckoned with: it must never be reached.
    for (int l = 0; l <= t.last_level + 1; ++l) p.spec.variants.push_back({"", rt::Nanos{1}});
    p.level = t.first_level;
    p.last_level = t.last_level;
    p.id = static_cast<std::uint16_t>(placed.size());
    p.core = t.core;
    p.priority = t.priority;
    placed.push_back(p);
    names.push_back(t.name);
  }
  SameCosts costs(c);
  const rt::Planned planned(c.plan, names);
  Executed out;
  out.jobs.resize(placed.size());
  rt::VirtualOptions options;
  options.stub_bodies = true;
  rt::VirtualExecutor<rt::Planned> executor(
      placed, costs, planned, [&](const rt::JobRecord& r) { out.jobs[r.task][r.k] = r; }, options);
  rt::RunPlan run;
  run.duration = rt::Nanos{c.horizon};
  run.hyperperiod = rt::Nanos{c.hyperperiod};
  executor.run(run);
  out.totals = executor.totals();
  return out;
}

// Both runs, compared; adds to `sums`. Returns the first difference.
std::string compare(const SimConfig& c, Sums& sums) {
  const support::SimResult want = simulate(c);
  const Executed got = execute(c);
  std::string problem;
  for (std::size_t i = 0; i < c.tasks.size(); ++i) {
    const auto& t = want.tasks[i];
    sums.add(t);
    const std::string text = compare_task(t, got.totals[i], got.jobs[i]);
    if (!text.empty() && problem.empty()) problem = c.tasks[i].name + ": " + text;
  }
  return problem;
}

SimTask task(const char* name, std::int64_t hz, Ticks cost_us, int priority, int core,
             SimPolicy policy) {
  SimTask t;
  t.name = name;
  t.rate_num = hz;
  t.deadline = (1'000'000'000 + hz - 1) / hz;
  t.priority = priority;
  t.core = core;
  t.policy = policy;
  const std::uint64_t stream = rt::target_hash(name);
  // 60 to 100 % of the budget; each level takes a quarter off.
  t.cost_of = [cost_us, stream](std::uint64_t k, int level) {
    const auto part = static_cast<Ticks>(rt::mix64(stream, k) % 400U);
    return cost_us * (600 + part) * (4 - level) / 4;
  };
  return t;
}

// Both boxes on two cores, as an admission with smaller variants would place them.
SimConfig design_table() {
  SimConfig c;
  c.cores = 2;
  c.horizon = 60'000'000'000;
  c.hyperperiod = 100'000'000;
  c.tasks = {task("haptic", 1000, 100, 80, 0, SimPolicy::kSkip),
             task("robot_io", 1000, 100, 79, 1, SimPolicy::kSkip),
             task("supervision", 100, 50, 78, 0, SimPolicy::kSkip),
             task("fusion", 30, 15000, 76, 0, SimPolicy::kDegrade),
             task("capture", 30, 8000, 75, 1, SimPolicy::kSkip),
             task("prediction", 10, 2000, 74, 1, SimPolicy::kSkip),
             task("planning", 10, 35000, 73, 1, SimPolicy::kAbort)};
  c.tasks[3].last_level = 2;
  return c;
}

TEST(ExecutorAgainstReference, EveryShippedPlan) {
  const std::filesystem::path folder = tests::in_tree("config/faults");
  std::set<std::filesystem::path> files;
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    if (file.path().extension() == ".toml") files.insert(file.path());
  }
  ASSERT_GE(files.size(), 10U);
  std::printf("60 s of the design's table, costs 60..100 %% of the budgets\n");
  Sums::print_head();
  Sums none;
  EXPECT_EQ(compare(design_table(), none), "");
  none.print("(none)");
  EXPECT_EQ(none.late + none.skipped + none.aborted, 0U);
  for (const auto& path : files) {
    const auto plan = config::load_fault_plan(path.string());
    ASSERT_TRUE(plan.has_value()) << plan.error();
    SimConfig c = design_table();
    c.plan = plan.value();
    Sums sums;
    EXPECT_EQ(compare(c, sums), "") << path;
    sums.print(plan.value().name);
    bool timing = false;
    for (const auto& e : c.plan.entries) timing = timing || !rt::acts_on_edge(e.kind);
    EXPECT_EQ(sums.late + sums.skipped + sums.aborted > 0, timing) << path;
  }
}

SimTask random_task(rt::Random& rng, std::uint64_t seed, int i, int cores) {
  constexpr std::array<std::int64_t, 6> kRates{1000, 500, 100, 60, 30, 10};
  SimTask t;
  t.name = std::string("t").append(std::to_string(i));
  t.rate_num = kRates[static_cast<std::size_t>(rng.integer(0, 5))];
  const Ticks period = 1'000'000'000 / t.rate_num;
  t.offset = rng.integer(0, 3) == 0 ? rng.integer(0, period) : 0;
  t.deadline = rng.integer(0, 1) == 0 ? rng.integer(period / 4, 2 * period)
                                      : (1'000'000'000 + t.rate_num - 1) / t.rate_num;
  t.priority = 80 - i;
  t.core = static_cast<int>(rng.integer(0, cores - 1));
  t.policy = static_cast<SimPolicy>(rng.integer(0, 3));
  t.catch_up_max = static_cast<int>(rng.integer(0, 3));
  if (t.policy == SimPolicy::kDegrade) {
    t.last_level = static_cast<int>(rng.integer(0, 2));
    t.first_level = static_cast<int>(rng.integer(0, t.last_level));
  }
  const auto base = static_cast<Ticks>(static_cast<double>(period) * rng.uniform(0.02, 0.5));
  const std::uint64_t stream = rt::mix64(seed, static_cast<std::uint64_t>(i));
  t.cost_of = [base, stream](std::uint64_t k, int level) {
    const auto more =
        static_cast<Ticks>(rt::mix64(stream, k) % static_cast<std::uint64_t>(base / 4));
    return base - level * (base / 4) + more;
  };
  return t;
}

TEST(ExecutorAgainstReference, OneThousandRandomPlans) {
  std::printf("seeds 1..1000\n");
  Sums sums;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    rt::Random rng(seed, 5);
    SimConfig c;
    c.cores = static_cast<int>(rng.integer(1, 3));
    c.hyperperiod = 100'000'000;
    c.horizon = rng.integer(500, 3000) * 1'000'000;
    c.plan.seed = seed;
    const auto tasks = rng.integer(2, 8);
    for (int i = 0; i < tasks; ++i) c.tasks.push_back(random_task(rng, seed, i, c.cores));
    const auto faults = rng.integer(0, 8);
    for (int f = 0; f < faults; ++f) c.plan.entries.push_back(support::random_fault(rng, c.tasks));
    ASSERT_EQ(compare(c, sums), "") << "seed " << seed;
  }
  std::printf(
      "1000 plans: %llu releases, %llu late, %llu skipped, %llu aborted, %llu degraded, "
      "%llu restored: equal job by job\n",
      static_cast<unsigned long long>(sums.releases), static_cast<unsigned long long>(sums.late),
      static_cast<unsigned long long>(sums.skipped), static_cast<unsigned long long>(sums.aborted),
      static_cast<unsigned long long>(sums.degraded),
      static_cast<unsigned long long>(sums.restored));
  EXPECT_GT(sums.late, 10'000U);
  EXPECT_GT(sums.skipped, 10'000U);
  EXPECT_GT(sums.aborted, 1'000U);
  EXPECT_GT(sums.degraded, 100U);
  EXPECT_GT(sums.restored, 10U);
}

// The comparison can fail: one nanosecond of one job is seen.
TEST(ExecutorAgainstReference, OneNanosecondIsSeen) {
  SimConfig c = design_table();
  c.horizon = 1'000'000'000;
  const support::SimResult want = simulate(c);
  SimConfig other = c;
  other.plan.entries.emplace_back();
  other.plan.entries[0].kind = rt::FaultKind::kExtraCpu;
  other.plan.entries[0].target = "haptic";
  other.plan.entries[0].first = 777;
  other.plan.entries[0].count = 1;
  other.plan.entries[0].magnitude = rt::Nanos{1};
  const Executed got = execute(other);
  EXPECT_NE(compare_task(want.tasks[0], got.totals[0], got.jobs[0]), "");
  EXPECT_EQ(compare_task(want.tasks[1], got.totals[1], got.jobs[1]), "");
}

}  // namespace

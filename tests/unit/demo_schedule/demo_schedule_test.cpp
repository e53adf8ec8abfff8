// `teletact demo --clock virtual` against the tick-by-tick reference, job by job: the table,
// levels, cores, priorities, release offsets and costs that the demo itself admits, both boxes with
// their clocks, for every shipped fault plan and 1,000 random ones. What a job's body does has no
// part in the schedule (Demo.StubBodiesGiveTheScheduleOfRealOnes), so the bodies are left out.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <set>

#include "config/fault_plan.hpp"
#include "rt/fault/planned.hpp"
#include "rt/sched/virtual_executor.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/schedule_compare.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"

namespace {

namespace fs = std::filesystem;
using support::SimConfig;
using support::SimPolicy;
using support::SimTask;
using support::Sums;
using support::Ticks;
using Jobs = std::map<std::uint64_t, rt::JobRecord>;

rt::NonRealtime& nrt() {
  static rt::Startup startup;
  return startup.token();
}

struct Product {
  explicit Product(int cores)
      : scene(teletact::load_scene(teletact::find_config("scenes", "default_room"), {})) {
    options.virtual_clock = options.stub_bodies = options.quiet = true;
    options.cores = cores;
    std::vector<int> cpus;
    for (int i = 0; i < cores; ++i) cpus.push_back(i);
    host = teletact::admit_host(*scene, calibration, cpus, {0.30});
  }
  std::unique_ptr<teletact::Scene> scene;
  teletact::DemoOptions options;
  tasks::Calibration calibration = teletact::reference_calibration();
  teletact::HostPlan host;
  std::uint64_t sched_hash = 0;  // of the last run
};

SimPolicy policy_of(rt::MissPolicy p) {
  switch (p) {
    case rt::MissPolicy::kSkip:
      return SimPolicy::kSkip;
    case rt::MissPolicy::kCatchUp:
      return SimPolicy::kCatchUp;
    case rt::MissPolicy::kAbort:
      return SimPolicy::kAbort;
    case rt::MissPolicy::kDegrade:
      return SimPolicy::kDegrade;
  }
  return SimPolicy::kSkip;
}

// 50 ppm fast, at an epoch where it shows whole numbers: after every 20,000 ns of the host the
// robot's clock has one more, and that one it steps over.
Ticks robot_clock(Ticks shown) { return 20000 * (shown / 20001) + shown % 20001; }

// What the demo admitted, as the reference takes it.
SimConfig reference_of(const teletact::HostPlan& host, const tasks::Calibration& calibration,
                       std::uint64_t cost_seed, int cores, double seconds) {
  SimConfig c;
  c.cores = cores;
  c.horizon = static_cast<Ticks>(seconds * 1e9);
  c.hyperperiod = 100'000'000;
  const auto costs =
      std::make_shared<rt::QuantileCosts>(cost_seed, tasks::make_costs(calibration, host.specs));
  for (std::size_t i = 0; i < host.specs.size(); ++i) {
    const rt::TaskSpec& spec = host.specs[i];
    const rt::AdmittedTask& row = host.admission.tasks[i];
    SimTask t;
    t.name = spec.name;
    t.rate_num = spec.rate.num;
    t.rate_den = spec.rate.den;
    t.offset = spec.offset.count();
    t.deadline = spec.relative_deadline().count();
    t.priority = row.priority;
    t.core = row.cpu;
    t.policy = policy_of(spec.policy);
    t.catch_up_max = spec.catch_up_max;
    t.first_level = row.level;
    t.last_level = row.last_level;
    t.cost_of = [costs, i](std::uint64_t k, int level) {
      return costs->cost(static_cast<std::uint16_t>(i), k, level).count();
    };
    if (spec.box == rt::Box::kRobot) t.on_clock = robot_clock;
    c.tasks.push_back(std::move(t));
  }
  return c;
}

support::Told told_by(const rt::TaskSpec& spec, std::int64_t epoch) {
  return {epoch, spec.box == rt::Box::kRobot ? teletact::kRobotClock : teletact::kOperatorClock};
}

// The demo and the reference under one plan (a file; empty: none). The first difference, or empty.
std::string compare(Product& product, const std::string& plan_file, double seconds, Sums& sums) {
  SimConfig c = reference_of(product.host, product.calibration, product.options.cost_seed,
                             product.options.cores, seconds);
  product.options.seconds = seconds;
  product.options.fault_plan = plan_file;
  if (!plan_file.empty()) c.plan = config::load_fault_plan(plan_file).value();
  const support::SimResult want = simulate(c);
  teletact::VirtualRun run =
      teletact::run_virtual(nrt(), *product.scene, product.options, product.calibration);
  product.sched_hash = run.sched_hash;
  std::string problem;
  std::size_t found = 0;
  const auto judge = [&](const rt::RunLog& log, const std::vector<teletact::BoxTotals>& totals) {
    for (std::size_t i = 0; i < log.tasks.size(); ++i) {
      const rt::TaskLog& t = log.tasks[i];
      ++found;
      if (totals.at(i).task != t.id || c.tasks.at(t.id).name != t.spec.name)
        problem = "other tasks";
      Jobs jobs;
      for (const auto& r : t.jobs) jobs[r.k] = r;
      sums.add(want.tasks[t.id]);
      const std::string text =
          compare_task(want.tasks[t.id], totals[i].totals, jobs, told_by(t.spec, run.op.epoch_ns));
      if (!text.empty() && problem.empty()) problem = t.spec.name + ": " + text;
    }
  };
  judge(run.op.log, run.op.totals);
  judge(run.robot.log, run.robot.totals);
  if (found != tasks::kTaskTable.size()) problem = "tasks are missing";
  return problem;
}

std::set<fs::path> shipped_plans() {
  std::set<fs::path> files;
  for (const auto& f : fs::directory_iterator(tests::in_tree("config/faults"))) {
    if (f.path().extension() == ".toml") files.insert(f.path());
  }
  return files;
}

TEST(DemoAgainstReference, EveryShippedPlan) {
  const auto files = shipped_plans();
  ASSERT_GE(files.size(), 10U);
  for (const int cores : {2, 4}) {
    Product product(cores);
    ASSERT_EQ(product.host.refusal, "");
    std::printf("60 s of the demo on %d cores\n", cores);
    Sums::print_head();
    Sums none;
    EXPECT_EQ(compare(product, {}, 60, none), "");
    none.print("(none)");
    EXPECT_EQ(none.misses(), 0U);
    EXPECT_GT(none.releases, 60U * 2000U);
    const std::uint64_t undisturbed = product.sched_hash;
    for (const auto& path : files) {
      Sums sums;
      EXPECT_EQ(compare(product, path.string(), 60, sums), "") << path;
      sums.print(path.stem());
      bool timing = false;
      const rt::FaultPlan plan = config::load_fault_plan(path.string()).value();
      for (const auto& e : plan.entries) timing = timing || !rt::acts_on_edge(e.kind);
      EXPECT_EQ(product.sched_hash != undisturbed, timing) << path;
      EXPECT_EQ(sums.misses() > 0, timing) << path;
    }
  }
}

std::string random_plan_file(std::uint64_t seed, const std::vector<SimTask>& tasks) {
  static const std::string path =
      fs::temp_directory_path() / ("teletact-random-plan-" + std::to_string(::getpid()) + ".toml");
  rt::Random rng(seed, 6);
  std::ofstream out(path);
  out << "name = \"random\"\nseed = " << seed << "\n";
  const auto faults = rng.integer(1, 8);
  for (std::int64_t f = 0; f < faults; ++f) {
    const rt::FaultEntry e = support::random_fault(rng, tasks);
    char magnitude[40], probability[40];
    std::snprintf(magnitude, sizeof magnitude, "%.3f",
                  1e-3 * static_cast<double>(e.magnitude.count()));
    std::snprintf(probability, sizeof probability, "%.17f", e.probability);
    out << "[[fault]]\nkind = \"" << rt::name_of(e.kind) << "\"\ntarget = \"" << e.target
        << "\"\nfirst = " << e.first << "\nseed = " << (e.seed >> 2U) << "\n";
    if (e.kind == rt::FaultKind::kDeadThread) continue;
    out << "every = " << e.every << "\ncount = " << e.count << "\nprobability = " << probability
        << "\nmagnitude_us = " << magnitude << "\n";
  }
  return path;
}

TEST(DemoAgainstReference, OneThousandRandomPlans) {
  std::printf("seeds 1..1000\n");
  Product two(2), four(4);
  Sums sums;
  std::string file;
  for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
    Product& product = seed % 2 == 0 ? two : four;
    product.options.cost_seed = seed;
    const SimConfig table = reference_of(product.host, product.calibration, seed, 1, 1);
    file = random_plan_file(seed, table.tasks);
    ASSERT_EQ(compare(product, file, 1.2, sums), "") << "seed " << seed;
  }
  fs::remove(file);
  Sums::print_head();
  sums.print("1000 random plans");
  EXPECT_GT(sums.late, 10'000U);
  EXPECT_GT(sums.skipped, 10'000U);
  EXPECT_GT(sums.aborted, 100U);
}

// The table as shipped drops releases and changes no level while it runs. The same table with the
// policy that does, and dearer jobs: every task with more than one variant degrades, as far as its
// variants go.
TEST(DemoAgainstReference, TheSameTableDegrading) {
  Product product(2);
  std::printf("60 s of the demo's table on 2 cores, policy degrade\n");
  Sums::print_head();
  Sums all;
  for (const auto& path : shipped_plans()) {
    teletact::HostPlan host = product.host;
    std::vector<rt::PlacedTask> placed;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < host.specs.size(); ++i) {
      if (host.specs[i].levels() > 1) {
        host.specs[i].policy = rt::MissPolicy::kDegrade;
        // Twice its costs (they are drawn by the budget), or too few jobs are late for a level to
        // change often.
        for (auto& v : host.specs[i].variants) v.budget *= 2;
        host.admission.tasks[i].last_level = host.specs[i].levels() - 1;
        host.admission.tasks[i].level = 0;
      }
      placed.push_back(teletact::placed_task(host, i));
      names.push_back(host.specs[i].name);
    }
    SimConfig c = reference_of(host, product.calibration, 1, 2, 60);
    c.plan = config::load_fault_plan(path.string()).value();
    const support::SimResult want = simulate(c);
    std::vector<Jobs> jobs(placed.size());
    rt::QuantileCosts costs(1, tasks::make_costs(product.calibration, host.specs));
    const rt::Planned planned(c.plan, names);
    rt::VirtualOptions how;
    how.stub_bodies = true;
    rt::VirtualExecutor<rt::Planned> executor(
        placed, costs, planned, [&](const rt::JobRecord& r) { jobs[r.task][r.k] = r; }, how);
    rt::RunPlan plan;
    plan.epoch_host_ns = 1'000'000'000;
    plan.duration = rt::Nanos{c.horizon};
    plan.clock[0] = teletact::kOperatorClock;
    plan.clock[1] = teletact::kRobotClock;
    executor.run(plan);
    Sums sums;
    for (std::size_t i = 0; i < placed.size(); ++i) {
      sums.add(want.tasks[i]);
      EXPECT_EQ(compare_task(want.tasks[i], executor.totals()[i], jobs[i],
                             told_by(placed[i].spec, plan.epoch_host_ns)),
                "")
          << path << ' ' << names[i];
    }
    sums.print(path.stem());
    all.degraded += sums.degraded;
    all.restored += sums.restored;
  }
  EXPECT_GT(all.degraded, 10U);
  EXPECT_GT(all.restored, 0U);
}

// The comparison can fail: one nanosecond of one cost, or a clock without its 50 ppm, is seen.
TEST(DemoAgainstReference, ASmallDifferenceIsSeen) {
  Product product(2);
  product.options.seconds = 1;
  const teletact::VirtualRun run =
      teletact::run_virtual(nrt(), *product.scene, product.options, product.calibration);
  const auto first_difference = [&](const SimConfig& c) {
    const support::SimResult want = simulate(c);
    for (std::size_t i = 0; i < run.robot.log.tasks.size(); ++i) {
      const auto& t = run.robot.log.tasks[i];
      Jobs jobs;
      for (const auto& r : t.jobs) jobs[r.k] = r;
      const std::string text = compare_task(want.tasks[t.id], run.robot.totals[i].totals, jobs,
                                            told_by(t.spec, run.op.epoch_ns));
      if (!text.empty()) return text;
    }
    return std::string();
  };
  const SimConfig same = reference_of(product.host, product.calibration, 1, 2, 1);
  EXPECT_EQ(first_difference(same), "");
  SimConfig c = same;
  for (auto& t : c.tasks) t.on_clock = nullptr;
  EXPECT_NE(first_difference(c), "");
  c = same;
  auto& io = c.tasks[tasks::index_of(tasks::TaskId::kRobotIo)];
  io.cost_of = [old = io.cost_of](std::uint64_t k, int level) {
    return k == 500 ? old(k, level) + 1 : old(k, level);
  };
  EXPECT_NE(first_difference(c), "") << "one nanosecond";
}

// A page takes .10 of a core, of the operator's box alone (limit of what it may add: .12).
TEST(PageShare, IsAskedForOnceAndOfTheOperatorsBoxAlone) {
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), {});
  const auto calibration = teletact::reference_calibration();
  const std::vector<int> cpus{0, 1};
  const auto console = [](const teletact::HostPlan& plan) {
    for (const auto& b : plan.request.best_effort)
      if (b.name == "console") return b.share;
    return -1.0;
  };
  const auto with = teletact::declared_shares(*scene, calibration, true),
             without = teletact::declared_shares(*scene, calibration, false);
  const double added = console(teletact::admit_host(*scene, calibration, cpus, with)) -
                       console(teletact::admit_host(*scene, calibration, cpus, without));
  EXPECT_NEAR(added, 0.10, 1e-12);
  EXPECT_TRUE(teletact::admit_host(*scene, calibration, cpus, with).admission.admitted);
  for (const auto box : {rt::Box::kOperator, rt::Box::kRobot}) {
    const double of_box = console(teletact::admit_box(*scene, calibration, cpus, with, box)) -
                          console(teletact::admit_box(*scene, calibration, cpus, without, box));
    EXPECT_NEAR(of_box, box == rt::Box::kOperator ? 0.10 : 0, 1e-12);
    EXPECT_NEAR(console(teletact::admit_box(*scene, calibration, cpus, without, box)), 0.02, 1e-12);
  }
}

// A size that the scene names is the only one that admission may choose; any other key leaves the
// choice to it.
TEST(VoxelSize, OneThatTheSceneNamesIsTaken) {
  const auto calibration = teletact::reference_calibration();
  const auto size = [&](const std::vector<std::string>& keys) {
    const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), keys);
    const auto plan = teletact::admit_host(*scene, calibration, {0, 1},
                                           teletact::declared_shares(*scene, calibration, false));
    EXPECT_EQ(plan.refusal, "");
    return std::pair{teletact::choice_limits(*scene).named_voxel_m, plan.voxel_m};
  };
  const auto [unnamed, chosen] = size({"fusion.tsdf.max_depth_m=4.0", "haptic.scale=1.0"});
  EXPECT_EQ(unnamed, 0);
  EXPECT_LT(chosen, 0.04);
  const auto [named, taken] = size({"fusion.tsdf.voxel_size_m=0.04"});
  EXPECT_EQ(named, 0.04);
  EXPECT_EQ(taken, 0.04);
}

// The whole link on two cores: the codec of depth, H.264 and two boxes in one host leave room for
// voxels of 20 mm. What they take is declared, and more than a plain link.
TEST(LinkShare, WithBothCodecsTheDemoIsAdmittedAt20MmOnTwoCores) {
  const auto link = [](const std::vector<std::string>& keys) {
    return teletact::load_scene(teletact::find_config("scenes", "default_room"), keys);
  };
  const auto plain = link({});
  const auto coded = link({"link.depth_codec=\"auto\"", "link.colour_codec=\"h264\""});
  const auto calibration = teletact::reference_calibration();
  for (const bool page : {false, true}) {
    const auto shares = teletact::declared_shares(*coded, calibration, page);
    const auto plan = teletact::admit_host(*coded, calibration, {0, 1}, shares);
    EXPECT_EQ(plan.refusal, "") << page;
    EXPECT_TRUE(plan.admission.admitted) << page;
    EXPECT_DOUBLE_EQ(plan.voxel_m, 0.02) << page;
  }
  EXPECT_GT(teletact::declared_link_share(*coded, calibration),
            teletact::declared_link_share(*plain, calibration));
  // What a machine was measured to take is what it is admitted with, on both clocks and for each
  // box.
  auto measured = teletact::as_asked(calibration, *coded);
  measured.link_share = 0.17;
  const auto shares = teletact::declared_shares(*coded, measured, false);
  EXPECT_DOUBLE_EQ(2 * shares.link, tasks::declared_link_share(measured));
  const auto link_of = [](const teletact::HostPlan& plan) {
    for (const auto& load : plan.request.best_effort) {
      if (load.name == "link") return load.share;
    }
    return -1.0;
  };
  const auto both = teletact::admit_host(*coded, measured, {0, 1}, shares);
  EXPECT_EQ(both.refusal, "");
  EXPECT_DOUBLE_EQ(both.voxel_m, 0.02);
  EXPECT_DOUBLE_EQ(link_of(both), tasks::declared_link_share(measured));
  for (const auto box : {rt::Box::kOperator, rt::Box::kRobot})
    EXPECT_DOUBLE_EQ(link_of(teletact::admit_box(*coded, measured, {0, 1}, shares, box)),
                     0.5 * tasks::declared_link_share(measured));
}

}  // namespace

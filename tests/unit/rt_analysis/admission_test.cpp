#include "rt/sched/admission.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "rt/random.hpp"

namespace {

using rt::AdmissionRequest;
using rt::Nanos;
using rt::PlatformTask;
using rt::TaskSpec;
using testing::HasSubstr;

TaskSpec spec(std::string name, rt::Rate rate, double budget_ms) {
  TaskSpec s;
  s.name = std::move(name);
  s.rate = rate;
  s.budget = rt::nanos_from_seconds(budget_ms * 1e-3);
  return s;
}

rt::Variant variant(const char* name, double budget_ms) {
  return {name, rt::nanos_from_seconds(budget_ms * 1e-3)};
}

// The design's table, both boxes, with platform tasks and best effort, on `cores` cores.
AdmissionRequest demo(int cores) {
  AdmissionRequest r;
  r.tasks = {spec("haptic", {1000, 1}, 0.1),      spec("fusion", {30, 1}, 25),
             spec("prediction", {10, 1}, 2),      spec("planning", {10, 1}, 50),
             spec("supervision", {100, 1}, 0.05), spec("robot_io", {1000, 1}, 0.1),
             spec("capture", {30, 1}, 15),        spec("supervision", {100, 1}, 0.05)};
  for (std::size_t i = 5; i < 8; ++i) r.tasks[i].box = rt::Box::kRobot;
  r.tasks[1].policy = rt::MissPolicy::kDegrade;
  r.tasks[1].choices = {{"10 mm", {variant("full", 25), variant("fast", 21)}, {}},
                        {"20 mm", {variant("full", 12), variant("fast", 9)}, {}}};
  r.tasks[3].task_class = rt::TaskClass::kFirm;
  r.tasks[3].variants = {variant("50ms", 50), variant("35ms", 35), variant("20ms", 20)};
  r.tasks[6].task_class = rt::TaskClass::kFirm;
  r.tasks[6].variants = {variant("full", 15), variant("half", 8)};
  TaskSpec sentinel = spec("sentinel", {1000, 1}, 0.005);
  TaskSpec watchdog = spec("watchdog", {100, 1}, 0.02);
  watchdog.core = 0;
  r.platform = {{sentinel, rt::kSentinelPriority}, {watchdog, rt::kWatchdogPriority}};
  r.best_effort = {{"link", 0.05, 0}, {"console", 0.05, std::nullopt}};
  for (int c = 0; c < cores; ++c) r.cpus.push_back(2 + c);
  return r;
}

// The contract, checked from outside on any admitted request.
void expect_sound(const AdmissionRequest& request, const rt::Admission& a) {
  ASSERT_TRUE(a.admitted) << a.refusal;
  std::vector<double> load(request.cpus.size(), 0.0);
  for (const auto& b : request.best_effort) {
    if (b.core) load[static_cast<std::size_t>(*b.core)] += b.share;
  }
  for (std::size_t i = 0; i < a.tasks.size(); ++i) {
    const auto& t = a.tasks[i];
    ASSERT_GE(t.core, 0);
    EXPECT_EQ(t.cpu, request.cpus[static_cast<std::size_t>(t.core)]);
    EXPECT_EQ(t.priority, 80 - t.rank);
    EXPECT_LE(t.R, t.D);
    EXPECT_EQ(t.slack, t.D - t.R);
    EXPECT_EQ(t.core, request.tasks[i].core.value_or(t.core));
    load[static_cast<std::size_t>(t.core)] += t.utilisation;
    for (std::size_t j = 0; j < i; ++j) EXPECT_NE(t.priority, a.tasks[j].priority);
  }
  for (const auto& p : a.platform) load[static_cast<std::size_t>(p.core)] += p.utilisation;
  for (std::size_t c = 0; c < load.size(); ++c) {
    EXPECT_LE(load[c], request.core_limit + 1e-12);
    EXPECT_NEAR(load[c], a.cores[c].utilisation + a.cores[c].best_effort, 1e-12);
  }
}

TEST(Admission, FourCoresTakeTheFullTable) {
  const auto request = demo(4);
  const auto a = rt::admit(request);
  expect_sound(request, a);
  for (const auto& t : a.tasks) EXPECT_EQ(t.level, 0) << t.name;
  EXPECT_TRUE(a.steps.empty());
  EXPECT_GE(a.growth, 1.0);
  EXPECT_THAT(rt::report_table(a), HasSubstr("every task runs its full variant"));
}

// What was admitted, as a request without choices and levels, each task at its own.
AdmissionRequest at_levels(const AdmissionRequest& request, const rt::Admission& a,
                           std::size_t raised = 1000) {
  AdmissionRequest out = request;
  out.tasks = rt::settled_as(a, request.tasks);
  for (std::size_t j = 0; j < out.tasks.size(); ++j) {
    auto& t = out.tasks[j];
    t.budget = t.budget_of(a.tasks[j].level - (j == raised ? 1 : 0));
    t.variants.clear();
  }
  return out;
}

TEST(Admission, TwoCoresTakeSmallerVariantsAndSayWhich) {
  const auto request = demo(2);
  const auto a = rt::admit(request);
  expect_sound(request, a);
  EXPECT_FALSE(a.steps.empty());
  const std::string table = rt::report_table(a);
  std::printf("%s", table.c_str());
  for (const auto& step : a.steps) EXPECT_THAT(table, HasSubstr(step));
  EXPECT_THAT(a.steps[0], HasSubstr("because"));
  for (const auto& line : a.choices) EXPECT_THAT(table, HasSubstr(line));
  // No single step can be taken back.
  EXPECT_TRUE(rt::admit(at_levels(request, a)).admitted);
  for (std::size_t i = 0; i < a.tasks.size(); ++i) {
    if (a.tasks[i].level == 0) continue;
    EXPECT_FALSE(rt::admit(at_levels(request, a, i)).admitted) << request.tasks[i].name;
  }
}

TEST(Admission, OneCoreIsRefusedWithTaskAndFigures) {
  const auto a = rt::admit(demo(1));
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("task '"));
  EXPECT_THAT(a.refusal, HasSubstr("above 0.90"));
  EXPECT_THAT(a.refusal, HasSubstr("even after lowering"));
  EXPECT_THAT(a.refusal, HasSubstr("at the floor of the static choices: fusion 20 mm"));
  EXPECT_THAT(rt::report_table(a), HasSubstr("refused"));
}

// ---- static choices

// One task with choices beside a load that leaves `room_ms` of each 100 ms of one core.
AdmissionRequest choosing(double load_ms) {
  AdmissionRequest r;
  r.cpus = {0};
  r.tasks = {spec("fusion", {10, 1}, 1), spec("load", {10, 1}, load_ms)};
  r.tasks[0].choices = {{"10 mm", {variant("full", 60), variant("step2", 50)}, {}},
                        {"15 mm", {variant("full", 55), variant("step2", 30)}, {}},
                        {"20 mm", {variant("full", 40), variant("step2", 20)}, {}}};
  return r;
}

TEST(StaticChoice, TheFirstThatFitsAtAnyLevelIsTaken) {
  struct Want {
    double load_ms;
    const char* choice;
    int level;
  };
  for (const Want& w :
       {Want{10, "10 mm", 0}, Want{35, "10 mm", 1}, Want{45, "15 mm", 1}, Want{65, "20 mm", 1}}) {
    const auto request = choosing(w.load_ms);
    const auto a = rt::admit(request);
    expect_sound(request, a);
    EXPECT_EQ(a.tasks[0].choice, w.choice) << w.load_ms;
    EXPECT_EQ(a.tasks[0].level, w.level) << w.load_ms;
    EXPECT_EQ(a.tasks[0].last_level, 1);
    EXPECT_EQ(a.tasks[1].choice, "");
    ASSERT_FALSE(a.choices.empty());
    EXPECT_THAT(a.choices[0], HasSubstr(std::string("fusion: ") + w.choice));
    const auto settled = rt::settled_as(a, request.tasks);
    EXPECT_TRUE(settled[0].choices.empty());
    EXPECT_EQ(settled[0].choice, w.choice);
    EXPECT_EQ(settled[0].levels(), 2);
  }
  // What was passed over is named with its figures.
  const auto a = rt::admit(choosing(45));
  ASSERT_EQ(a.choices.size(), 2U);
  EXPECT_THAT(a.choices[1], HasSubstr("not with fusion 10 mm: task 'load'"));
  EXPECT_THAT(a.choices[1], HasSubstr("above 0.90"));
}

TEST(StaticChoice, NeverBelowTheFloor) {
  const auto a = rt::admit(choosing(75));
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("utilisation 0.95"));
  EXPECT_THAT(a.refusal, HasSubstr("fusion to step2"));
  EXPECT_THAT(a.refusal, HasSubstr("at the floor of the static choices: fusion 20 mm"));
  EXPECT_EQ(a.choices.size(), 3U) << "the floor, and the two that were tried before";
}

TEST(StaticChoice, WhatIsRuledOutIsPassedOverAndNamed) {
  auto r = choosing(10);
  r.tasks[0].choices[0].ruled_out = "the window is too small";
  auto a = rt::admit(r);
  ASSERT_TRUE(a.admitted);
  EXPECT_EQ(a.tasks[0].choice, "15 mm");
  EXPECT_THAT(a.choices[0], HasSubstr("10 mm is ruled out: the window is too small"));
  for (auto& c : r.tasks[0].choices) c.ruled_out = "no";
  a = rt::admit(r);
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("'fusion' has no choice left: 10 mm: no; 15 mm: no; 20 mm: no"));
}

// With several tasks that choose: against all combinations, one by one.
TEST(StaticChoice, FewestStepsDownAgainstEveryCombination) {
  std::printf("seeds 1..300\n");
  int chosen_below = 0, refused = 0;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    rt::Random rng(seed, 17);
    AdmissionRequest r;
    for (std::int64_t c = 0; c < rng.integer(1, 2); ++c) r.cpus.push_back(static_cast<int>(c));
    const auto n = rng.integer(2, 4);
    for (std::int64_t i = 0; i < n; ++i) {
      TaskSpec s = spec("t" + std::to_string(i), {rng.integer(5, 200), 1}, 1);
      const double ms = 1e3 / s.rate.hz();
      double share = rng.uniform(0.1, 0.8);
      for (std::int64_t c = 0; c < rng.integer(1, 3); ++c) {
        s.choices.push_back({"c" + std::to_string(c), {variant("", share * ms)}, {}});
        share *= rng.uniform(0.4, 0.9);
      }
      r.tasks.push_back(s);
    }
    const auto a = rt::admit(r);
    // Every combination of choices, as requests of their own.
    std::size_t best = 1000;
    std::vector<std::size_t> pick(r.tasks.size(), 0);
    for (bool more = true; more;) {
      auto one = r;
      std::size_t steps = 0;
      for (std::size_t i = 0; i < pick.size(); ++i) {
        one.tasks[i].budget = r.tasks[i].choices[pick[i]].variants[0].budget;
        one.tasks[i].choices.clear();
        steps += pick[i];
      }
      if (rt::admit(one).admitted) best = std::min(best, steps);
      more = false;
      for (std::size_t i = 0; i < pick.size() && !more; ++i) {
        more = ++pick[i] < r.tasks[i].choices.size();
        if (!more) pick[i] = 0;
      }
    }
    ASSERT_EQ(a.admitted, best < 1000) << "seed " << seed;
    if (!a.admitted) {
      ++refused;
      continue;
    }
    std::size_t taken = 0;
    for (std::size_t i = 0; i < r.tasks.size(); ++i) {
      for (std::size_t c = 0; c < r.tasks[i].choices.size(); ++c)
        taken += r.tasks[i].choices[c].name == a.tasks[i].choice ? c : 0;
    }
    EXPECT_EQ(taken, best) << "seed " << seed;
    chosen_below += taken > 0 ? 1 : 0;
  }
  std::printf("%d with smaller choices, %d refused\n", chosen_below, refused);
  EXPECT_GT(chosen_below, 30);
  EXPECT_GT(refused, 10);
}

TEST(Admission, ADegradeOrderIsFollowedAndNothingElseIsLowered) {
  auto request = demo(2);
  request.degrade_order = {"planning", "planning", "capture", "fusion", "fusion", "fusion"};
  const auto a = rt::admit(request);
  expect_sound(request, a);
  ASSERT_FALSE(a.steps.empty());
  request.degrade_order = {"capture"};
  request.tasks[1].choices.pop_back();  // the larger ones alone do not fit two cores
  const auto refused = rt::admit(request);
  EXPECT_FALSE(refused.admitted);
  EXPECT_EQ(refused.tasks[1].level, 0);
  EXPECT_EQ(refused.tasks[3].level, 0);
  EXPECT_EQ(refused.tasks[6].level, 1);
}

TEST(Admission, RunTimeLevelsStayWithinTheChoice) {
  const auto a = rt::admit(demo(4));
  EXPECT_EQ(a.tasks[1].last_level, 1);
  EXPECT_EQ(a.tasks[6].last_level, 1);
  EXPECT_EQ(a.tasks[3].last_level, 2);
}

TEST(Admission, RefusesAbovePointNineAlthoughAllDeadlinesHold) {
  AdmissionRequest r;
  r.cpus = {0};
  r.tasks = {spec("a", {10, 1}, 89.9)};
  EXPECT_TRUE(rt::admit(r).admitted);
  r.best_effort = {{"log", 0.01, 0}};
  const auto a = rt::admit(r);
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("utilisation 0.909"));
  EXPECT_THAT(a.refusal, HasSubstr("best effort 0.010"));
}

TEST(Admission, RefusesALateTaskAtLowUtilisation) {
  AdmissionRequest r;
  r.cpus = {0};
  r.tasks = {spec("long", {10, 1}, 5), spec("tight", {8, 1}, 1)};
  r.tasks[1].deadline = Nanos{3'000'000};
  const auto a = rt::admit(r);
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("'tight' R = 6.032 ms > D = 3.000 ms"));
  r.cpus = {0, 1};  // with two cores each has its own
  EXPECT_TRUE(rt::admit(r).admitted);
}

TEST(Admission, BlockingAndJitterCount) {
  AdmissionRequest r;
  r.cpus = {0};
  r.tasks = {spec("a", {1000, 1}, 0.5)};
  EXPECT_TRUE(rt::admit(r).admitted);
  r.tasks[0].blocking = Nanos{300'000};
  EXPECT_EQ(rt::admit(r).tasks[0].R.count(), 816'000);
  r.tasks[0].jitter = Nanos{200'000};
  EXPECT_FALSE(rt::admit(r).admitted);
}

TEST(Admission, PinnedTasksStayAndSentinelsFollowTheUsedCores) {
  auto r = demo(4);
  r.tasks[0].core = 3;
  r.best_effort.clear();
  const auto a = rt::admit(r);
  expect_sound(r, a);
  EXPECT_EQ(a.tasks[0].cpu, 5);
  std::vector<bool> used(4, false);
  for (const auto& t : a.tasks) used[static_cast<std::size_t>(t.core)] = true;
  std::size_t sentinels = 0, watchdogs = 0;
  for (const auto& p : a.platform) {
    EXPECT_EQ(p.name.substr(p.name.find('@') + 1), std::to_string(p.cpu));
    if (p.priority == rt::kSentinelPriority) {
      ++sentinels;
      EXPECT_TRUE(used[static_cast<std::size_t>(p.core)]);
    } else {
      ++watchdogs;
      EXPECT_EQ(p.cpu, 2);
    }
  }
  EXPECT_EQ(watchdogs, 1U);
  EXPECT_EQ(sentinels, static_cast<std::size_t>(std::count(used.begin(), used.end(), true)));
  const auto again = rt::pinned_as(a, r.tasks);
  for (std::size_t i = 0; i < again.size(); ++i) EXPECT_EQ(*again[i].core, a.tasks[i].core);
}

// A box is a process: where both have a task on a core, both have a sentinel there, at what it
// wakes.
TEST(Admission, EachBoxBringsItsOwnSentinelsAndWatchdog) {
  AdmissionRequest r;
  r.cpus = {4, 6, 9};
  r.tasks = {spec("haptic", {1000, 1}, 0.1), spec("supervision", {100, 1}, 0.05),
             spec("fusion", {30, 1}, 5), spec("robot_io", {500, 1}, 0.1)};
  const int cores[] = {0, 0, 1, 0};
  for (std::size_t i = 0; i < 4; ++i) r.tasks[i].core = cores[i];
  r.tasks[3].box = rt::Box::kRobot;
  for (const rt::Box box : {rt::Box::kOperator, rt::Box::kRobot}) {
    PlatformTask s{spec("sentinel", {1, 1}, 0.005), rt::kSentinelPriority,
                   rt::PlatformWakes::kAtReleases};
    PlatformTask w{spec("watchdog", {100, 1}, 0.02), rt::kWatchdogPriority,
                   rt::PlatformWakes::kOnceABox};
    s.spec.box = w.spec.box = box;
    r.platform.push_back(s);
    r.platform.push_back(w);
  }
  const auto a = rt::admit(r);
  expect_sound(r, a);
  std::vector<std::tuple<std::string, rt::Box, std::int64_t>> rows;
  for (const auto& p : a.platform) rows.emplace_back(p.name, p.box, p.T.count());
  using enum rt::Box;
  EXPECT_THAT(rows, testing::UnorderedElementsAre(
                        std::tuple("sentinel@4", kOperator, 1'000'000),  // 100 Hz on its grid
                        std::tuple("sentinel@6", kOperator, 33'333'333),
                        std::tuple("sentinel@4", kRobot, 2'000'000),
                        std::tuple("watchdog@6", kOperator, 10'000'000),
                        std::tuple("watchdog@4", kRobot, 10'000'000)));
}

// Against all instants, one by one: never charged for fewer wake-ups than there are, and never for
// more than one a release.
TEST(Admission, ASentinelIsChargedForEveryInstantAtWhichItWakes) {
  constexpr std::uint64_t kSeed = 8021;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random rng(kSeed);
  int merged = 0;
  for (int n = 0; n < 300; ++n) {
    AdmissionRequest r;
    r.cpus = {0};
    const int tasks = static_cast<int>(rng.integer(1, 5));
    constexpr std::int64_t kRates[] = {1000, 500, 300, 100, 90, 60, 30, 20, 10};
    std::set<std::int64_t> instants;
    std::int64_t releases = 0;
    for (int i = 0; i < tasks; ++i) {
      const std::int64_t hz = kRates[rng.integer(0, 8)];
      r.tasks.push_back(spec("t" + std::to_string(i), {hz, 1}, 0.01));
      if (rng.integer(0, 3) == 0) r.tasks.back().offset = Nanos{rng.integer(1, 900'000)};
      releases += hz;
      for (std::int64_t k = 0; k < hz; ++k) {
        instants.insert(r.tasks.back().offset.count() +
                        r.tasks.back().rate.release(static_cast<std::uint64_t>(k)).count());
      }
    }
    r.platform = {
        {spec("sentinel", {1, 1}, 0.005), rt::kSentinelPriority, rt::PlatformWakes::kAtReleases}};
    const auto a = rt::admit(r);
    ASSERT_TRUE(a.admitted) << a.refusal;
    double charged = 0;
    for (const auto& p : a.platform) charged += 1e9 / static_cast<double>(p.T.count());
    ASSERT_GE(charged, static_cast<double>(instants.size()) - 0.1) << "case " << n;
    ASSERT_LE(charged, static_cast<double>(releases) + 0.1) << "case " << n;
    merged += charged < static_cast<double>(releases) - 1 ? 1 : 0;
  }
  EXPECT_GT(merged, 50) << "instants that fall together count once";
}

TEST(Admission, TwoTasksPinnedTogetherCanBeRefused) {
  AdmissionRequest r;
  r.cpus = {0, 1};
  r.tasks = {spec("a", {10, 1}, 50), spec("b", {10, 1}, 50)};
  r.tasks[0].core = r.tasks[1].core = 1;
  const auto a = rt::admit(r);
  EXPECT_FALSE(a.admitted);
  EXPECT_THAT(a.refusal, HasSubstr("task 'b' pinned to core 1 (cpu 1)"));
}

TEST(Admission, FloatingBestEffortNeedsRoomSomewhere) {
  AdmissionRequest r;
  r.cpus = {0, 1};
  r.tasks = {spec("a", {10, 1}, 60), spec("b", {10, 1}, 60)};
  r.best_effort = {{"console", 0.5, std::nullopt}};
  const auto fits = rt::admit(r);
  EXPECT_TRUE(fits.admitted);
  // What is left: of two cores .90 each, less the tasks with their switches, less the console.
  double left = 2 * 0.90 - 0.5;
  for (const auto& core : fits.cores) left -= core.utilisation;
  EXPECT_NEAR(fits.spare, left, 1e-12);
  EXPECT_GT(fits.spare, 0.05);
  EXPECT_LT(fits.spare, 0.11);
  r.best_effort.push_back({"report", 0.2, std::nullopt});
  const auto a = rt::admit(r);
  EXPECT_FALSE(a.admitted);
  EXPECT_LT(a.spare, 0);
  EXPECT_THAT(a.refusal, HasSubstr("best-effort load without a core is 0.700"));
}

TEST(Admission, GrowthIsWhatAdmissionItselfWouldAccept) {
  AdmissionRequest r;
  r.cpus = {0};
  r.tasks = {spec("haptic", {1000, 1}, 0.1), spec("fusion", {30, 1}, 10),
             spec("plan", {10, 1}, 10)};
  r.best_effort = {{"link", 0.1, 0}};
  const auto a = rt::admit(r);
  const auto grown = [&](double f) {
    auto g = r;
    for (auto& t : g.tasks) {
      t.budget =
          Nanos{static_cast<std::int64_t>(std::ceil(static_cast<double>(t.budget.count()) * f))};
    }
    return rt::admit(g).admitted;
  };
  EXPECT_TRUE(grown(a.growth));
  EXPECT_FALSE(grown(a.growth + 1.1e-4));
}

TEST(Admission, MalformedRequestsAreRefusedByName) {
  const auto refusal = [](auto change) {
    auto r = demo(2);
    change(r);
    const auto a = rt::admit(r);
    EXPECT_FALSE(a.admitted);
    return a.refusal;
  };
  EXPECT_THAT(refusal([](auto& r) { r.cpus.clear(); }), HasSubstr("no CPU"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].budget = Nanos{0}; }), HasSubstr("'haptic'"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].core = 2; }), HasSubstr("allowed: 0 to 1"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].rate.num = 0; }), HasSubstr("rate"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[1].choices[1].variants[0].budget = Nanos{0}; }),
              HasSubstr("choice '20 mm'"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[1].choices[1].variants.clear(); }),
              HasSubstr("no level"));
  EXPECT_THAT(refusal([](auto& r) {
                for (auto& t : r.tasks) t.choices.resize(3, {"c", {variant("", 1)}, {}});
              }),
              HasSubstr("combinations"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].policy = rt::MissPolicy::kCatchUp; }),
              HasSubstr("Ring"));
  EXPECT_THAT(refusal([](auto& r) {
                r.tasks[0].policy = rt::MissPolicy::kCatchUp;
                r.tasks[0].ring_fed = true;
              }),
              HasSubstr("catch_up_max"));
  auto catches_up = demo(2);
  catches_up.tasks[0].policy = rt::MissPolicy::kCatchUp;
  catches_up.tasks[0].ring_fed = true;
  catches_up.tasks[0].catch_up_max = 1;
  EXPECT_EQ(rt::admit(catches_up).refusal, "");
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].parent = "nobody"; }), HasSubstr("'nobody'"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].parent = "fusion"; }), HasSubstr("its parent"));
  EXPECT_THAT(refusal([](auto& r) {
                r.tasks[2].forks = 1;
                r.tasks.push_back(r.tasks[2]);
                r.tasks.back().parent = "prediction";
              }),
              HasSubstr("forks no further"));
  EXPECT_THAT(refusal([](auto& r) {
                r.tasks.push_back(r.tasks[2]);
                r.tasks.back().parent = "prediction";
              }),
              HasSubstr("forks must be at least 1"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].forks = -1; }), HasSubstr("negative"));
  EXPECT_THAT(refusal([](auto& r) { r.tasks[0].spin_lead = Nanos{-1}; }), HasSubstr("spin"));
  EXPECT_THAT(refusal([](auto& r) { r.degrade_order = {"fuson"}; }), HasSubstr("fuson"));
  EXPECT_THAT(refusal([](auto& r) { r.best_effort[0].share = std::nan(""); }), HasSubstr("link"));
  EXPECT_THAT(refusal([](auto& r) { r.platform[0].priority = 40; }), HasSubstr("sentinel"));
  EXPECT_THAT(refusal([](auto& r) {
                while (r.tasks.size() < 80) r.tasks.push_back(spec("x", {1, 1}, 0.001));
              }),
              HasSubstr("80 tasks"));
}

TEST(Admission, RandomRequestsAreSoundAndRepeat) {
  std::printf("seeds 1..500\n");
  int admitted = 0, lowered = 0;
  for (std::uint64_t seed = 1; seed <= 500; ++seed) {
    rt::Random rng(seed, 3);
    AdmissionRequest r;
    const auto cores = rng.integer(1, 4);
    for (std::int64_t c = 0; c < cores; ++c) r.cpus.push_back(static_cast<int>(c * 2));
    const auto n = rng.integer(1, 10);
    for (std::int64_t i = 0; i < n; ++i) {
      const rt::Rate rate{rng.integer(5, 1000), rng.integer(1, 3)};
      const double period_ms = 1e3 / rate.hz();
      const double c_ms = period_ms * rng.uniform(0.01, 0.7);
      TaskSpec s = spec(std::string("t").append(std::to_string(i)), rate, c_ms);
      if (rng.integer(0, 3) == 0) s.core = static_cast<int>(rng.integer(0, cores - 1));
      if (rng.integer(0, 1) == 0) {
        s.variants = {variant("full", c_ms), variant("half", c_ms / 2),
                      variant("tenth", c_ms / 10)};
      }
      r.tasks.push_back(s);
    }
    const auto a = rt::admit(r);
    EXPECT_EQ(rt::report_table(a), rt::report_table(rt::admit(r))) << "seed " << seed;
    if (!a.admitted) {
      EXPECT_FALSE(a.refusal.empty());
      continue;
    }
    ++admitted;
    lowered += a.steps.empty() ? 0 : 1;
    expect_sound(r, a);
    EXPECT_GE(a.growth, 1.0) << "seed " << seed;
  }
  std::printf("%d of 500 admitted, %d of them with smaller variants\n", admitted, lowered);
  EXPECT_GT(admitted, 100);
  EXPECT_LT(admitted, 450);
  EXPECT_GT(lowered, 20);
}

TEST(Admission, AffinityMaskIsRead) {
  const auto cpus = rt::affinity_cpus();
  ASSERT_FALSE(cpus.empty());
  cpu_set_t before, one;
  ASSERT_EQ(sched_getaffinity(0, sizeof before, &before), 0);
  for (const int c : cpus) EXPECT_TRUE(CPU_ISSET(c, &before));
  CPU_ZERO(&one);
  CPU_SET(cpus.back(), &one);
  ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
  EXPECT_EQ(rt::affinity_cpus(), std::vector<int>{cpus.back()});
  ASSERT_EQ(sched_setaffinity(0, sizeof before, &before), 0);
}

}  // namespace

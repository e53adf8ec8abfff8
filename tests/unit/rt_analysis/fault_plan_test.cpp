#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "config/fault_plan.hpp"
#include "rt/fault/plan.hpp"
#include "tests/support/paths.hpp"

namespace {

using rt::FaultEntry;
using rt::FaultKind;
using rt::FaultPlan;
using rt::Nanos;
using testing::HasSubstr;

FaultEntry entry(FaultKind kind, std::string target, Nanos magnitude = Nanos{1000}) {
  FaultEntry e;
  e.kind = kind;
  e.target = std::move(target);
  e.magnitude = magnitude;
  return e;
}

TEST(FaultPlan, FirstEveryAndCountAreExact) {
  FaultPlan plan;
  plan.entries.push_back(entry(FaultKind::kExtraCpu, "haptic"));
  plan.entries[0].first = 10;
  plan.entries[0].every = 7;
  plan.entries[0].count = 3;
  std::vector<std::uint64_t> at;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    if (rt::decide_task(plan, rt::target_hash("haptic"), k).any()) at.push_back(k);
  }
  EXPECT_EQ(at, (std::vector<std::uint64_t>{10, 17, 24}));
  EXPECT_FALSE(rt::decide_task(plan, rt::target_hash("fusion"), 10).any());
  EXPECT_FALSE(rt::decide_edge(plan, rt::target_hash("haptic"), 10).any());
}

TEST(FaultPlan, ProbabilityIsHitAndDrawsAreIndependent) {
  FaultPlan plan;
  plan.seed = 42;
  std::printf("seed %llu\n", static_cast<unsigned long long>(plan.seed));
  constexpr int kN = 200'000;
  for (const double p : {0.0, 0.001, 0.1, 0.5, 0.97, 1.0}) {
    FaultEntry a = entry(FaultKind::kDrop, "e");
    a.probability = p;
    FaultEntry b = a;
    b.seed = 1;
    int hits = 0, both = 0, runs = 0;
    bool before = false;
    for (int n = 0; n < kN; ++n) {
      const bool x = rt::fires(a, plan.seed, rt::target_hash("e"), static_cast<std::uint64_t>(n));
      const bool y = rt::fires(b, plan.seed, rt::target_hash("e"), static_cast<std::uint64_t>(n));
      hits += x ? 1 : 0;
      both += x && y ? 1 : 0;
      runs += x && before ? 1 : 0;
      before = x;
    }
    const auto within = [&](int count, double q) {
      EXPECT_NEAR(count, kN * q, 4.5 * std::sqrt(kN * q * (1 - q)) + 1) << "p = " << p;
    };
    within(hits, p);
    within(both, p * p);  // another seed of the entry draws anew
    within(runs, p * p);  // neighbours do not know each other
  }
}

TEST(FaultPlan, SeedTargetKindAndIndexAllMatter) {
  FaultEntry e = entry(FaultKind::kDrop, "a");
  e.probability = 0.5;
  const auto bits = [&](const FaultEntry& x, std::uint64_t seed, const char* target) {
    std::uint64_t v = 0;
    for (std::uint64_t n = 0; n < 64; ++n) {
      v |= static_cast<std::uint64_t>(rt::fires(x, seed, rt::target_hash(target), n)) << n;
    }
    return v;
  };
  FaultEntry other_kind = e;
  other_kind.kind = FaultKind::kNan;
  const std::uint64_t base = bits(e, 1, "a");
  EXPECT_NE(base, bits(e, 2, "a"));
  EXPECT_NE(base, bits(e, 1, "b"));
  EXPECT_NE(base, bits(other_kind, 1, "a"));
  EXPECT_EQ(base, bits(e, 1, "a"));
}

TEST(FaultPlan, DecisionsAreTheSameOnEveryMachine) {
  // Values of the first build: a change of the hash would silently change every shipped plan.
  EXPECT_EQ(rt::target_hash("haptic"), 0x2e59d1bf2206d41bULL);
  FaultEntry e = entry(FaultKind::kDrop, "capture.rgbd_frame");
  e.probability = 0.25;
  e.seed = 7;
  std::uint64_t v = 0;
  for (std::uint64_t n = 0; n < 64; ++n) {
    v |= static_cast<std::uint64_t>(rt::fires(e, 1, rt::target_hash("capture.rgbd_frame"), n)) << n;
  }
  EXPECT_EQ(v, 0x4400014088888385ULL);
}

TEST(FaultPlan, MagnitudesAddAndOrderOfQuestionsDoesNotMatter) {
  FaultPlan plan;
  plan.entries = {
      entry(FaultKind::kExtraCpu, "t", Nanos{10}),   entry(FaultKind::kExtraCpu, "t", Nanos{5}),
      entry(FaultKind::kTheft, "t", Nanos{7}),       entry(FaultKind::kBlock, "t", Nanos{3}),
      entry(FaultKind::kPriorityHog, "t", Nanos{2}), entry(FaultKind::kLateRelease, "t", Nanos{1}),
      entry(FaultKind::kPageFault, "t", Nanos{0})};
  const auto hash = rt::target_hash("t");
  const auto f = rt::decide_task(plan, hash, 3);
  EXPECT_EQ(f.extra_cpu.count(), 15);
  EXPECT_EQ(f.theft.count(), 7);
  EXPECT_EQ(f.block.count(), 3);
  EXPECT_EQ(f.hog.count(), 2);
  EXPECT_EQ(f.late.count(), 1);
  EXPECT_TRUE(f.touch_page);
  EXPECT_EQ(f.page_fault.count(), 0);
  EXPECT_FALSE(f.dead);
  static_cast<void>(rt::decide_task(plan, hash, 99));
  EXPECT_EQ(rt::decide_task(plan, hash, 3).extra_cpu.count(), 15);
}

TEST(FaultPlan, EdgeFaults) {
  FaultPlan plan;
  plan.entries = {entry(FaultKind::kRingFull, "e"), entry(FaultKind::kDrop, "e"),
                  entry(FaultKind::kDuplicate, "e"), entry(FaultKind::kNan, "e"),
                  entry(FaultKind::kStale, "e", Nanos{9})};
  const auto f = rt::decide_edge(plan, rt::target_hash("e"), 0);
  EXPECT_TRUE(f.ring_full && f.drop && f.duplicate && f.nan);
  EXPECT_EQ(f.stale.count(), 9);
  EXPECT_FALSE(rt::decide_edge(plan, rt::target_hash("f"), 0).any());
}

TEST(FaultPlan, ADeadThreadStaysDead) {
  FaultPlan plan;
  plan.entries = {entry(FaultKind::kDeadThread, "t", Nanos{0})};
  plan.entries[0].first = 5;
  EXPECT_FALSE(rt::decide_task(plan, rt::target_hash("t"), 4).dead);
  for (std::uint64_t k = 5; k < 50; ++k) {
    EXPECT_TRUE(rt::decide_task(plan, rt::target_hash("t"), k).dead);
  }
}

TEST(FaultPlan, TargetPlanAnswersAsTheWholePlan) {
  FaultPlan plan;
  plan.seed = 9;
  for (int i = 0; i < 20; ++i) {
    plan.entries.push_back(entry(static_cast<FaultKind>(i % 12), i % 3 == 0 ? "a" : "b"));
    plan.entries.back().probability = 0.3;
    plan.entries.back().seed = static_cast<std::uint64_t>(i);
    if (plan.entries.back().kind == FaultKind::kDeadThread) plan.entries.pop_back();
  }
  const rt::TargetPlan a(plan, "a"), none(plan, "c");
  EXPECT_TRUE(none.empty());
  for (std::uint64_t n = 0; n < 500; ++n) {
    const auto x = a.task(n), y = rt::decide_task(plan, rt::target_hash("a"), n);
    EXPECT_EQ(x.late, y.late);
    EXPECT_EQ(x.extra_cpu, y.extra_cpu);
    EXPECT_EQ(x.theft, y.theft);
    EXPECT_EQ(a.edge(n).drop, rt::decide_edge(plan, rt::target_hash("a"), n).drop);
    EXPECT_FALSE(none.task(n).any());
  }
}

TEST(FaultPlan, NamesGoRoundAndBadOnesListTheAllowed) {
  const auto names = rt::fault_kind_names();
  ASSERT_EQ(names.size(), 12U);
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(rt::name_of(rt::fault_kind(names[i]).value()), names[i]);
    EXPECT_EQ(static_cast<std::size_t>(rt::fault_kind(names[i]).value()), i);
  }
  EXPECT_THAT(rt::fault_kind("teft").error(), HasSubstr("theft"));
}

TEST(FaultPlan, CheckNamesWhatIsWrong) {
  const std::vector<std::string> tasks{"haptic"}, edges{"haptic.force"};
  const auto message = [&](FaultEntry e) {
    FaultPlan plan;
    plan.name = "p";
    plan.entries = {entry(FaultKind::kExtraCpu, "haptic"), std::move(e)};
    const auto r = rt::check(plan, tasks, edges);
    return r.has_value() ? std::string() : r.error();
  };
  EXPECT_EQ(message(entry(FaultKind::kTheft, "haptic")), "");
  EXPECT_EQ(message(entry(FaultKind::kNan, "haptic.force", Nanos{0})), "");
  EXPECT_THAT(message(entry(FaultKind::kTheft, "haptik")),
              HasSubstr("no such task (there are: haptic)"));
  EXPECT_THAT(message(entry(FaultKind::kNan, "haptic")), HasSubstr("no such edge"));
  EXPECT_THAT(message(entry(FaultKind::kTheft, "haptic", Nanos{0})), HasSubstr("fault 2"));
  EXPECT_THAT(message(entry(FaultKind::kDeadThread, "haptic")), HasSubstr("only `first`"));
  FaultEntry e = entry(FaultKind::kTheft, "haptic");
  e.every = 0;
  EXPECT_THAT(message(e), HasSubstr("every = 0"));
  e.every = 1;
  e.probability = std::nan("");
  EXPECT_THAT(message(e), HasSubstr("probability"));
}

// ---- the TOML binding and the shipped plans ----

std::string write_temp(const std::string& text) {
  static int n = 0;
  const auto path = std::filesystem::temp_directory_path() /
                    ("teletact_plan_" + std::to_string(::getpid()) + "_" + std::to_string(n++));
  std::ofstream(path) << text;
  return path.string();
}

TEST(FaultPlanFile, ReadsEveryKey) {
  const std::string path = write_temp(
      "name = \"p\"\nseed = 3\n[[fault]]\nkind = \"stale\"\ntarget = \"a.b\"\nfirst = 4\nevery = "
      "5\n"
      "count = 6\nprobability = 0.5\nseed = 8\nmagnitude_us = 7700.5\n");
  const auto plan = config::load_fault_plan(path);
  ASSERT_TRUE(plan.has_value()) << plan.error();
  ASSERT_EQ(plan.value().entries.size(), 1U);
  const auto& e = plan.value().entries[0];
  EXPECT_EQ(plan.value().seed, 3U);
  EXPECT_EQ(e.kind, FaultKind::kStale);
  EXPECT_EQ(e.target, "a.b");
  EXPECT_EQ(e.first, 4U);
  EXPECT_EQ(e.every, 5U);
  EXPECT_EQ(e.count, 6U);
  EXPECT_EQ(e.probability, 0.5);
  EXPECT_EQ(e.seed, 8U);
  EXPECT_EQ(e.magnitude.count(), 7'700'500);
  std::filesystem::remove(path);
}

TEST(FaultPlanFile, BadFilesAreNamed) {
  const auto error = [](const std::string& text) {
    const std::string path = write_temp(text);
    const auto plan = config::load_fault_plan(path);
    std::filesystem::remove(path);
    EXPECT_FALSE(plan.has_value());
    return plan.has_value() ? std::string() : plan.error();
  };
  EXPECT_THAT(error("[[fault]]\nkind = \"teft\"\n"), HasSubstr("teft"));
  EXPECT_THAT(error("[[fault]]\nkindd = \"theft\"\n"), HasSubstr("kindd"));
  EXPECT_THAT(error("[[fault]]\nkind = \"theft\"\ntarget = \"x\"\nevery = 0\n"),
              HasSubstr("every"));
  EXPECT_THAT(error("[[fault]]\nkind = \"theft\"\ntarget = \"x\"\n"), HasSubstr("magnitude"));
  EXPECT_THAT(error("[[fault]]\nkind = \"theft\"\nmagnitude_us = 1\n"), HasSubstr("target"));
}

TEST(FaultPlanFile, EveryShippedPlanLoadsAndActs) {
  const std::filesystem::path folder = tests::in_tree("config/faults");
  int plans = 0;
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    if (file.path().extension() != ".toml") continue;
    ++plans;
    const auto plan = config::load_fault_plan(file.path().string());
    ASSERT_TRUE(plan.has_value()) << plan.error();
    EXPECT_EQ(plan.value().name, file.path().stem().string());
    for (const FaultEntry& e : plan.value().entries) {
      bool acts = false;  // within 20 s of its own rate, at most 1 kHz
      for (std::uint64_t n = 0; n < 20'000 && !acts; ++n) {
        acts = rt::decide_task(plan.value(), rt::target_hash(e.target), n).any() ||
               rt::decide_edge(plan.value(), rt::target_hash(e.target), n).any();
      }
      EXPECT_TRUE(acts) << file.path();
    }
  }
  EXPECT_GE(plans, 10);
}

TEST(FaultPlanFile, ExtraCpuPlanHasAHundredJobsInTwentySeconds) {
  const auto plan = config::load_fault_plan(tests::in_tree("config/faults/extra_cpu.toml"));
  ASSERT_TRUE(plan.has_value()) << plan.error();
  int jobs = 0;
  for (std::uint64_t k = 0; k < 20'000; ++k) {
    const auto f = rt::decide_task(plan.value(), rt::target_hash("haptic"), k);
    if (f.extra_cpu == Nanos{2'000'000}) ++jobs;
  }
  EXPECT_EQ(jobs, 100);
}

}  // namespace

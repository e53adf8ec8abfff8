// The console's bench: a result that is just within every limit, and for each limit one that is
// just beyond it; what was not measured says why and misses nothing. And who counts as another
// program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <set>
#include <sstream>

#include "tools/measure/bench/console/console_bench.hpp"
#include "tools/measure/bench/console/foreign_load.hpp"

namespace teletact {
namespace {

using ::testing::HasSubstr;

StopPart good_stops() {
  StopPart s;
  s.one_way_ms = 20;
  s.stops.assign(50, StopSeen{0.3, 50, 4, 140});
  s.notes = 50000;
  s.notes_per_s = 1000;
  s.refused = 40000;
  return s;
}

ActsPart good_acts() {
  ActsPart a;
  const std::vector<double> fifty(20, 50.0), slow(20, 130.0), answers(20, 200.0);
  a.acts = {{"hand", "haptic", fifty, {}, 0},
            {"draw", "fusion", fifty, answers, 0},
            {"undo", "fusion", fifty, answers, 0},
            {"hold", "supervision", fifty, answers, 0},
            {"go_to", "planning", slow, answers, 0}};
  a.mesh_ms.assign(20, 100.0);
  a.pixels_ms.assign(20, 200.0);
  a.fps = 5;
  return a;
}

CostPart good_cost() {
  CostPart c;
  c.without = c.with = 5e8;
  c.sched_with = c.sched_without = "\"12\"";
  c.log_with = c.log_without = "\"34\"";
  c.fusion_closed_ms.assign(10, 10.0);
  c.fusion_open_ms.assign(10, 10.99);
  c.late_open_us.assign(10, 5.0);
  c.late_closed_us.assign(10, 4.0);
  c.server_share = 0.05;
  return c;
}

GrowthPart good_growth() {
  GrowthPart g;
  g.server_MB.assign(100, 50.0);
  g.heap_MB.assign(100, 20.0);
  g.renderer_MB.assign(100, 200.0);
  for (std::size_t i = 90; i < 100; ++i)
    g.server_MB[i] = 50.9, g.heap_MB[i] = 20.9, g.renderer_MB[i] = 209;
  return g;
}

ConsoleBenchResult just_good() {
  return {"here", good_stops(), good_acts(), good_cost(), good_growth()};
}

std::string printed(const ConsoleBenchResult& r) {
  std::ostringstream text;
  r.print(text);
  return text.str();
}

TEST(ConsoleBench, EachLimitCanBeMissed) {
  const ConsoleBenchResult good = just_good();
  ASSERT_EQ(good.missed(), 0) << printed(good);
  EXPECT_EQ(count(good.limits(), Limit::State::kNotMeasured), 0) << printed(good);
  using Spoil = std::function<void(ConsoleBenchResult&)>;
  std::vector<Spoil> spoils{[](auto& r) { r.stop->stops[7].falls_ms = 50.1; },
                            [](auto& r) { r.stop->notes_per_s = 800; },
                            [](auto& r) { r.stop->refused = 0; },
                            [](auto& r) { r.acts->mesh_ms.assign(20, 100.1); },
                            [](auto& r) { r.acts->fps = 4.9; },
                            [](auto& r) { r.acts->acts[1].answer_ms.assign(20, 200.1); },
                            [](auto& r) { r.cost->with += 501; },
                            [](auto& r) { r.cost->log_with = "\"35\""; },
                            [](auto& r) { r.cost->fusion_open_ms.assign(10, 11.1); },
                            [](auto& r) { r.cost->server_share = 0.051; },
                            [](auto& r) { r.cost->own_misses = 1; },
                            [](auto& r) { std::fill_n(r.growth->server_MB.rbegin(), 10, 51.1); },
                            [](auto& r) { std::fill_n(r.growth->heap_MB.rbegin(), 10, 21.1); },
                            [](auto& r) { std::fill_n(r.growth->renderer_MB.rbegin(), 10, 211); }};
  for (std::size_t i = 0; i < 5; ++i)
    spoils.push_back([i](auto& r) { r.acts->acts[i].task_ms.assign(20, 130.1); });
  std::set<std::string> reached;
  for (const Spoil& spoil : spoils) {
    ConsoleBenchResult bad = good;
    spoil(bad);
    EXPECT_EQ(bad.missed(), 1) << printed(bad);
    for (const Limit& l : bad.limits())
      if (l.state == Limit::State::kMissed) reached.insert(l.what);
  }
  EXPECT_EQ(reached.size(), good.limits().size()) << "a limit that nothing here misses";
}

TEST(ConsoleBench, AStopThatWasNotSeenOrRampsTooSlowlyIsNotInTime) {
  for (const StopSeen& bad : {StopSeen{0.3, NAN, NAN, NAN}, StopSeen{0.3, 40, 3.5, 150}}) {
    ConsoleBenchResult r = just_good();
    r.stop->stops[0] = bad;
    EXPECT_EQ(r.missed(), 1) << printed(r);
  }
  ConsoleBenchResult none = just_good();
  none.stop->stops.clear();
  EXPECT_EQ(none.missed(), 1) << "no stop is no success";
}

TEST(ConsoleBench, WhatWasNotMeasuredSaysWhy) {
  const ConsoleBenchResult nothing;
  EXPECT_EQ(nothing.missed(), 0);
  EXPECT_EQ(count(nothing.limits(), Limit::State::kMet), 0);
  EXPECT_TRUE(nothing.metrics().empty());

  ConsoleBenchResult ended = just_good();
  ended.stop->problem = "supervision did not engage";
  ended.stop->stops.clear();
  EXPECT_EQ(ended.missed(), 0);
  EXPECT_THAT(printed(ended), HasSubstr("not measured: supervision did not engage"));

  ConsoleBenchResult busy = just_good();
  busy.acts->busy = "others used 2.00 of a core, 0.05 is allowed";
  busy.acts->fps = 1;
  EXPECT_EQ(busy.missed(), 0) << "a figure of time on a machine that others use";
  EXPECT_THAT(printed(busy), HasSubstr("others used 2.00"));
  busy.cost->busy = busy.acts->busy;
  busy.cost->with += 501;
  EXPECT_EQ(busy.missed(), 1) << "instructions do not depend on it";

  ConsoleBenchResult blind = just_good();
  blind.acts = ActsPart{};
  blind.acts->no_browser = "no chromium";
  blind.growth = GrowthPart{};
  blind.growth->no_browser = "no chromium";
  EXPECT_EQ(blind.missed(), 0) << printed(blind);
  EXPECT_THAT(printed(blind), HasSubstr("not measured: no chromium"));
}

TEST(ForeignLoad, AProcessIsReadWhateverItsName) {
  ProcessStat s;
  ASSERT_TRUE(
      read_process_stat("42 (a) (b c) S 7 1 1 0 -1 4194560 1 2 3 4 100 23 5 6 20 0 1 0 999 1", s));
  EXPECT_EQ(s.pid, 42);
  EXPECT_EQ(s.parent, 7);
  EXPECT_EQ(s.ticks, 123U);
  EXPECT_EQ(s.born, 999U);
  EXPECT_FALSE(read_process_stat("", s));
  EXPECT_FALSE(read_process_stat("42 (a) S 7", s));
}

TEST(ForeignLoad, OthersAreThoseThatAreNeitherBelowNorTheKernel) {
  std::map<pid_t, ProcessStat> all;
  for (const auto& [pid, parent] : std::map<pid_t, pid_t>{
           {1, 0}, {2, 0}, {3, 2}, {10, 1}, {20, 10}, {21, 20}, {30, 1}, {31, 30}})
    all[pid] = {pid, parent, 0, 0};
  const auto others = foreign(all, 20);
  std::set<pid_t> pids;
  for (const auto& [pid, s] : others) pids.insert(pid);
  EXPECT_EQ(pids, (std::set<pid_t>{1, 10, 30, 31}));
  all[30].parent = 31;  // read while it changed: a circle ends
  EXPECT_EQ(foreign(all, 20).size(), 4U);
}

}  // namespace
}  // namespace teletact

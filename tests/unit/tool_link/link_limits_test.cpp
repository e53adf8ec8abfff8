// The link's bench: a result that is just within every limit, and for each limit one that is just
// over it; what was not measured says why and misses nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <set>
#include <sstream>

#include "tools/measure/bench/link/link_bench.hpp"

namespace teletact {
namespace {

using ::testing::HasSubstr;

LinkBenchResult just_good() {
  LinkBenchResult r;
  r.congestion = {"bbr", "cubic"};
  for (const auto& name : link_run_names()) {
    if (name == "pairs") continue;
    LinkRow& row = r.rows[name];
    row.robot_congestion = row.operator_congestion = "bbr";
    row.window = {60, 1740, 6000, 29, 110, 200, 220, 150, 5, 0, 0};
    row.depth_over_sensor = 0.999;
    row.over_stall_ms = 50;
    row.after_rate_p95_ms = 400;
    row.thin_spared = row.wide_spared = 0.5;
    row.felt_p95_ms = 140;
    row.felt = 9;
    row.link_cpu = row.link_declared = 0.2;
    row.drive = {true, 6, {395, 1}, {400, 1}};
  }
  LinkPairs& pairs = r.pairs.emplace();
  pairs.idle.tick_instructions = pairs.saturated.tick_instructions = 5714;
  pairs.idle.late_us = {{{10, 12, 9}, {20, 21, 22}}},
  pairs.saturated.late_us = {{{11, 14, 9}, {19, 24, 22}}};
  r.rows["strict"].window.fps = 24;
  r.rows["loss"].window.fps = 25;
  r.rows["own_clock"].window.age_p95_ms = r.rows["rest"].window.age_p95_ms + 12;
  r.rows["drive_loss"].drive.time_s = r.rows["drive_stall"].drive.time_s = 9;
  return r;
}

std::string printed(const LinkBenchResult& r) {
  std::ostringstream text;
  r.print(text);
  return text.str();
}

TEST(LinkBench, EachLimitCanBeMissed) {
  const LinkBenchResult good = just_good();
  ASSERT_EQ(good.missed(), 0) << printed(good);
  using Spoil = std::function<void(LinkBenchResult&)>;
  const auto window = [](const char* run, double LinkWindow::*of, double to) {
    return Spoil([=](LinkBenchResult& r) { r.rows[run].window.*of = to; });
  };
  const auto row = [](const char* run, double LinkRow::*of, double to) {
    return Spoil([=](LinkBenchResult& r) { r.rows[run].*of = to; });
  };
  std::vector<Spoil> spoils{
      window("rest", &LinkWindow::fps, 28.9),
      row("rest", &LinkRow::depth_over_sensor, 1),
      window("rest", &LinkWindow::age_p95_ms, 200.1),
      row("rest", &LinkRow::felt_p95_ms, 140.1),
      window("own_clock", &LinkWindow::fps, 28.9),
      window("own_clock", &LinkWindow::age_p95_ms, 212.1),
      window("strict", &LinkWindow::fps, 23.9),
      window("lenient", &LinkWindow::fps, 28.9),
      window("strict", &LinkWindow::age_p95_ms, 200.1),
      window("lenient", &LinkWindow::age_p95_ms, 200.1),
      window("saturated", &LinkWindow::state_p95_ms, 150.1),
      row("stall", &LinkRow::over_stall_ms, 50.1),
      row("rate", &LinkRow::after_rate_p95_ms, 400.1),
      [](LinkBenchResult& r) { r.rows["rate"].thin_spared = r.rows["rate"].wide_spared = 0.49; },
      row("rate", &LinkRow::wide_spared, 0.51),
      window("loss", &LinkWindow::fps, 24.9),
      [](LinkBenchResult& r) { r.rows["drive"].drive.arrived = false; },
      [](LinkBenchResult& r) {
        r.rows["drive_stall"].drive.silence = {396, 1};
      },
      [](LinkBenchResult& r) { r.pairs->saturated.own_misses = 1; },
      [](LinkBenchResult& r) { r.pairs->saturated.tick_instructions = 5715; }};
  for (const char* run : {"rest", "strict", "lenient", "saturated"})
    spoils.push_back(row(run, &LinkRow::link_cpu, 0.201));
  spoils.push_back([](LinkBenchResult& r) { r.rows["drive_loss"].drive.gaps = {401, 1}; });
  for (const char* run : {"drive_loss", "drive_stall"}) {
    spoils.push_back([run](LinkBenchResult& r) { r.rows[run].drive.arrived = false; });
    spoils.push_back([run](LinkBenchResult& r) { r.rows[run].drive.time_s = 9.1; });
  }
  std::set<std::string> reached;
  for (const Spoil& spoil : spoils) {
    LinkBenchResult bad = good;
    spoil(bad);
    EXPECT_EQ(bad.missed(), 1) << printed(bad);
    for (const Limit& l : bad.limits())
      if (l.state == Limit::State::kMissed) reached.insert(l.what);
  }
  EXPECT_EQ(reached.size(), good.limits().size()) << "a limit that nothing here misses";
}

TEST(LinkBench, WhatWasNotMeasuredSaysWhy) {
  LinkBenchResult none;
  none.refusal = "needs root";
  EXPECT_EQ(none.missed(), 0);
  EXPECT_EQ(count(none.limits(), Limit::State::kMet), 0);
  EXPECT_THAT(printed(none), HasSubstr("not measured: the road needs root"));
  EXPECT_TRUE(none.metrics().empty());

  LinkBenchResult one = just_good();
  one.rows["stall"].problem = "robot ended with 3";
  EXPECT_EQ(one.missed(), 0);
  EXPECT_EQ(count(one.limits(), Limit::State::kNotMeasured), 1) << printed(one);
  EXPECT_THAT(printed(one), HasSubstr("not measured: robot ended with 3"));

  LinkBenchResult busy = just_good();
  busy.rows["rest"].busy = "others used 2.00 of a core, 0.05 is allowed";
  busy.rows["rest"].window.fps = 11;
  EXPECT_EQ(busy.missed(), 0) << "a figure of time on a machine that others use";
  EXPECT_THAT(printed(busy), HasSubstr("others used 2.00"));
  busy.rows["rest"].depth_over_sensor = 1.2;
  EXPECT_EQ(busy.missed(), 1) << "what the bytes say does not depend on it";

  LinkBenchResult plain = just_good();
  plain.congestion = {"cubic"};
  plain.rows["loss"].window.fps = 5;
  EXPECT_EQ(plain.missed(), 0);
  EXPECT_THAT(printed(plain), HasSubstr("this kernel has no bbr"));

  LinkBenchResult nothing_felt = just_good();
  nothing_felt.rows["rest"].felt = 0;
  EXPECT_THAT(printed(nothing_felt), HasSubstr("the hand touched nothing"));

  LinkBenchResult other = just_good();
  other.pairs->busy = "others used 2.00 of a core, 0.05 is allowed";
  other.pairs->idle.own_misses = 3;
  EXPECT_EQ(other.missed(), 0) << "a miss that others may have caused";
  other.pairs->idle.tick_instructions = 6000;
  EXPECT_EQ(other.missed(), 1) << "instructions do not depend on it";
  other.pairs.reset();
  EXPECT_EQ(count(other.limits(), Limit::State::kNotMeasured), 2) << printed(other);

  LinkBenchResult lost = just_good();
  lost.rows["drive_stall"].drive.arrived = false;
  lost.rows["drive_stall"].drive.missed = "goal not reached: no path was made";
  EXPECT_THAT(printed(lost), HasSubstr("no path was made"));

  LinkBenchResult stood = just_good();
  stood.rows["drive_stall"].drive.silence = {0, 0};
  EXPECT_EQ(count(stood.limits(), Limit::State::kNotMeasured), 1);
  stood.rows["drive_loss"].drive.gaps = {0, 0};
  EXPECT_EQ(count(stood.limits(), Limit::State::kNotMeasured), 2);
}

TEST(LinkBench, ItsFiguresHaveTheirNames) {
  std::set<std::string> names;
  for (const auto& m : just_good().metrics()) names.insert(m.name);
  for (const char* state : {"rest", "moving"})
    for (const char* what :
         {"fps", "age_p95_ms", "state_age_p95_ms", "mbit_s", "depth_err_over_sensor"})
      EXPECT_EQ(names.count(std::string("link.") + state + "." + what), 1U) << state << what;
  EXPECT_EQ(names.count("link.loss.drive_time_ratio"), 1U);
  for (const auto& m : just_good().metrics()) {
    if (m.name == "link.pairs.robot_io_late_us") {
      EXPECT_EQ(m.value, 0) << "of -1, 0, 3: 0";
    }
  }
  EXPECT_EQ(names.count("link.pairs.robot_io_late_us"), 1U);
}

}  // namespace
}  // namespace teletact

// Every limit of every bench can be missed: a result that is just within all of them, and for each
// limit one that is just over it. tool_accuracy has the same of drift, fusion and table1.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <set>
#include <sstream>

#include "tools/measure/bench/audit_bench.hpp"
#include "tools/measure/bench/fuzz.hpp"
#include "tools/measure/bench/log_bench.hpp"
#include "tools/measure/bench/rings.hpp"
#include "tools/measure/bench/table1_instructions.hpp"
#include "tools/measure/bench/table2/table2.hpp"
#include "tools/measure/bench/table2/touches.hpp"
#include "tools/measure/bench/wakeup.hpp"
#include "tools/measure/haptic/bench_haptic.hpp"
#include "tools/measure/haptic/boundary.hpp"
#include "tools/measure/haptic/recording_touch.hpp"

namespace teletact {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <class Result>
std::string printed(const Result& r) {
  std::ostringstream text;
  r.print(text);
  return text.str();
}

template <class Result>
struct Spoil {
  const char* what;  // begin of the limit's name
  std::function<void(Result&)> spoil;
};

// `spoils`: at least one for each limit; each misses its own and no other.
template <class Result>
void expect_each_limit_can_be_missed(const Result& good, const std::vector<Spoil<Result>>& spoils) {
  EXPECT_EQ(good.missed(), 0) << printed(good);
  const auto all = good.limits();
  EXPECT_THAT(printed(good),
              HasSubstr(std::to_string(all.size()) + " met, 0 MISSED, 0 not measured\n"));
  std::set<std::string> reached;
  for (const auto& s : spoils) {
    Result bad = good;
    s.spoil(bad);
    EXPECT_EQ(bad.missed(), 1) << s.what << printed(bad);
    EXPECT_THAT(printed(bad), HasSubstr(" MISSED\n")) << s.what;
    EXPECT_THAT(printed(bad), HasSubstr(" met, 1 MISSED")) << s.what;
    for (const Limit& l : bad.limits()) {
      if (l.state != Limit::State::kMissed) continue;
      EXPECT_EQ(l.what.rfind(s.what, 0), 0U) << l.what;
      reached.insert(l.what + l.sense);
    }
  }
  EXPECT_EQ(reached.size(), all.size()) << "a limit that nothing here misses";
}

// Nothing met, nothing missed but `met` limits; the reason is said.
template <class Result>
void expect_not_measured(const Result& r, int not_measured, const std::string& why) {
  EXPECT_EQ(r.missed(), 0) << printed(r);
  EXPECT_EQ(count(r.limits(), Limit::State::kNotMeasured), not_measured) << printed(r);
  EXPECT_THAT(printed(r), HasSubstr("not measured: " + why));
}

TEST(Limit, IsMetMissedOrNotMeasured) {
  Limits l;
  l.add("at most", 2, "<=", 2);
  l.add("below", 2, "<", 2);
  l.add("at least", 2, ">=", 2);
  l.add("no number", kNaN, "<=", 2);
  l.add("nobody there", kNaN, "<=", 2, "not installed");
  l.add("over, but disturbed", 3, "<=", 2, disturbed(0.2));
  EXPECT_EQ(disturbed(0.05), "");
  EXPECT_EQ(missed(l.all()), 2);
  EXPECT_EQ(count(l.all(), Limit::State::kMet), 2);
  std::ostringstream text;
  print(text, l.all());
  EXPECT_THAT(text.str(), HasSubstr("-  <= 2        not measured: not installed\n"));
  EXPECT_THAT(text.str(),
              HasSubstr("3  <= 2        not measured: others used 0.20 of a core, 0.05"));
  EXPECT_THAT(text.str(), HasSubstr("2 met, 2 MISSED, 2 not measured\n"));
}

TEST(BenchLimits, Rings) {
  using R = RingsResult;
  R good;
  good.measured = true;
  for (const auto size : {R::k8B, R::k256B}) {
    good.queue[R::kOwn][size][R::kNear].Mops = 95;
    good.queue[R::kBoost][size][R::kNear].Mops = 50;
    good.queue[R::kMoodycamel][size][R::kNear].Mops = 100;
  }
  good.queue[R::kOwn][R::k8B][R::kNear].rtt_over_line = 1.3;
  good.latest[R::kNear].read_ns = 600, good.latest[R::kNear].rounds = 7;
  expect_each_limit_can_be_missed<R>(
      good,
      {{"own / best of the others, 8B", [](R& r) { r.queue[R::kOwn][R::k8B][R::kNear].Mops = 94; }},
       {"own / best of the others, 256B",
        [](R& r) { r.queue[R::kBoost][R::k256B][R::kNear].Mops = 101; }},
       {"round trip", [](R& r) { r.queue[R::kOwn][R::k8B][R::kNear].rtt_over_line = 1.31; }},
       {"a read of Latest", [](R& r) { r.latest[R::kNear].read_ns = 601; }},
       {"torn", [](R& r) { r.latest_torn = 1; }}});
  R slow = good;
  slow.latest[R::kNear].read_ns = 900, slow.other_load = 0.2;
  expect_not_measured(slow, 4, "others used 0.20 of a core");
  slow.measured = false, slow.remark = "the cores were near in only 2 of 7 needed rounds";
  expect_not_measured(slow, 4, slow.remark);
  slow.latest_torn = 1;
  EXPECT_EQ(slow.missed(), 1) << "a torn read is one on any cores";
}

TEST(BenchLimits, Wakeup) {
  using R = WakeupResult;
  R good;
  good.fifo = true;
  good.cyclictest.resize(3);
  good.p50_cyclictest_us = 10, good.p50_plain_us = good.p50_spin_us = 16;
  expect_each_limit_can_be_missed<R>(
      good, {{"p50 to cyclictest's", [](R& r) { r.p50_plain_us = 16.1; }},
             {"p50 to cyclictest's, 30 us", [](R& r) { r.p50_spin_us = 16.1; }}});
  R bad = good;
  bad.p50_plain_us = 99, bad.fifo = false;
  expect_not_measured(bad, 2, "no SCHED_FIFO");
  bad.cyclictest.clear();
  expect_not_measured(bad, 2, "cyclictest gave no figures");
}

TEST(BenchLimits, AuditAndLog) {
  AuditBenchResult audit;
  audit.job_ns = 2000;
  expect_each_limit_can_be_missed<AuditBenchResult>(
      audit, {{"audit of a job", [](AuditBenchResult& r) { r.job_ns = 2001; }}});
  audit.job_ns = 2400, audit.other_load = 1;
  expect_not_measured(audit, 1, "others used 1.00 of a core");
  using L = LogBenchResult;
  L log;
  log.record_ns = 100;
  expect_each_limit_can_be_missed<L>(log, {{"log record", [](L& r) { r.record_ns = 101; }},
                                           {"heap", [](L& r) { r.heap_bytes = 16; }},
                                           {"voluntary", [](L& r) { r.voluntary_switches = 1; }}});
  log.record_ns = 200, log.other_load = 1;
  expect_not_measured(log, 1, "others used 1.00 of a core");
  log.heap_bytes = 16;
  EXPECT_EQ(log.missed(), 1) << "others allocate nothing of ours";
}

TEST(BenchLimits, Fuzz) {
  FuzzResult good;
  good.rows.resize(2);
  expect_each_limit_can_be_missed<FuzzResult>(
      good, {{"faults", [](FuzzResult& r) { r.rows[1].fault = "signal 11"; }}});
}

TEST(BenchLimits, Table1Instructions) {
  using R = InstructionsResult;
  R good;
  good.rows = {{"recording", 0.02, 0, 102.9, 100}, {"recording", 0.02, 2, 102.9, 100}};
  expect_each_limit_can_be_missed<R>(
      good, {{"recording 20 mm, level 0", [](R& r) { r.rows[0].frame = 103.1; }},
             {"recording 20 mm, level 2", [](R& r) { r.rows[1].frame_without = kNaN; }}});
}

TEST(BenchLimits, Table2) {
  using R = Table2Result;
  R good;
  good.images = 1;
  good.ours.mean.pri = 0.80, good.ours.mean.bde_px = 12.5;
  good.ours.mean.gce = 0.22, good.ours.mean.voi_bits = 2.2;
  good.ours.region_ratio = 1;
  expect_each_limit_can_be_missed<R>(good, {{"PRI", [](R& r) { r.ours.mean.pri = 0.799; }},
                                            {"BDE", [](R& r) { r.ours.mean.bde_px = 12.6; }},
                                            {"GCE", [](R& r) { r.ours.mean.gce = 0.221; }},
                                            {"VOI", [](R& r) { r.ours.mean.voi_bits = 2.21; }},
                                            {"regions", [](R& r) { r.ours.region_ratio = 0.49; }},
                                            {"regions", [](R& r) { r.ours.region_ratio = 2.01; }}});
  expect_not_measured(R{}, 6, "no images");
}

TEST(BenchLimits, Segmentation) {
  using R = TouchResult;
  R good;
  for (const auto& [folder, iou] : {std::pair{"mosd_learn", 0.85}, {"tabletop", 0.80}}) {
    TouchRow& row = good.rows.emplace_back();
    row.folder = folder, row.iou_default = iou;
    row.touch_ms = 12, row.follow_ms = 3.3, row.further_ms = 0.5;
  }
  std::vector<Spoil<R>> spoils{{"mosd, mean IoU", [](R& r) { r.rows[0].iou_default = 0.849; }},
                               {"tabletop, mean IoU", [](R& r) { r.rows[1].iou_default = 0.799; }}};
  for (const std::size_t i : {0U, 1U}) {
    const char* name = i == 0 ? "mosd, " : "tabletop, ";
    spoils.push_back({name, [i](R& r) { r.rows[i].touch_ms = 12.1; }});
    spoils.push_back({name, [i](R& r) { r.rows[i].follow_ms = 3.31; }});
    spoils.push_back({name, [i](R& r) { r.rows[i].further_ms = 0.51; }});
  }
  expect_each_limit_can_be_missed<R>(good, spoils);
  R alone = good;
  alone.rows.resize(1);
  alone.rows[0].further_ms = 0;
  expect_not_measured(alone, 1, "no image with two objects");
  alone.rows[0].touch_ms = 20, alone.other_load = 0.2;
  expect_not_measured(alone, 3, "others used 0.20 of a core");
  // What nobody set a limit for has none.
  alone.rows[0].folder = "kitchen", alone.rows[0].iou_default = 0.1;
  EXPECT_EQ(alone.missed(), 0);
}

HapticBenchResult good_tick() {
  HapticBenchResult r;
  r.methods.resize(1);
  r.methods[0].contact = 5000, r.methods[0].p50_us = 3, r.methods[0].p99_us = 25;
  r.guarded = true;
  r.instructions_512 = 17500, r.instructions_64 = 16000, r.instructions_p99 = 75000;
  r.none_over_plain = -8;
  r.reduction_p50_us = 80;
  return r;
}

TEST(BenchLimits, HapticTick) {
  using R = HapticBenchResult;
  const R good = good_tick();
  expect_each_limit_can_be_missed<R>(
      good, {{"tick, thread CPU p50", [](R& r) { r.methods[0].p50_us = 3.01; }},
             {"tick, thread CPU p99", [](R& r) { r.methods[0].p99_us = 25.1; }},
             // Beside others too: what a tick takes is its own thread's.
             {"tick, thread CPU p50", [](R& r) { r.methods[0].p50_us = 9, r.other_load = 1; }},
             {"allocations", [](R& r) { r.allocations = 1; }},
             {"locks", [](R& r) { r.locks = 1; }},
             {"instructions a tick", [](R& r) { r.instructions_512 = 17501; }},
             {"instructions of a tick, p99", [](R& r) { r.instructions_p99 = 75001; }},
             {"512^3 over 64^3", [](R& r) { r.instructions_64 = 15900; }},
             {"512^3 over 64^3", [](R& r) { r.instructions_64 = 19500; }},
             {"no effect", [](R& r) { r.none_over_plain = 8.1; }},
             {"reduction", [](R& r) { r.reduction_p50_us = 80.1; }}});
  R bare = good;
  bare.guarded = false, bare.instructions_512 = bare.instructions_64 = 0;
  bare.not_counted = "valgrind is not installed";
  expect_not_measured(bare, 6, "valgrind is not installed");
  R busy = good;
  busy.reduction_p50_us = 120, busy.other_load = 0.2;
  expect_not_measured(busy, 1, "others used 0.20 of a core");
}

RecordingTouchResult good_touch() {
  RecordingTouchResult r;
  r.paths.resize(2);
  for (TouchedPath& p : r.paths) {
    p.seconds = 60;
    p.rows.resize(1);
    TouchedRow& row = p.rows.front();
    row.contact = 40000, row.jumps = 400, row.longest_jump = 2;
    for (const auto kind : {Place::Kind::kCorner, Place::Kind::kEdge, Place::Kind::kWall,
                            Place::Kind::kTop, Place::Kind::kTop, Place::Kind::kTop}) {
      p.places.emplace_back().kind = kind;
      row.places.emplace_back().contact_s = 0.5;
    }
    row.places.emplace_back();  // between them
  }
  return r;
}

TEST(BenchLimits, ARecordingIsTouched) {
  using R = RecordingTouchResult;
  const auto row = [](R& r) -> TouchedRow& { return r.paths[1].rows.front(); };
  // Of two paths the second one is spoilt: the worst counts.
  expect_each_limit_can_be_missed<R>(
      good_touch(),
      {{"time in contact", [&](R& r) { row(r).contact = 39999, row(r).jumps = 0; }},
       {"surfaces", [&](R& r) { row(r).places[4].contact_s = row(r).places[5].contact_s = 0.4; }},
       {"corners", [&](R& r) { row(r).places[0].contact_s = 0.4; }},
       {"edges", [&](R& r) { row(r).places[1].contact_s = 0.4; }},
       {"walls", [&](R& r) { row(r).places[2].contact_s = 0.4; }},
       {"raw steps", [&](R& r) { row(r).jumps = 401; }},
       {"most of them", [&](R& r) { row(r).longest_jump = 3; }},
       {"ticks not finite", [&](R& r) { row(r).not_finite = 1; }},
       {"least E + booked + credit", [&](R& r) { row(r).energy_min_J = -1.01e-3; }},
       {"ticks through", [&](R& r) { row(r).sunk = 1; }},
       {"ticks through", [&](R& r) { row(r).flipped = 1; }}});
  EXPECT_THAT(printed(good_touch()), HasSubstr("seed 0: within all limits\n"));
  R bad = good_touch();
  row(bad).sunk = row(bad).longest_jump = 9;
  EXPECT_EQ(bad.missed(), 2);
  EXPECT_THAT(
      printed(bad),
      HasSubstr("seed 0: MISSED most of them in a row, ticks; ticks through the surface\n"));
}

TEST(BenchLimits, Boundary) {
  using R = BoundaryResult;
  R good;
  for (const double ratio : {0.8, 1.2}) {
    BoundaryRow& row = good.rows.emplace_back();
    row.stiffness_max = ratio * row.setting.bound();
  }
  good.passivity.emplace_back().energy_min_J = -1e-3;
  MaterialRow& m = good.materials.emplace_back(1000, MaterialRow{}).second;
  m.border_N = m.flicker_N = m.friction_N = m.amplitude_N = m.period_N = 0.15;
  good.textures.push_back({1000, 0.2e-3, 5e-3});
  const auto material = [](R& r) -> MaterialRow& { return r.materials.front().second; };
  expect_each_limit_can_be_missed<R>(
      good, {{"K max", [](R& r) { r.rows[0].stiffness_max *= 0.99; }},
             {"K max", [](R& r) { r.rows[1].stiffness_max *= 1.01; }},
             {"least E + booked + credit", [](R& r) { r.passivity[0].energy_min_J = -1.01e-3; }},
             {"least E + booked + credit", [&](R& r) { material(r).energy_min_J = -1.01e-3; }},
             {"raw step", [&](R& r) { material(r).border_N = 0.151; }},
             {"raw step", [&](R& r) { material(r).flicker_N = 0.151; }},
             {"raw step", [&](R& r) { material(r).friction_N = 0.151; }},
             {"raw step", [&](R& r) { material(r).amplitude_N = 0.151; }},
             {"raw step", [&](R& r) { material(r).period_N = 0.151; }},
             {"ten loops", [](R& r) { r.textures[0].height_J = 0.21e-3; }}});
  R friction = good;  // a curve with dry friction is no figure of the formula's
  friction.rows.emplace_back().setting.coulomb_N = 0.3;
  EXPECT_EQ(friction.missed(), 0);
  expect_not_measured(R{}, 9, "nothing of it was run");
}

}  // namespace
}  // namespace teletact

// What table1 prints, by which names its figures go, and when a limit counts as met, missed or not
// measured.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "tools/measure/bench/table1.hpp"

namespace teletact {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using State = Limit::State;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string printed(const Table1Result& r) {
  std::ostringstream text;
  r.print(text);
  return text.str();
}

// Meets every limit, each time by a little.
Table1Row good_row(const char* sequence, int edge) {
  Table1Row row;
  row.sequence = sequence, row.isa = "avx2", row.edge = edge;
  const bool recording = row.sequence == "recording";
  row.frame = {recording ? 14.9 : 16.9, recording ? 21.9 : 23.9, 30};
  row.object = {3.2, 4, 5};
  row.with_object = {row.frame.p50 + 3.2, 26, 35};
  row.object_more = {3.2, 5, 9};
  row.followed = 90, row.touches = 2;
  row.two.forks = 12;
  const double wall = table1_paper(edge)->fusion_ms - 0.1;
  row.two.wall = {wall - 1, 0, 0}, row.two.wall_with_object = {wall, 0, 0};
  row.frames = 150, row.claimed = 147;
  row.memory_MiB = 63.9;
  row.other_load = 0.05;
  return row;
}

Table1Result good_result() {
  Table1Result r;
  for (const char* sequence : {"recording", "synthetic"})
    for (const int edge : {64, 128, 256, 384, 512}) r.rows.push_back(good_row(sequence, edge));
  return r;
}

TEST(Table1, ThePapersColumnStandsBesideTheSameWork) {
  Table1Result result;
  Table1Row& row = result.rows.emplace_back();
  row.sequence = "recording", row.isa = "avx2", row.edge = 512;
  row.frame = {10.11, 12, 14};
  row.with_object = {12.22, 15, 17};
  row.followed = 90, row.touches = 2, row.frames = row.claimed = 100;
  row.memory_MiB = 55.5, row.keyframes_MiB = 4.5, row.rss_MiB = 321;
  Table1Row fixed = row;
  fixed.fixed_voxel = true, fixed.edge = 64, fixed.memory_MiB = 12.5, fixed.ate_mm = kNaN;
  result.rows.push_back(fixed);
  const std::string text = printed(result);
  EXPECT_THAT(text, HasSubstr("38.8    27.3 |  12.22  15.00  17.00 |  10.11  12.00  14.00"));
  EXPECT_THAT(text, HasSubstr("55.5       4.5   321"));
  EXPECT_THAT(text, HasSubstr("   64   10 mm"));
  const auto all = result.metrics();
  const auto value = [&](const std::string& name) {
    for (const auto& m : all)
      if (m.name == name) return m.value;
    return kNaN;
  };
  EXPECT_EQ(value("table1.512.memory_MiB"), 55.5);
  EXPECT_EQ(value("table1.512.keyframes_MiB"), 4.5);
  EXPECT_EQ(value("table1.512.rss_MiB"), 321);
  EXPECT_EQ(value("table1.512.seg_fusion_cpu_ms"), 12.22);
  EXPECT_EQ(value("table1.fixed.64.memory_MiB"), 12.5);
  EXPECT_TRUE(std::isnan(value("table1.64.memory_MiB"))) << "the first table has no such row";
}

TEST(Table1, EveryLimitIsMet) {
  const Table1Result r = good_result();
  EXPECT_EQ(r.missed(), 0);
  EXPECT_EQ(r.count(State::kNotMeasured), 0);
  // Claims, refusals, memory and wall in each row; times of a frame and of the object at 512^3.
  EXPECT_EQ(r.count(State::kMet), 10 * 4 + 2 * 4);
  EXPECT_EQ(r.not_run(), "");
  const std::string text = printed(r);
  EXPECT_THAT(text, HasSubstr("48 met, 0 MISSED, 0 not measured\n"));
  EXPECT_THAT(text, Not(HasSubstr("no verdict")));
}

struct Spoil {
  const char* what;
  int row;
  void (*spoil)(Table1Row&);
  bool time;  // others' load may be why
};

const Spoil kSpoils[] = {
    {"recording 512^3, frame CPU p50", 4, [](Table1Row& r) { r.frame.p50 = 15.01; }, true},
    {"recording 512^3, frame CPU p95", 4, [](Table1Row& r) { r.frame.p95 = 22.01; }, true},
    {"synthetic 512^3, frame CPU p50", 9, [](Table1Row& r) { r.frame.p50 = 17.01; }, true},
    {"synthetic 512^3, frame CPU p95", 9, [](Table1Row& r) { r.frame.p95 = kNaN; }, true},
    {"recording 512^3, the object's stages", 4, [](Table1Row& r) { r.object.p50 = 3.31; }, true},
    {"synthetic 512^3, with it less without", 9, [](Table1Row& r) { r.object_more.p50 = 3.31; },
     true},
    {"recording 64^3, wall of two threads with object", 0,
     [](Table1Row& r) { r.two.wall_with_object.p50 = 11.8; }, true},
    {"synthetic 256^3, wall of two threads, ms", 7,
     [](Table1Row& r) { r.two.wall.p50 = 15.5, r.touches = r.followed = 0; }, true},
    {"synthetic 128^3, memory", 6, [](Table1Row& r) { r.memory_MiB = 64.1; }, false},
    {"recording 384^3, claimed", 3, [](Table1Row& r) { r.claimed = 146; }, false},
    {"recording 256^3, blocks refused", 2, [](Table1Row& r) { r.refused = 1; }, false}};

TEST(Table1, EachLimitCanBeMissed) {
  for (const Spoil& s : kSpoils) {
    SCOPED_TRACE(s.what);
    Table1Result r = good_result();
    s.spoil(r.rows[static_cast<std::size_t>(s.row)]);
    EXPECT_EQ(r.missed(), 1);
    for (const auto& l : r.limits()) {
      if (l.state != State::kMissed) continue;
      EXPECT_THAT(l.what, HasSubstr(s.what));
    }
    EXPECT_THAT(printed(r), HasSubstr(" MISSED\n"));
  }
}

TEST(Table1, TimesOfADisturbedRowAreNeitherMetNorMissed) {
  for (const Spoil& s : kSpoils) {
    SCOPED_TRACE(s.what);
    Table1Result r = good_result();
    Table1Row& row = r.rows[static_cast<std::size_t>(s.row)];
    s.spoil(row);
    row.other_load = 0.23;
    EXPECT_EQ(r.missed(), s.time ? 0 : 1) << "memory and claims do not depend on the load";
    EXPECT_EQ(r.count(State::kNotMeasured), row.edge == 512 ? 5 : 1);
    const std::string text = printed(r);
    EXPECT_THAT(text, HasSubstr("others used up to 0.23 of a core, 0.05 is allowed: no verdict"));
    EXPECT_THAT(text, Not(HasSubstr("0 not measured\n")));
  }
}

TEST(Table1, OnlyTheFirstTableAndInstructionSetCount) {
  for (const auto aside : std::initializer_list<void (*)(Table1Row&)>{
           [](Table1Row& r) { r.beside = true; }, [](Table1Row& r) { r.fixed_voxel = true; }}) {
    Table1Result r = good_result();
    Table1Row slow = good_row("recording", 512);
    slow.frame = {100, 200, 300}, slow.memory_MiB = 500, slow.claimed = 0;
    slow.other_load = 1;
    aside(slow);
    r.rows.push_back(slow);
    EXPECT_EQ(r.missed(), 0);
    EXPECT_EQ(r.count(State::kNotMeasured), 0);
  }
}

TEST(Table1, WhatWasNotRunIsNamed) {
  Table1Result r;
  r.rows.push_back(good_row("synthetic", 512));
  r.rows[0].two.forks = 0, r.rows[0].touches = 0;
  EXPECT_EQ(r.not_run(),
            "recording 64^3, recording 128^3, recording 256^3, recording 384^3, recording 512^3, "
            "synthetic 64^3, synthetic 128^3, synthetic 256^3, synthetic 384^3, synthetic 512^3 "
            "with two threads, synthetic 512^3 with an object");
  EXPECT_EQ(r.count(State::kMet), 5);
  EXPECT_THAT(printed(r), HasSubstr("not run: recording 64^3"));
}

// Both tables, on the synthetic room. Within 0.64 m of the camera is nothing: the second one's 64
// can not be tracked.
TEST(Table1, AShortRecordingIsMeasured) {
  std::ostringstream said;
  Table1Options options;
  options.edges = {64, 512};
  options.frames = 14, options.runs = 1;
  options.two_threads = false;
  options.isas = {"auto"};
  const Table1Result r = bench_table1(said, options);
  ASSERT_EQ(r.rows.size(), 4u);
  for (const Table1Row& row : r.rows) {
    EXPECT_EQ(row.frames, 14);
    EXPECT_GT(row.frame.p50, 0);
    EXPECT_GT(row.memory_MiB, row.keyframes_MiB);
    EXPECT_GT(row.rss_MiB, row.memory_MiB);
    EXPECT_EQ(row.refused, 0);
  }
  const Table1Row &cube = r.rows[0], &fine = r.rows[1], &small = r.rows[2], &large = r.rows[3];
  EXPECT_DOUBLE_EQ(cube.voxel_mm(), 80);
  EXPECT_DOUBLE_EQ(small.voxel_mm(), 10);
  EXPECT_EQ(cube.claimed, 14);
  EXPECT_GT(cube.keyframes_MiB, 0);
  EXPECT_TRUE(small.fixed_voxel && large.fixed_voxel);
  EXPECT_LT(small.claimed, 14);
  EXPECT_EQ(large.claimed, 14);
  EXPECT_GT(large.blocks, small.blocks);
  EXPECT_LE(large.blocks, fine.blocks) << "the same voxels, and nothing kept outside of the cube";
  EXPECT_LT(small.memory_MiB, large.memory_MiB) << "a pool for what the cube can hold";
}

}  // namespace
}  // namespace teletact

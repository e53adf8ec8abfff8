// The optimum beside a hand on a recording, and what it excuses.
#include "tools/measure/haptic/recording_optimum.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>

#include "tools/measure/haptic/recording_touch.hpp"

namespace {

using perception::SurfacePatch;
using perception::Vec3;
using teletact::PopChecker;
using teletact::RecordingOptimum;

// 32^3 nodes of 10 mm about the origin, of a distance in metres; NaN: not observed.
std::unique_ptr<SurfacePatch> window(std::uint64_t seq,
                                     const std::function<double(const Vec3&)>& distance_m) {
  auto w = std::make_unique<SurfacePatch>();
  w->seq = seq;
  w->voxel_size = 0.01;
  w->metres_per_unit = 0.04F / 32767;
  w->nodes = 32;
  w->origin_node = {-16, -16, -16};
  for (int x = 0; x < w->nodes; ++x)
    for (int y = 0; y < w->nodes; ++y)
      for (int z = 0; z < w->nodes; ++z) {
        const double d = distance_m(w->node_W(x, y, z));
        const std::size_t i = w->index(x, y, z);
        w->material[i] = std::isnan(d) ? 0 : 1;
        if (std::isnan(d)) continue;
        const double units = std::clamp(d, -0.04, 0.04) / 0.04 * 32767;
        w->distance[i] = static_cast<std::int16_t>(std::lround(units));
      }
  return w;
}

double floor_m(const Vec3& p) { return p.z() - 0.003; }

tasks::HapticConfig config() { return {}; }

TEST(RecordingOptimum, HoldsAHandThatSlidesOnAFloor) {
  const auto w = window(1, floor_m);
  PopChecker field;
  field.offer(w.get());
  RecordingOptimum o(config(), {{0, 400}});
  for (std::size_t k = 0; k <= 400; ++k) {
    ASSERT_TRUE(o.asked(k));
    const double t = static_cast<double>(k);
    o.tick(k, {1e-4 * t, 0, 0.005 - std::min(1e-4 * t, 0.007)}, 0, field, 1);
  }
  EXPECT_FALSE(o.asked(401));
  EXPECT_EQ(o.optimum().ticks, 401U);
  EXPECT_EQ(o.optimum().jumps, 0U);
  EXPECT_EQ(o.optimum().turned, 0U);
  // Its force is K times the depth: it rises by 0.1 N a tick.
  EXPECT_NEAR(o.optimum().step_max_N, 0.1, 0.02);
}

TEST(RecordingOptimum, CountsStepsOfTheProductBesideIt) {
  const auto w = window(1, floor_m);
  PopChecker field;
  field.offer(w.get());
  RecordingOptimum o(config(), {{10, 29}});
  EXPECT_FALSE(o.asked(9));
  for (std::size_t k = 10; k < 30; ++k) {
    const bool over = k == 15 || k == 16 || k == 17 || k == 25;
    o.tick(k, {0, 0, 0.005}, over ? 0.6 : 0.4, field, 1);
  }
  EXPECT_EQ(o.product().jumps, 4U);
  EXPECT_EQ(o.product().longest_jump, 3U);
  EXPECT_DOUBLE_EQ(o.product().step_max_N, 0.6);
  EXPECT_EQ(o.optimum().jumps, 0U);
}

// The solid is above the hand from the next window on: the only way out leads down.
TEST(RecordingOptimum, TurnsWhereTheWindowsTurn) {
  const auto below = window(1, floor_m),
             above = window(2, [](const Vec3&p) { return -0.008 - p.z(); });
  PopChecker field;
  field.offer(below.get());
  RecordingOptimum o(config(), {{0, 119}});
  for (std::size_t k = 0; k < 120; ++k) {
    if (k == 100) field.offer(above.get());
    o.tick(k, {0, 0, std::max(0.005 - 2e-4 * static_cast<double>(k), -0.003)}, 0, field, 1);
  }
  EXPECT_EQ(o.optimum().turned, 1U);
  EXPECT_EQ(o.optimum().jumps, 1U);
  EXPECT_NEAR(o.optimum().step_max_N, 11, 0.3);  // from 6 N up to 5 N down
}

TEST(RecordingOptimum, BlendsTheWindows) {
  const auto first = window(1, floor_m),
             second = window(2, [](const Vec3&p) { return p.z() - 0.007; });
  PopChecker field;
  field.offer(first.get());
  field.offer(second.get());
  RecordingOptimum o(config(), {{0, 10}});
  for (std::size_t k = 0; k <= 10; ++k)  // a hand that stands where the floor rises to
    o.tick(k, {0, 0, 0.003}, 0, field, 0.1 * static_cast<double>(k));
  EXPECT_EQ(o.optimum().jumps, 0U);
  EXPECT_NEAR(o.optimum().step_max_N, 0.4, 0.03);  // 4 mm in ten steps
}

TEST(RecordingOptimum, FeelsNothingInWhatWasNotSeen) {
  const auto w = window(1, [](const Vec3&) { return std::numeric_limits<double>::quiet_NaN(); });
  PopChecker field;
  field.offer(w.get());
  RecordingOptimum o(config(), {{0, 50}});
  for (std::size_t k = 0; k <= 50; ++k)
    o.tick(k, {0, 0, -1e-4 * static_cast<double>(k)}, 0, field, 1);
  EXPECT_EQ(o.optimum().step_max_N, 0);
}

TEST(RecordingOptimum, EachContactBeginsInTheFree) {
  const auto w = window(1, floor_m);
  PopChecker field;
  field.offer(w.get());
  RecordingOptimum o(config(), {{0, 40}, {60, 70}});
  for (std::size_t k = 0; k <= 40; ++k)
    o.tick(k, {0, 0, 0.005 - 2e-4 * static_cast<double>(k)}, 0, field, 1);
  EXPECT_FALSE(o.asked(50));
  for (std::size_t k = 60; k <= 70; ++k) {
    ASSERT_TRUE(o.asked(k));
    o.tick(k, {0.1, 0.1, 0.005}, 0, field, 1);  // elsewhere: no step from the last contact
  }
  EXPECT_EQ(o.optimum().jumps, 0U);
  EXPECT_EQ(o.optimum().ticks, 52U);
}

teletact::TouchedPath path_with(std::vector<teletact::TouchedRow::Event> events) {
  teletact::TouchedPath p;
  p.rows.resize(1);
  auto& row = p.rows.front();
  row.contact = 40000;
  for (const auto& e : events) {
    row.jumps += e.jump ? 1 : 0;
    row.longest_jump = std::max(row.longest_jump, e.in_a_row);
    row.flipped += e.flipped ? 1 : 0;
  }
  row.events = std::move(events);
  return p;
}

teletact::TouchedRow::Event event(std::size_t begin, std::size_t tick, std::uint64_t in_a_row,
                                  bool turned = false) {
  teletact::TouchedRow::Event e;
  e.begin = begin, e.tick = tick, e.in_a_row = in_a_row;
  e.jump = in_a_row > 0, e.flipped = turned;
  return e;
}

TEST(MissedContacts, AreThoseBeyondTheLimitsAlone) {
  EXPECT_TRUE(path_with({event(10, 20, 1), event(10, 21, 2)}).missed_contacts().empty());
  const auto spans = path_with({event(5, 9, 1), event(10, 20, 2), event(10, 21, 3),
                                event(40, 45, 0, true), event(200, 290, 0, true)})
                         .missed_contacts();
  ASSERT_EQ(spans.size(), 2U);  // 40 begins before what follows the first is over
  EXPECT_EQ(spans[0], (teletact::TickSpan{10, 95}));
  EXPECT_EQ(spans[1], (teletact::TickSpan{200, 340}));
}

TEST(MissedAlone, WhatTheOptimumDoesTooIsExcusedAndNothingElse) {
  auto p = path_with({event(10, 20, 1), event(10, 21, 2), event(10, 22, 3), event(9, 30, 0, true)});
  EXPECT_EQ(p.missed_alone(), 2) << "the optimum did neither";
  p.optimum.longest_jump = 2;
  p.optimum.turned = 1;
  EXPECT_EQ(p.missed_alone(), 1);
  p.optimum.longest_jump = 3;
  EXPECT_EQ(p.missed_alone(), 0);
  p.rows.front().sunk = 1;
  EXPECT_EQ(p.missed_alone(), 1) << "through the surface nothing excuses";
  EXPECT_EQ(path_with({event(10, 20, 2)}).missed_alone(), 0) << "within the limits";
}

}  // namespace

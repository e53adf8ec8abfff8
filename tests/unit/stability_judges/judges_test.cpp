// Each judge of the hard cases has to fail on what it is there for: a trace made wrong on purpose,
// or another method.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "rt/random.hpp"
#include "tools/measure/stability/cases.hpp"
#include "tools/measure/stability/judges.hpp"
#include "tools/measure/support/field_optimum.hpp"
#include "tools/measure/support/haptic_solids.hpp"

namespace {

using rig::Row;
using rig::Vec3;
using stability::Check;
using Trace = stability::Run;
using stability::Setting;

const Check& check_of(const Trace& run, const std::string& name) {
  const auto it = std::ranges::find_if(run.checks, [&](const Check& c) { return c.name == name; });
  if (it == run.checks.end()) throw std::runtime_error(run.name + ": no check " + name);
  return *it;
}

const Trace& named(const std::vector<Trace>& runs, const std::string& part) {
  const auto it = std::ranges::find_if(
      runs, [&](const Trace& r) { return r.name.find(part) != std::string::npos; });
  if (it == runs.end()) throw std::runtime_error("no run " + part);
  return *it;
}

Setting setting(const char* method, std::size_t place = 0, double speed = 0.1) {
  Setting s;
  s.place = rig::placements()[place];
  s.speed = speed;
  s.method = method;
  return s;
}

Row blank() {
  Row row{};
  row.h = row.p = row.f = row.f_raw = Vec3::Zero();
  return row;
}

std::vector<Vec3> wave(double hz, double size_N) {
  std::vector<Vec3> out;
  for (int i = 0; i < 600; ++i) {
    const double t = 1e-3 * i;
    out.emplace_back(0, 0, 8 + 3 * t + size_N * std::sin(2 * std::numbers::pi * hz * t));
  }
  return out;
}

TEST(Judges, BuzzIsAForceThatGoesToAndFro) {
  std::vector<Row> rows(400);
  const auto buzz = [&](auto&& force) {
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i].f_raw = force(i);
    return stability::buzz_ticks(rows, 0.06);
  };
  const auto to_and_fro = [](double size, std::size_t period) {
    return [=](std::size_t i) {
      return Vec3(0.02 * static_cast<double>(i), i % period == 0 ? size : 0, 8);
    };
  };
  EXPECT_EQ(buzz(to_and_fro(0.2, 2)), 398);
  EXPECT_EQ(buzz(to_and_fro(0.2, 3)), 132);  // there and back, then still
  EXPECT_EQ(buzz(to_and_fro(0.04, 2)), 0);   // too small to count
  EXPECT_EQ(buzz([](std::size_t i) { return Vec3(0, i > 100 ? 5 : 0, 8); }), 0);  // a step
  EXPECT_EQ(buzz([](std::size_t i) { return Vec3(0.2 * static_cast<double>(i), 0, 8); }), 0);
}

TEST(Judges, ChatterIsWhatIsAbove100Hz) {
  EXPECT_LT(stability::chatter_N(wave(10, 0.1)), 0.002);
  EXPECT_LT(stability::chatter_N(wave(0, 0)), 1e-4);  // a ramp is no chatter
  EXPECT_NEAR(stability::chatter_N(wave(250, 0.1)), 0.1 / std::sqrt(2.0), 0.005);
  EXPECT_GT(stability::chatter_N(wave(150, 0.05)), 0.02);
  std::vector<Vec3> tooth;  // a saw-tooth at 500 Hz, as a dead band of 0.1 mm gives
  for (int i = 0; i < 600; ++i) tooth.emplace_back(0, 0, 8 + (i % 2) * 0.1);
  EXPECT_GT(stability::chatter_N(tooth), 0.02);
}

// 400 ticks at 0.1 m/s; the figure is p.x, the optimum's place is known in every tick.
Trace trace_of(const std::vector<std::pair<std::size_t, double>>& ours,
               const std::vector<std::pair<std::size_t, double>>& optimum) {
  Trace out;
  for (std::size_t i = 0; i < 400; ++i) {
    out.rows.push_back(blank());
    out.rows.back().h.x() = 1e-4 * static_cast<double>(i);
    out.optimum.push_back({i, Vec3::Zero(), Vec3::Zero(), Vec3::Zero()});
  }
  for (const auto& [i, x] : ours) out.rows[i].p.x() = x;
  for (const auto& [i, x] : optimum) out.optimum[i].p.x() = x;
  return out;
}

TEST(Judges, AnOptimumThatFailsElsewhereIsNoExcuse) {
  const auto judged = [](Trace run) {
    const auto x = [](const Vec3&, const Vec3& p, const Vec3&) { return p.x(); };
    stability::add(run, "x", stability::worst_of(run, setting("constrained"), x), 1);
    return run.checks.back();
  };
  Check c = judged(trace_of({{100, 5}}, {{100, 4.9}}));
  EXPECT_FALSE(c.met());
  EXPECT_TRUE(c.field_bound());
  c = judged(trace_of({{100, 5}}, {{75, 4.9}}));  // the force sent may be behind by the guard
  EXPECT_TRUE(c.field_bound());
  for (const std::size_t far : {30U, 120U, 300U}) {
    c = judged(trace_of({{100, 5}}, {{far, 4.9}}));
    EXPECT_FALSE(c.field_bound()) << far;
    EXPECT_EQ(c.alone.ours, 5) << far;
    EXPECT_EQ(c.alone.optimum, 0) << far;
  }
  c = judged(trace_of({{100, 5}, {300, 2}}, {{100, 5}, {300, 0.5}}));
  EXPECT_FALSE(c.field_bound());
  EXPECT_EQ(c.value, 5);
  EXPECT_EQ(c.optimum, 5);
  EXPECT_EQ(c.alone.ours, 2);
  EXPECT_EQ(c.alone.optimum, 0.5);
  EXPECT_FALSE(judged(trace_of({{100, 5}}, {{100, 4.7}})).field_bound());  // as far to a twentieth
  EXPECT_FALSE(judged(trace_of({{100, 5}}, {{100, 1}})).field_bound());
  EXPECT_TRUE(judged(trace_of({{100, 1}}, {{100, 5}})).met());
  c = judged(trace_of({{100, 5}}, {{100, 5}}));
  EXPECT_TRUE(c.field_bound());
  c.binds = false;
  EXPECT_FALSE(c.field_bound());
  EXPECT_FALSE(Check::as_far(0.27, 0.26 + 1e-12, 0.26));  // it keeps the limit
  EXPECT_TRUE(Check::as_far(0.31, 0.27, 0.26));
  EXPECT_FALSE(Check::as_far(0.33, 0.27, 0.26));
}

TEST(Judges, TheGuardedOptimumGoesOnInTheFree) {
  rig::SlewFollower guarded(0.3, 1000, 1), coarse(0.3, 1000, 5);
  for (int i = 0; i < 3; ++i) guarded.follow({0, 0, 1}, 0);
  EXPECT_NEAR(guarded.force().z(), 0.9, 1e-12);
  for (int i = 0; i < 3; ++i) guarded.follow(Vec3::Zero(), 0);
  EXPECT_NEAR(guarded.force().z(), 0, 1e-12);
  EXPECT_NEAR(guarded.j(), 0.3, 1e-12);
  guarded.follow({0, 0, 9}, 1e-3);  // with the hand: 1.1 K
  EXPECT_NEAR(guarded.force().z(), 1.1, 1e-12);
  coarse.follow({0, 0, 9}, 0);  // of five ticks
  EXPECT_NEAR(coarse.force().z(), 1.5, 1e-12);
  EXPECT_NEAR(coarse.j(), 0.3, 1e-12);
}

// A surface that goes from `from` to `to` under a hand at 0, in so many ticks, windows of 33 ticks.
std::vector<Row> lifted(double from, double to, int ticks, double booked_share) {
  std::vector<Row> rows;
  double spring_J = 0, booked_J = 0;
  for (int i = 0; i < ticks + 40; ++i) {
    const double share = std::clamp(static_cast<double>(i) / ticks, 0.0, 1.0);
    Row row = blank();
    row.h = Vec3::Zero();
    row.p = Vec3(0, 0, from + share * (to - from));
    const double d = row.p.z(), held = d < 0.012 ? 500 * d * d : 12 * (d - 0.006);
    if (i > 0) booked_J += booked_share * (held - spring_J);
    spring_J = held;
    row.telemetry.in_contact = true;
    row.telemetry.gain = 1;
    row.telemetry.blend = share;
    row.telemetry.booked_J = booked_J;
    rows.push_back(row);
  }
  return rows;
}

TEST(Judges, InjectedEnergyIsCountedFromTheTraceAlone) {
  Trace run;
  run.rows = lifted(0.002, 0.007, 33, 1);
  const stability::Injected in = stability::injected(run.rows, 1000);
  EXPECT_NEAR(in.sum_J, 500 * (49e-6 - 4e-6), 1e-9);
  EXPECT_NEAR(in.event_J, in.sum_J, 1e-9);
  stability::add_injected(run, 1000);
  for (const Check& c : run.checks) EXPECT_TRUE(c.met()) << c.name << " " << c.value;
}

TEST(Judges, AnEventOfMoreThan50mJAtFullRateFails) {
  Trace run;
  run.rows = lifted(0.008, 0.020, 33, 1);  // 40 + 96 mJ
  stability::add_injected(run, 1000);
  EXPECT_FALSE(check_of(run, "booked at full rate mJ an event").met());
  EXPECT_FALSE(check_of(run, "booked at full rate mJ in 100 ms").met());
  EXPECT_TRUE(check_of(run, "not booked mJ").met());
}

TEST(Judges, EnergyLeftOutOfTheBooksFails) {
  Trace run;
  run.rows = lifted(0.002, 0.007, 33, 0.9);
  stability::add_injected(run, 1000);
  EXPECT_FALSE(check_of(run, "not booked mJ").met());
}

TEST(Judges, ReversalsAreTurnsOfMoreThan90Degrees) {
  Trace run;
  for (const double x : {3.0, 3.0, -3.0, -3.0, 0.05, 3.0}) {
    Row row = blank();
    row.f_raw = Vec3(x, 0, 1);
    run.rows.push_back(row);
  }
  EXPECT_EQ(stability::reversals(run).ours, 1);
}

// Full force at once, never, on the wrong side: each fails its own check.
TEST(Judges, FadeInHasToTake30To100Ms) {
  const auto faded = [](double ramp_s, double full) {
    Trace run;
    for (int i = 0; i < 300; ++i) {
      Row row = blank();
      row.t = 1e-3 * i;
      row.f = Vec3(0, 0, full * std::min(1.0, (i + 1) * 1e-3 / ramp_s));
      run.rows.push_back(row);
    }
    run.figures = rig::figures(run.rows);
    stability::add_fade_in(run, 8);
    return run;
  };
  for (const Check& c : faded(0.05, 8).checks) EXPECT_TRUE(c.met()) << c.name;
  EXPECT_FALSE(check_of(faded(1e-3, 8), "J N").met());
  EXPECT_FALSE(check_of(faded(0.02, 8), "30 ms less it").met());
  EXPECT_FALSE(check_of(faded(0.15, 8), "full force ms").met());
  EXPECT_FALSE(check_of(faded(0.05, -8), "wrong side N").met());
  EXPECT_FALSE(check_of(faded(0.05, 7), "end force error N").met());
}

TEST(Judges, FrictionModelSticksSlipsAndSticksAgain) {
  stability::FrictionModel model(0.3, 0.24);
  const double d = 0.008;
  const auto at = [&](double x) { return model.follow({x, 0, 0}, {x, 0, -d}); };
  EXPECT_EQ(at(0).x(), 0);
  EXPECT_NEAR(at(0.0023).x(), 0, 1e-12);                 // in the cone
  EXPECT_NEAR(at(0.0025).x(), 0.0025 - 0.24 * d, 1e-9);  // broken loose
  EXPECT_NEAR(at(0.004).x(), 0.004 - 0.24 * d, 1e-9);
  EXPECT_NEAR(at(0.003).x(), 0.004 - 0.24 * d, 1e-9);  // back: stuck
}

// Under a plane, and round a corner off the grid: free, and nothing nearer is.
TEST(Judges, NearestFreePlaceIsFreeAndTheNearest) {
  constexpr std::uint64_t kSeed = 3;
  constexpr double kVoxel_m = 0.01, kRadius_m = 0.001;
  std::printf("seed %llu\n", static_cast<unsigned long long>(kSeed));
  rt::Random random(kSeed);
  const auto any = [&](double size) {
    return Vec3(random.uniform(-size, size), random.uniform(-size, size),
                random.uniform(-size, size));
  };
  const auto sampled = [&](const std::function<double(const Vec3&)>& solid) {
    return support::ReferenceField(
        [&](int x, int y, int z) { return solid(kVoxel_m * Vec3(x, y, z)); }, kVoxel_m,
        Eigen::Array3i::Constant(-4), Eigen::Array3i::Constant(9));
  };
  for (int k = 0; k < 20; ++k) {
    const Vec3 n = any(1).normalized();
    const support::ReferenceField plane = sampled([&](const Vec3& p) { return n.dot(p); });
    const Vec3 p = any(0.01), on = p - n.dot(p) * n + kRadius_m * n;
    const Vec3 in = on - random.uniform(0, 0.0028) * n;
    EXPECT_LT((stability::nearest_free(plane, in, kRadius_m) - on).norm(), 1e-5) << k;
    const Vec3 out = on + 1e-4 * n;
    EXPECT_EQ(stability::nearest_free(plane, out, kRadius_m), out);
  }
  const perception::Mat3 turned =
      Eigen::AngleAxisd(0.3, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  const support::ReferenceField corner =
      sampled([&](const Vec3& p) { return solids::concave_edge(turned * p); });
  for (int k = 0; k < 20; ++k) {
    const Vec3 p =
        turned.transpose() *
        Vec3(random.uniform(-0.002, 0.001), random.uniform(-0.01, 0.01), random.uniform(-0.001, 0));
    const Vec3 q = stability::nearest_free(corner, p, 0);
    const double off = (q - p).norm();
    if (off == 0) continue;  // free, or too deep
    EXPECT_GE(corner(q), -1e-12);
    int nearer = 0;
    for (int i = 0; i < 20000; ++i) {
      const Vec3 d = any(1);
      if (d.norm() < 1 && corner(p + (off - 1e-5) * d) >= 0) ++nearer;
    }
    EXPECT_EQ(nearer, 0) << k << ", lift " << 1e3 * off << " mm";
  }
}

// --- another method, on the case itself

TEST(Judges, NearestPointIsOffInTheGroove) {
  Setting s = setting("nearest10", 4);
  s.judged = false;
  for (const Trace& run : stability::case_groove(s)) {
    EXPECT_FALSE(check_of(run, "off the groove line mm").met()) << run.name;
  }
}

// One step a tick is not enough there, and the count says so.
TEST(Judges, TooFewIterationsInTheGrooveAreCounted) {
  EXPECT_GT(stability::groove_ticks_over(1, setting("constrained", 4)), 0);
}

Setting unjudged(const char* method) {
  Setting s = setting(method);
  s.judged = false;
  return s;
}

TEST(Judges, NearestPointOvershootsInTheRoomCorner) {
  const auto runs = stability::case_room_corner(unjudged("nearest10"));
  EXPECT_FALSE(check_of(runs[0], "corner F N").met());
}

TEST(Judges, NearestPointIsOffTheZeroSetOfTheCornerAndSunk) {
  const auto runs = stability::case_concave_corner(unjudged("nearest"));
  EXPECT_FALSE(check_of(runs[0], "off the zero set mm").met());
  EXPECT_FALSE(check_of(runs[0], "sunk ticks").met());
}

TEST(Judges, NearestPointForgetsItsSideWhileForcesAreOff) {
  const auto runs = stability::case_start_inside(setting("nearest"));
  EXPECT_FALSE(check_of(named(runs, "pushed through the middle"), "wrong side N").met());
}

TEST(Judges, NearestPointGoesThroughAPlateAndTurns) {
  Setting s = setting("nearest");
  rig::Rig r(stability::still_scene(s, [](const Vec3& p) { return solids::plate(p, 0.02); }));
  const rig::Path path({{0, 0, 0.02}, {0, 0, -0.006}}, 0.1);
  r.run(path, 0, path.duration());
  Trace run;
  stability::add_pops(run, r, true);
  EXPECT_FALSE(check_of(run, "turned to the other side").met());
}

TEST(Judges, TicksInsideInARowAreCounted) {
  std::vector<Row> rows(6, blank());
  for (Row& row : rows) row.depth_m = 0;
  rows[1].depth_m = rows[2].depth_m = rows[3].depth_m = 1e-4;
  rows[5].depth_m = std::nan("");
  EXPECT_EQ(stability::longest_inside(rows, 0), 3);
  for (Row& row : rows) row.depth_m = -0.003;  // on a tip of 3 mm
  EXPECT_EQ(stability::longest_inside(rows, 0.003), 0);
  EXPECT_EQ(stability::longest_inside(rows, 0.0031), 6);
}

TEST(Judges, NearestPointTurnsAndSinksInASlot) {
  Setting s = setting("nearest", 2);
  s.judged = false;
  const auto runs = stability::case_slots(s);
  EXPECT_FALSE(check_of(named(runs, "10 mm 0deg/2 100mm/s, R"), "reversals").met());
  EXPECT_FALSE(check_of(named(runs, "5 mm 0deg/2 100mm/s, R"), "sunk into the slot mm").met());
}

TEST(Judges, NearestPointIsNotTheFrictionProxy) {
  const auto runs = stability::case_friction_corner(setting("nearest10", 0, 0.2));
  EXPECT_FALSE(check_of(runs[0], "F error p95 N").met());
  EXPECT_FALSE(check_of(runs[0], "frictionless F error p95 N").met());
}

}  // namespace

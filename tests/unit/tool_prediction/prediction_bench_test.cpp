#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "tools/measure/prediction/prediction_bench.hpp"
#include "tools/measure/prediction/prediction_judge.hpp"
#include "tools/measure/prediction/prediction_study.hpp"

namespace teletact {
namespace {

using perception::Pose2;

JudgedMethod method(const std::string& name, bool commands = false) {
  JudgedMethod m;
  m.method = name;
  m.config.method = name;
  m.commands = commands;
  return m;
}

// The robot does what the trace says: speed, acceleration of its reference, stops, all directions,
// stamps within 2 ms.
TEST(RobotTrace, DrivesAsItSays) {
  for (const int a : {1, 3}) {
    const MotionTrace t = robot_trace({1.0 * a, 20, false, 60, 4});
    double fastest = 0, reverse = 0, aside = 0, turn = 0, jitter = 0, change = 0;
    int rest = 0;
    for (std::size_t i = 1; i < t.truth.size(); ++i) {
      const Pose2 d = perception::compose(perception::inverse(t.truth[i - 1]), t.truth[i]);
      fastest = std::max(fastest, std::hypot(d.x, d.y) / t.true_step);
      reverse = std::min(reverse, d.x / t.true_step);
      aside = std::max(aside, std::abs(d.y) / t.true_step);
      turn = std::max(turn, std::abs(d.yaw) / t.true_step);
      rest += std::hypot(d.x, d.y) < 1e-6 ? 1 : 0;
    }
    for (const MotionRow& r : t.rows) jitter = std::max(jitter, std::abs(r.stamp - r.t));
    for (std::size_t i = 1; i < t.commands.size(); ++i)
      change = std::max(change, std::abs(t.commands[i].v_B.vx - t.commands[i - 1].v_B.vx) /
                                    (t.commands[i].t - t.commands[i - 1].t));
    EXPECT_LE(fastest, 0.81);
    EXPECT_GT(fastest, 0.6);
    EXPECT_LT(reverse, -0.2);
    EXPECT_GT(aside, 0.2);
    EXPECT_GT(turn, 0.3);
    EXPECT_GT(rest, 500) << "it stands for half a second at least";
    EXPECT_LE(jitter, 0.002);
    EXPECT_GT(jitter, 0.0015);
    EXPECT_NEAR(change, a, 1e-6);
    EXPECT_EQ(t.rows.size(), 1201U);
  }
}

// What is measured is not the truth: wheels slip, speeds are noisy.
TEST(RobotTrace, TruthIsHidden) {
  const MotionTrace t = robot_trace({2, 20, false, 60, 4});
  double off = 0, noise = 0;
  for (const MotionRow& r : t.rows) {
    const Pose2 X = t.true_pose(r.t);
    off = std::max(off, std::hypot(X.x - r.X_OB.x, X.y - r.X_OB.y));
    const Pose2 d = perception::compose(perception::inverse(X), t.true_pose(r.t + 0.001));
    noise = std::max(noise, std::abs(d.x / 0.001 - r.v_B.vx));
  }
  EXPECT_GT(off, 0.05);
  EXPECT_GT(noise, 0.01);
  const MotionTrace again = robot_trace({2, 20, false, 60, 4}),
                    other = robot_trace({2, 20, false, 60, 6});
  EXPECT_EQ(again.truth.back(), t.truth.back()) << "same seed, same trace";
  EXPECT_FALSE(other.truth.back() == t.truth.back());
}

// A motion whose error is known in closed form: steady acceleration, constant_velocity is off by a
// h^2 / 2, none by the way.
TEST(Judge, ErrorsOfAMotionInClosedForm) {
  MotionTrace t;
  t.delay_min_s = t.delay_max_s = 0.2;
  t.judged_from = 1;
  for (int i = 0; i < 40; ++i) {
    const double s = 0.1 * i;
    t.rows.push_back({s, s, {0.25 * s * s, 0, 0}, {0.5 * s, 0, 0}});
  }
  const MotionErrors held = judge(t, method("constant_velocity")), none = judge(t, method("none")),
                     kalman = judge(t, method("kalman"));
  ASSERT_EQ(held.error_m.size(), 30U) << "1.0 s is judged, though 10 x 0.1 rounds";
  for (std::size_t i = 0; i < held.error_m.size(); ++i) {
    EXPECT_NEAR(held.error_m[i], 0.5 * 0.5 * 0.04, 1e-9);
    const double to = held.t_s[i], from = to - 0.2;
    EXPECT_NEAR(none.error_m[i], 0.25 * (to * to - from * from), 1e-9);
  }
  EXPECT_NEAR(held.mean_cm(), 1, 1e-6);
  EXPECT_NEAR(held.max_cm(), 1, 1e-6);
  EXPECT_LT(kalman.mean_cm(), 0.2);
  EXPECT_TRUE(std::isnan(MotionErrors{}.p95_cm()));
  MotionErrors e;
  for (int i = 1; i <= 20; ++i) e.error_m.push_back(0.01 * i);
  EXPECT_DOUBLE_EQ(e.p95_cm(), 19) << "nearest rank";
  const MotionErrors best = best_of_each_instant({held, none, kalman});
  for (std::size_t i = 0; i < best.error_m.size(); ++i)
    EXPECT_EQ(best.error_m[i], std::min({held.error_m[i], none.error_m[i], kalman.error_m[i]}));
}

TEST(Judge, NoMethodLooksAhead) {
  MotionTrace t = robot_trace({2, 20, false, 20, 8});
  for (const double delay : {0.1, 0.15}) {
    t.delay_min_s = delay;
    t.delay_max_s = 0.2;
    for (const std::string& m : tasks::MotionPredictorConfig::methods())
      EXPECT_EQ(changed_by_the_future(t, method(m)), 0) << m;
    EXPECT_EQ(changed_by_the_future(t, method("own", true)), 0);
  }
  // The check can fail: told rows before their time, it finds them.
  MotionTrace early = t;
  for (MotionRow& r : early.rows) r.t -= 0.3;
  early.delay_min_s = early.delay_max_s = 0;
  const auto a = predicted_poses(early, method("constant_velocity")),
             b = predicted_poses(t, method("constant_velocity"));
  EXPECT_FALSE(a[100] == b[100]);
}

TraceResult trace_with(double own, double paper, double simple, double none, double commands) {
  TraceResult t;
  t.name = "one_d100";
  t.delay_min_s = t.delay_max_s = 0.1;
  for (const auto& [name, mean] :
       std::vector<std::pair<std::string, double>>{{"none", none},
                                                   {"constant_velocity", simple},
                                                   {"ridge", 9},
                                                   {"kalman", 9},
                                                   {"singer", 9},
                                                   {"lsq", 9},
                                                   {"paper", paper},
                                                   {"own", own},
                                                   {"own_commands", commands},
                                                   {"oracle", 0.05}})
    t.methods.push_back({name, mean, mean, mean});
  return t;
}

std::string printed(const PredictionResult& r) {
  std::ostringstream text;
  r.print(text);
  return text.str();
}

TEST(PredictionBench, EachLimitCanBeMissed) {
  PredictionResult good;
  good.traces = {trace_with(0.40, 0.9, 0.3, 4, 0.2), trace_with(1.17, 2.34, 1, 4, 0.5)};
  good.look_ahead["own"] = 0;
  EXPECT_EQ(good.missed(), 0) << printed(good);
  EXPECT_NE(printed(good).find("6 met, 0 MISSED, 0 not measured"), std::string::npos);
  struct Spoil {
    const char* what;
    std::function<void(PredictionResult&)> spoil;
  };
  const std::vector<Spoil> spoils{
      {"own over half the published",
       [](auto& r) { r.traces[1] = trace_with(1.18, 2.4, 1, 4, 0.5); }},
      {"own over half of `paper`", [](auto& r) { r.traces[1] = trace_with(1, 1.99, 1, 4, 0.5); }},
      {"own over 1.25", [](auto& r) { r.traces[0] = trace_with(0.43, 0.9, 0.3, 4, 0.2); }},
      {"commands over 0.75", [](auto& r) { r.traces[0] = trace_with(0.40, 0.9, 0.3, 4, 0.28); }},
      {"own over none", [](auto& r) { r.traces[0] = trace_with(0.40, 0.9, 0.3, 0.39, 0.2); }},
      {"predictions changed", [](auto& r) { r.look_ahead["paper"] = 1; }},
  };
  ASSERT_EQ(good.limits().size(), spoils.size());
  for (const Spoil& s : spoils) {
    PredictionResult bad = good;
    s.spoil(bad);
    EXPECT_EQ(bad.missed(), 1) << s.what << printed(bad);
    for (const Limit& l : bad.limits()) {
      if (l.state == Limit::State::kMissed) {
        EXPECT_EQ(l.what.rfind(s.what, 0), 0U) << l.what;
      }
    }
  }
  // What was not run is missed or says why, never met.
  PredictionResult nothing;
  EXPECT_EQ(count(nothing.limits(), Limit::State::kMet), 0);
  good.no_logs = "no folder";
  EXPECT_EQ(count(good.limits(), Limit::State::kNotMeasured), 1);
  EXPECT_NE(good.page("c").find("not measured: no folder"), std::string::npos);
}

// Without slip the wheels tell the truth; with it they are off by its share of the way, 2.5 % in
// the mean.
TEST(Judge, TheFloorOfSlip) {
  MotionTrace trace = robot_trace({2, 20, false, 30, 17});
  trace.delay_min_s = trace.delay_max_s = 0.2;
  const MotionErrors slip = wheels_known(trace), still = judge(trace, method("none"));
  ASSERT_EQ(slip.error_m.size(), still.error_m.size());
  EXPECT_GT(slip.mean_cm(), 0.01 * still.mean_cm());
  EXPECT_LT(slip.mean_cm(), 0.05 * still.mean_cm());
  trace.wheels = trace.truth;
  EXPECT_LT(wheels_known(trace).max_cm(), 1e-9);
}

// With commands known, what is left beyond that floor is lag, jitter and noise.
TEST(Judge, CommandsLeadNearTheFloor) {
  for (const std::uint64_t seed : {21, 22, 23}) {
    for (const bool sideways : {false, true}) {
      MotionTrace trace = robot_trace({1, 20, sideways, 60, seed});
      trace.delay_min_s = trace.delay_max_s = 0.2;
      trace.judged_from = 3;
      const double own = judge(trace, method("own", true)).mean_cm(),
                   floor = wheels_known(trace).mean_cm();
      std::printf("  seed %d: own with commands %.3f cm, floor %.3f cm\n", static_cast<int>(seed),
                  own, floor);
      EXPECT_LT(own, 1.6 * floor);
    }
  }
}

// Every method and every knob at each horizon, with one default; farther ahead is never easier.
TEST(PredictionStudy, HasEachKnobAtEachHorizon) {
  PredictionStudyOptions o;
  o.length_s = 15;
  std::ostringstream progress;
  const Study study = study_prediction(progress, o);
  const std::size_t settings = study.rows.size() / 3;
  EXPECT_EQ(study.rows.size(), 3 * settings);
  EXPECT_EQ(study.plots.size(), 3U);
  std::map<std::string, int> knobs, defaults;
  for (std::size_t i = 0; i < study.rows.size(); ++i) {
    const StudyRow& row = study.rows[i];
    ++knobs[row.knob];
    defaults[row.data] += row.is_default ? 1 : 0;
    EXPECT_GT(row.figure("mean_cm"), 0) << row.setting;
    EXPECT_GT(row.figure("cpu_us"), 0) << row.setting;
    if (i >= settings) {
      EXPECT_EQ(row.setting, study.rows[i - settings].setting);
      EXPECT_GT(row.figure("mean_cm"), study.rows[i - settings].figure("mean_cm")) << row.setting;
    }
  }
  for (const char* knob : {"method", "order", "ridge", "rows"}) EXPECT_GT(knobs[knob], 3) << knob;
  for (const auto& [data, count] : defaults) EXPECT_EQ(count, 1) << data;
}

TEST(PredictionBench, NamesOfItsFigures) {
  PredictionResult r;
  r.traces = {trace_with(0.4, 0.9, 0.3, 4, 0.2)};
  std::vector<std::string> names;
  for (const auto& m : r.metrics()) names.push_back(m.name);
  for (const char* name : {"prediction.one_d100.own.mean_cm", "prediction.one_d100.paper.p95_cm",
                           "prediction.one_d100.constant_velocity.max_cm"})
    EXPECT_NE(std::find(names.begin(), names.end(), name), names.end()) << name;
}

}  // namespace
}  // namespace teletact

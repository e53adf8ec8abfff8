#include "tools/measure/prediction/motion_trace.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "drivers/youbot/mecanum.hpp"
#include "rt/random.hpp"
#include "tools/files/csv.hpp"

namespace teletact {

namespace {

using perception::Pose2;
using perception::Twist2;

// Where two poses are near each other in time: the line between them.
Pose2 between(const Pose2& a, const Pose2& b, double f) {
  return {a.x + f * (b.x - a.x), a.y + f * (b.y - a.y),
          perception::wrap_angle(a.yaw + f * perception::wrap_angle(b.yaw - a.yaw))};
}

template <class T>
T value_of(rt::Result<T> r) {
  if (!r) throw std::runtime_error(r.error());
  return std::move(r).value();
}

struct Manoeuvre {
  Twist2 v;
  double length_s = 1;
};

// Marks lie 0.5 to 3 m apart; between them the base drives one of these, and at some of them it
// stands.
Manoeuvre draw(rt::Random& random, bool sideways, const Twist2& before) {
  const double speed = random.uniform(0.3, 0.8), length_s = random.uniform(1.2, 4.0);
  const double sign = random.uniform() < 0.5 ? -1 : 1;
  const double kind = random.uniform();
  if (kind < 0.15) return {{}, random.uniform(0.5, 2.0)};  // a stop
  if (sideways) return {{0, before.vy > 0 ? -speed : speed, 0}, length_s};
  if (kind < 0.35) return {{speed, 0, 0}, length_s};
  if (kind < 0.60) return {{speed, 0, sign * speed / random.uniform(0.5, 1.5)}, length_s};
  if (kind < 0.72) return {{before.vx > 0 ? -speed : speed, 0, 0}, length_s};  // a reversal
  if (kind < 0.84) return {{0, sign * 0.7 * speed, 0}, length_s};
  if (kind < 0.92) return {{0.6 * speed, sign * 0.6 * speed, 0}, length_s};
  return {{0, 0, sign * random.uniform(0.4, 1.0)}, length_s};
}

double towards(double from, double to, double step) {
  return from + std::clamp(to - from, -step, step);
}

}  // namespace

Pose2 MotionTrace::true_pose(double t) const {
  if (truth.empty()) {
    const auto after = std::lower_bound(rows.begin(), rows.end(), t,
                                        [](const MotionRow& r, double at) { return r.t < at; });
    if (after == rows.begin()) return rows.front().X_OB;
    if (after == rows.end()) return rows.back().X_OB;
    const MotionRow &a = *(after - 1), &b = *after;
    return between(a.X_OB, b.X_OB, (t - a.t) / (b.t - a.t));
  }
  return sampled(truth, t);
}

Pose2 MotionTrace::wheel_pose(double t) const { return sampled(wheels, t); }

Pose2 MotionTrace::sampled(const std::vector<Pose2>& poses, double t) const {
  const double at =
      std::clamp((t - true_t0) / true_step, 0.0, static_cast<double>(poses.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), poses.size() - 2);
  return between(poses[i], poses[i + 1], at - static_cast<double>(i));
}

MotionTrace robot_trace(const RobotTraceOptions& o) {
  constexpr double kStep_s = 0.001, kWheelNoise_rad_per_s = 0.2, kJitter_s = 0.002;
  constexpr double kSlip = 0.05, kRedraw_s = 0.5, kTick_rad = 2 * M_PI / (4000 * 25.8);
  rt::Random driver(o.seed, 1), floor(o.seed, 2), sensor(o.seed, 3);
  const drivers::Mecanum base;
  std::array<double, drivers::kWheels> lag{}, slip{};
  for (double& T : lag) T = floor.uniform(0.06, 0.12);
  MotionTrace trace;
  trace.seed = o.seed;
  trace.true_step = kStep_s;
  drivers::WheelVector wheel{}, angle{};
  drivers::Odometry odometry(base);
  Pose2 X, rolled_to;
  Twist2 reference;
  Manoeuvre now;
  now.length_s = 0.5;
  double left_s = now.length_s, next_row = 0, redraw = 0, next_command = 0;
  const auto steps = static_cast<int>(o.length_s / kStep_s);
  for (int i = 0; i <= steps; ++i) {
    const double t = i * kStep_s;
    trace.truth.push_back(X);
    trace.wheels.push_back(rolled_to);
    if (t >= next_command - 1e-9) {
      trace.commands.push_back({t, reference});
      next_command += 0.02;
    }
    if (t >= next_row - 1e-9) {
      drivers::WheelVector ticks{}, speed{};
      for (std::size_t w = 0; w < ticks.size(); ++w) {
        ticks[w] = std::round(angle[w] / kTick_rad) * kTick_rad;
        speed[w] = wheel[w] + kWheelNoise_rad_per_s * sensor.normal();
      }
      (void)odometry.update(ticks);
      trace.rows.push_back(
          {t, t + sensor.uniform(-kJitter_s, kJitter_s), odometry.pose(), base.forward(speed)});
      next_row += 1 / o.rate_hz;
    }
    if (t >= redraw) {
      for (double& s : slip) s = floor.uniform(0, kSlip);
      redraw += kRedraw_s;
    }
    if ((left_s -= kStep_s) <= 0) {
      now = draw(driver, o.sideways, now.v);
      left_s = now.length_s;
    }
    const double dv = o.acceleration_m_per_s2 * kStep_s;
    reference = {towards(reference.vx, now.v.vx, dv), towards(reference.vy, now.v.vy, dv),
                 towards(reference.wz, now.v.wz, 2 * dv)};
    const drivers::WheelVector wanted = base.inverse(reference);
    drivers::WheelVector rolled{};
    for (std::size_t w = 0; w < wheel.size(); ++w) {
      wheel[w] += (wanted[w] - wheel[w]) * kStep_s / lag[w];
      angle[w] += wheel[w] * kStep_s;
      rolled[w] = wheel[w] * (1 - slip[w]);
    }
    X = perception::integrate(X, base.forward(rolled), kStep_s);
    rolled_to = perception::integrate(rolled_to, base.forward(wheel), kStep_s);
  }
  return trace;
}

MotionTrace log_trace(const std::string& file, const std::string& name) {
  const CsvTable table = value_of(read_csv(file));
  const auto rows =
      value_of(numeric_rows(table, {"t_s", "x_m", "y_m", "yaw_rad", "vx", "vy", "wz"}));
  MotionTrace trace;
  trace.name = name;
  for (const auto& r : rows)
    trace.rows.push_back({r[0], r[0], {r[1], r[2], r[3]}, {r[4], r[5], r[6]}});
  return trace;
}

std::vector<MotionCommand> log_commands(const std::string& file) {
  const CsvTable table = value_of(read_csv(file));
  std::array<std::size_t, 3> column{};
  for (std::size_t k = 0; k < column.size(); ++k) {
    const int at = table.column(std::array{"t_s", "vx", "wz"}[k]);
    if (at < 0) throw std::runtime_error(file + ": needs the columns t_s,vx,wz");
    column[k] = static_cast<std::size_t>(at);
  }
  std::vector<MotionCommand> out;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const double t = value_of(table.number(r, column[0]));
    if (!out.empty() && !(t > out.back().t)) continue;  // stamps of 1 ms: some come twice
    out.push_back(
        {t, {value_of(table.number(r, column[1])), 0, value_of(table.number(r, column[2]))}});
  }
  return out;
}

namespace {

struct Delay {
  const char* name;
  double min_s, max_s;
};
constexpr std::array kDelays{Delay{"d100", 0.1, 0.1}, Delay{"d200", 0.2, 0.2},
                             Delay{"d100_200", 0.1, 0.2}};

void add_delays(const MotionTrace& trace, const std::string& name, std::vector<MotionTrace>& out) {
  for (const Delay& d : kDelays) {
    out.push_back(trace);
    out.back().name = name + "_" + d.name;
    out.back().delay_min_s = d.min_s;
    out.back().delay_max_s = d.max_s;
  }
}

}  // namespace

std::vector<MotionTrace> trace_set(const TraceSetOptions& o) {
  std::vector<MotionTrace> out;
  std::uint64_t seed = o.seed;
  for (const int acceleration : {1, 2, 3}) {
    for (const int rate : {10, 20, 30}) {
      MotionTrace t = robot_trace({1.0 * acceleration, 1.0 * rate, false, o.length_s, seed});
      t.judged_from = 3;
      seed += 1000;
      add_delays(t, "paths_a" + std::to_string(acceleration) + "_" + std::to_string(rate) + "hz",
                 out);
    }
    MotionTrace t = robot_trace({1.0 * acceleration, 20, true, o.length_s, seed});
    t.judged_from = 3;
    seed += 1000;
    add_delays(t, "sideways_a" + std::to_string(acceleration), out);
  }
  if (o.folder.empty()) return out;
  struct Log {
    const char *file, *name, *commands;
  };
  for (const Log& l : {Log{"tuc_lecture_hall", "tuc", ""}, Log{"trolley_mocap_mid", "trolley", ""},
                       Log{"mrclam6_robot3", "mrclam6", "mrclam6_robot3_wheel"}}) {
    MotionTrace t = log_trace(o.folder + "/" + l.file + ".csv", l.name);
    if (*l.commands != 0) t.commands = log_commands(o.folder + "/" + l.commands + ".csv");
    const double half = 0.5 * (t.rows.front().t + t.rows.back().t);
    t.judged_from = o.choice ? t.rows.front().t + 3 : half;
    if (o.choice) t.judged_to = half;
    add_delays(t, l.name, out);
  }
  return out;
}

}  // namespace teletact

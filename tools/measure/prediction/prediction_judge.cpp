#include "tools/measure/prediction/prediction_judge.hpp"

#include <algorithm>
#include <cmath>

#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"
#include "rt/random.hpp"

namespace teletact {

namespace {

using perception::Pose2;

struct Target {
  double t = 0;
  std::size_t newest = 0;  // row
  Pose2 X_OB;
  double condition = 0;
};

constexpr double kSameInstant_s = 1e-6;

// The targets of a trace, as one predictor meets them. Returns thread CPU, us.
template <class Each>
double run(const MotionTrace& trace, const JudgedMethod& m, Each&& each) {
  tasks::MotionPredictor predictor(m.config);
  rt::Random random(trace.seed, 7);
  std::size_t known = 0, command = 0;
  std::vector<Target> targets;
  targets.reserve(trace.rows.size());
  const std::int64_t before = rt::thread_cpu_ns();
  for (const MotionRow& row : trace.rows) {
    const double t = row.t;
    const double delay = random.uniform(trace.delay_min_s, trace.delay_max_s);
    if (m.commands)
      for (; command < trace.commands.size() && trace.commands[command].t <= t; ++command)
        (void)predictor.add_command(trace.commands[command].t, trace.commands[command].v_B);
    for (; known < trace.rows.size() && trace.rows[known].t <= t - delay + kSameInstant_s; ++known)
      (void)predictor.add({trace.rows[known].stamp, trace.rows[known].X_OB, trace.rows[known].v_B});
    tasks::MotionPredictor::Prediction p;
    if (known == 0 || !predictor.predict(t, p)) continue;
    targets.push_back({t, known - 1, p.X_OB, p.condition});
  }
  const double us = 1e-3 * static_cast<double>(rt::thread_cpu_ns() - before);
  for (const Target& target : targets) each(target);
  return us / static_cast<double>(std::max<std::size_t>(trace.rows.size(), 1));
}

}  // namespace

double MotionErrors::mean_cm() const {
  double sum = 0;
  for (const double e : error_m) sum += e;
  return 100 * sum / static_cast<double>(error_m.size());
}
double MotionErrors::p95_cm() const { return 100 * rt::quantile_or_nan(error_m, 0.95); }
double MotionErrors::max_cm() const { return 100 * rt::quantile_or_nan(error_m, 1); }
double MotionErrors::condition_p50() const { return rt::quantile_or_nan(condition, 0.5); }

MotionErrors judge(const MotionTrace& trace, const JudgedMethod& m) {
  MotionErrors out;
  out.method = m.method;
  out.cpu_us = run(trace, m, [&](const Target& target) {
    if (target.t < trace.judged_from || target.t > trace.judged_to) return;
    const MotionRow& row = trace.rows[target.newest];
    const Pose2 said = perception::compose(perception::inverse(row.X_OB), target.X_OB);
    const Pose2 is =
        perception::compose(perception::inverse(trace.true_pose(row.t)), trace.true_pose(target.t));
    out.t_s.push_back(target.t);
    out.error_m.push_back(std::hypot(said.x - is.x, said.y - is.y));
    out.condition.push_back(target.condition);
  });
  return out;
}

MotionErrors wheels_known(const MotionTrace& trace) {
  const auto way = [&](auto pose, double from, double to) {
    return perception::compose(perception::inverse((trace.*pose)(from)), (trace.*pose)(to));
  };
  MotionErrors out;
  out.method = "wheels_known";
  (void)run(trace, {}, [&](const Target& target) {
    if (target.t < trace.judged_from || target.t > trace.judged_to) return;
    const double from = trace.rows[target.newest].t;
    const Pose2 said = way(&MotionTrace::wheel_pose, from, target.t),
                is = way(&MotionTrace::true_pose, from, target.t);
    out.t_s.push_back(target.t);
    out.error_m.push_back(std::hypot(said.x - is.x, said.y - is.y));
  });
  return out;
}

std::vector<Pose2> predicted_poses(const MotionTrace& trace, const JudgedMethod& m) {
  std::vector<Pose2> out;
  (void)run(trace, m, [&](const Target& target) { out.push_back(target.X_OB); });
  return out;
}

int changed_by_the_future(const MotionTrace& trace, const JudgedMethod& m) {
  const std::size_t cut = trace.rows.size() / 2;
  MotionTrace other = trace;
  rt::Random random(99, trace.seed);
  const double t = trace.rows[cut].t;
  for (std::size_t i = 0; i < other.rows.size(); ++i) {
    MotionRow& r = other.rows[i];
    if (r.t <= t - trace.delay_min_s + kSameInstant_s) continue;
    r.X_OB = {random.uniform(-9, 9), random.uniform(-9, 9), random.uniform(-3, 3)};
    r.v_B = {random.uniform(-9, 9), random.uniform(-9, 9), random.uniform(-9, 9)};
  }
  for (MotionCommand& c : other.commands)
    if (c.t > t) c.v_B = {7, -7, 7};
  const auto a = predicted_poses(trace, m), b = predicted_poses(other, m);
  const std::size_t early = trace.rows.size() - a.size();  // rows before the first target
  int changed = 0;
  for (std::size_t i = 0; i + early <= cut && i < a.size(); ++i) changed += a[i] == b[i] ? 0 : 1;
  return changed;
}

MotionErrors best_of_each_instant(const std::vector<MotionErrors>& all) {
  MotionErrors best;
  best.method = "oracle";
  for (const MotionErrors& e : all) {
    if (best.error_m.empty()) {
      best.error_m = e.error_m;
      best.t_s = e.t_s;
    }
    for (std::size_t i = 0; i < best.error_m.size() && i < e.error_m.size(); ++i)
      best.error_m[i] = std::min(best.error_m[i], e.error_m[i]);
  }
  return best;
}

}  // namespace teletact

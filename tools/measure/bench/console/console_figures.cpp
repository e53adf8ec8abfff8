#include "tools/measure/bench/console/console_figures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rt/quantile.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
// The speed before the press is that of so long before it.
constexpr double kBefore_ms = 100;
// A ramp that begins later than this was not caused by the press.
constexpr double kLatest_ms = 500;
// Of the speed before: between them the ramp is straight, and the motors' tail is left out.
constexpr double kHigh = 0.9, kLow = 0.2;
constexpr double kStands_m_per_s = 0.01;

// v = a + b t by least squares.
struct Line {
  double a = 0, b = 0;
};
Line line_through(const std::vector<SpeedAt>& points) {
  const auto n = static_cast<double>(points.size());
  double t = 0, v = 0, tt = 0, tv = 0;
  for (const SpeedAt& p : points) t += p.t_ms / n, v += p.v_m_per_s / n;
  for (const SpeedAt& p : points) {
    tt += (p.t_ms - t) * (p.t_ms - t);
    tv += (p.t_ms - t) * (p.v_m_per_s - v);
  }
  const double b = tv / tt;
  return {v - b * t, b};
}

double median(std::span<const double> values) {
  return rt::quantile_or_nan({values.begin(), values.end()}, 0.5);
}

}  // namespace

StopSeen stop_seen(std::span<const SpeedAt> speeds, double press_ms) {
  StopSeen out{kNaN, kNaN, kNaN, kNaN};
  std::vector<double> before;
  for (const SpeedAt& s : speeds)
    if (s.t_ms > press_ms - kBefore_ms && s.t_ms <= press_ms) before.push_back(s.v_m_per_s);
  if (before.empty()) return out;
  const double v0 = out.before_m_per_s = median(before);
  if (v0 <= 2 * kStands_m_per_s) return out;
  std::vector<SpeedAt> ramp;
  for (const SpeedAt& s : speeds) {
    if (s.t_ms <= press_ms || s.t_ms > press_ms + kLatest_ms) continue;
    if (s.v_m_per_s < kStands_m_per_s) {
      out.stands_ms = s.t_ms - press_ms;
      break;
    }
    if (s.v_m_per_s < kHigh * v0 && s.v_m_per_s > kLow * v0) ramp.push_back(s);
  }
  if (ramp.size() < 3 || std::isnan(out.stands_ms)) return out;
  const Line line = line_through(ramp);
  if (!(line.b < 0)) return out;
  out.falls_ms = (v0 - line.a) / line.b - press_ms;
  out.slope_m_per_s2 = -1e3 * line.b;
  return out;
}

std::optional<std::int64_t> first_start(std::span<const rt::JobRecord> jobs, std::int64_t ns) {
  const auto at =
      std::lower_bound(jobs.begin(), jobs.end(), ns,
                       [](const rt::JobRecord& job, std::int64_t t) { return job.start_ns < t; });
  if (at == jobs.end()) return std::nullopt;
  return at->start_ns;
}

Growth growth(std::span<const double> values) {
  if (values.size() < Growth::kLeast) return {kNaN, kNaN};
  const std::size_t tenth = values.size() / 10;
  return {median(values.subspan(tenth, tenth)), median(values.last(tenth))};
}

std::vector<double> tenths(std::span<const double> values) {
  std::vector<double> out;
  if (values.size() < Growth::kLeast) return out;
  const std::size_t tenth = values.size() / 10;
  for (std::size_t i = 0; i < 9; ++i) out.push_back(median(values.subspan(i * tenth, tenth)));
  out.push_back(median(values.last(tenth)));
  return out;
}

}  // namespace teletact

#include "tools/measure/bench/link/link_window.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>

#include "rt/quantile.hpp"

namespace teletact {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kStands_m_per_s = 0.01, kArm_m = 0.5;  // from the base's centre to what it sees
constexpr std::int64_t kPause_ns = 200'000'000, kTick_ns = 1'000'000;

double age_ms(const tasks::LinkSample& s) {
  return 1e-6 * static_cast<double>(rt::ns_of(s.stamp) - s.made_remote_ns);
}

// Of the newest two samples, m/s.
double speed_between(const TruthSample& a, const TruthSample& b) {
  const double dt = rt::seconds(b.stamp - a.stamp);
  if (dt <= 0) return 0;
  return (std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) +
          kArm_m * std::abs(std::remainder(b.yaw_rad - a.yaw_rad, 2 * M_PI))) /
         dt;
}

}  // namespace

Span_ns settled(std::span<const tasks::LinkSample> samples) {
  std::int64_t first = 0, last = 0;
  for (const auto& s : samples) {
    if (!s.picture) continue;
    if (first == 0) first = rt::ns_of(s.stamp);
    last = rt::ns_of(s.stamp);
  }
  const std::int64_t from = later(first, kSettled_s);
  return {from, std::max(from, later(last, -0.2))};
}

LinkWindow link_window(std::span<const tasks::LinkSample> samples, std::span<const Span_ns> spans) {
  LinkWindow w;
  std::vector<double> picture, state;
  double bytes = 0, spared = 0, keys = 0;
  for (const Span_ns& span : spans) {
    w.seconds += 1e-9 * static_cast<double>(span.to - span.from);
    for (const auto& s : samples) {
      const std::int64_t at = rt::ns_of(s.stamp);
      if (at < span.from || at >= span.to) continue;
      (s.picture ? picture : state).push_back(age_ms(s));
      if (!s.picture) continue;
      bytes += s.bytes;
      spared += s.spared.rungs > 0 ? 1 : 0;
      keys += s.key ? 1 : 0;
    }
  }
  w.pictures = picture.size(), w.states = state.size();
  const auto n = static_cast<double>(picture.size());
  if (w.seconds > 0) w.fps = n / w.seconds, w.mbit_s = 8e-6 * bytes / w.seconds;
  if (n > 0) w.spared_share = spared / n, w.key_share = keys / n;
  w.age_p50_ms = rt::quantile_or_nan(picture, 0.5);
  w.age_p95_ms = rt::quantile_or_nan(picture, 0.95);
  w.age_max_ms = rt::quantile_or_nan(picture, 1.0);
  w.state_p95_ms = rt::quantile_or_nan(state, 0.95);
  return w;
}

double over_stall_ms(std::span<const tasks::LinkSample> samples, Span_ns span, double stall_ms,
                     double path_ms, double rate_Mbit_per_s) {
  double most = kNaN;
  for (const auto& s : samples) {
    const std::int64_t at = rt::ns_of(s.stamp);
    if (!s.picture || at < span.from || at >= span.to) continue;
    const double own_ms = 8e-3 * s.bytes / rate_Mbit_per_s;
    const double over = age_ms(s) - stall_ms - path_ms - own_ms;
    most = std::isnan(most) ? over : std::max(most, over);
  }
  return most;
}

std::vector<Span_ns> moving_spans(const std::vector<TruthSample>& truth, double speed_m_per_s,
                                  double least_s) {
  std::vector<Span_ns> all;
  for (std::size_t i = 1; i < truth.size(); ++i) {
    if (speed_between(truth[i - 1], truth[i]) < speed_m_per_s) continue;
    const std::int64_t from = rt::ns_of(truth[i - 1].stamp), to = rt::ns_of(truth[i].stamp);
    if (!all.empty() && from - all.back().to <= kPause_ns)
      all.back().to = to;
    else
      all.push_back({from, to});
  }
  std::erase_if(
      all, [&](const Span_ns& s) { return 1e-9 * static_cast<double>(s.to - s.from) < least_s; });
  return all;
}

Silence after_silences(const std::vector<tasks::RobotSample>& robot,
                       std::span<const std::int64_t> silences_ns, double until_ms) {
  Silence out;
  for (const std::int64_t at : silences_ns) {
    double before = 0, moved_ms = 0;
    for (const auto& s : robot) {
      const double t_ms = 1e-6 * static_cast<double>(rt::ns_of(s.stamp) - at);
      const auto v = static_cast<double>(s.speed_m_per_s);
      if (t_ms <= 0) before = v;
      if (t_ms > 0 && t_ms < until_ms && v > kStands_m_per_s) moved_ms = t_ms;
    }
    if (before <= kStands_m_per_s) continue;
    ++out.driving;
    out.stands_ms = std::max(out.stands_ms, moved_ms);
  }
  return out;
}

Silence after_gaps(std::span<const tasks::RobotSample> robot, double least_ms) {
  Silence out;
  for (std::size_t i = 0; i < robot.size();) {
    std::size_t next = i;
    double moved_ms = 0, last_ms = 0;
    while (next < robot.size() && robot[next].goal_seq == robot[i].goal_seq) {
      last_ms =
          1e-6 * static_cast<double>(rt::ns_of(robot[next].stamp) - rt::ns_of(robot[i].stamp));
      if (static_cast<double>(robot[next].speed_m_per_s) > kStands_m_per_s) moved_ms = last_ms;
      ++next;
    }
    const bool drove =
        robot[i].driving && static_cast<double>(robot[i].speed_m_per_s) > kStands_m_per_s;
    if (drove && last_ms > least_ms) {
      ++out.driving;
      out.stands_ms = std::max(out.stands_ms, moved_ms);
    }
    i = next;
  }
  return out;
}

std::vector<Felt> felt_images(std::span<const tasks::HapticSample> haptic,
                              std::span<const tasks::FusionSample> fusion,
                              std::span<const tasks::LinkSample> link) {
  std::unordered_map<std::int64_t, const tasks::LinkSample*> pictures;
  for (const auto& s : link) {
    if (s.picture) pictures[rt::ns_of(s.made)] = &s;
  }
  std::vector<Felt> out;
  std::size_t at = 0;
  const tasks::FusionSample* newest = nullptr;  // that the patch in use knows
  const tasks::FusionSample* felt = nullptr;
  for (const auto& h : haptic) {
    const std::int64_t fused_ns =
        rt::ns_of(h.stamp) - static_cast<std::int64_t>(1e9 * static_cast<double>(h.patch_age_s));
    // A tick's stamp and the instant that its patch's age counts from may differ by a part of a
    // period.
    while (at < fusion.size() && rt::ns_of(fusion[at].stamp) <= fused_ns + kTick_ns) {
      if (fusion[at].integrated) newest = &fusion[at];
      ++at;
    }
    if (!h.in_contact || newest == nullptr || newest == felt) continue;
    felt = newest;
    const auto picture = pictures.find(rt::ns_of(felt->exposure));
    if (picture != pictures.end()) out.push_back({felt, picture->second, &h});
  }
  return out;
}

std::vector<double> felt_after_ms(std::span<const tasks::HapticSample> haptic,
                                  std::span<const tasks::FusionSample> fusion,
                                  std::span<const tasks::LinkSample> link) {
  std::vector<double> out;
  for (const Felt& f : felt_images(haptic, fusion, link))
    out.push_back(1e-6 * static_cast<double>(rt::ns_of(f.tick->stamp) - f.picture->made_remote_ns));
  return out;
}

}  // namespace teletact

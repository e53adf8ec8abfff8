#include "tools/pictures/link_seen.hpp"
#include "rt/quantile.hpp"

#include <algorithm>

namespace teletact {

void LinkTally::add(const tasks::LinkSample& s) noexcept {
  const std::int64_t ms = (s.stamp - s.made).count() / 1000000;
  const auto at = static_cast<std::size_t>(std::clamp<std::int64_t>(ms, 0, kMost_ms));
  if (!s.picture) {
    ++states;
    ++state_ms[at];
    return;
  }
  if (pictures++ == 0) first = s.stamp;
  last = s.stamp;
  keys += s.key ? 1 : 0;
  picture_bytes += s.bytes;
  ++by_rungs[std::min<std::size_t>(s.spared.rungs, by_rungs.size() - 1)];
  ++picture_ms[at];
}

double LinkTally::pictures_per_s() const noexcept {
  const double span_s = rt::seconds(last - first);
  return span_s > 0 ? static_cast<double>(pictures - 1) / span_s : 0;
}

double LinkTally::picture_Mbit_per_s() const noexcept {
  const double span_s = rt::seconds(last - first);
  return span_s > 0 ? 8e-6 * static_cast<double>(picture_bytes) / span_s : 0;
}

double LinkTally::spared_share() const noexcept {
  return pictures == 0
             ? 0
             : static_cast<double>(pictures - by_rungs[0]) / static_cast<double>(pictures);
}

double LinkTally::quantile_ms(const Ages& ages, double q) noexcept {
  std::uint64_t all = 0, seen = 0;
  for (const auto n : ages) all += n;
  if (all == 0) return -1;
  const std::uint64_t rank = rt::quantile_rank(q, all);
  for (std::size_t ms = 0; ms < ages.size(); ++ms) {
    seen += ages[ms];
    if (seen >= rank) return static_cast<double>(ms);
  }
  return static_cast<double>(kMost_ms);
}

void LinkSeen::drain(tasks::LinkSamples& ring) {
  tasks::LinkSample s;
  while (ring.try_pop(s)) newest.push_back(s);
  if (newest.size() < 2 * kWhole) return;
  const auto middle = newest.begin() + static_cast<std::ptrdiff_t>(kWhole);
  std::for_each(newest.begin(), middle, [this](const auto& old) { past.add(old); });
  newest.erase(newest.begin(), middle);
}

LinkTally LinkSeen::all() const noexcept {
  LinkTally t = past;
  for (const auto& s : newest) t.add(s);
  return t;
}

void add_link_metrics(const LinkSeen& seen, std::int64_t round_trip_ns, Metrics& m) {
  m.add("link.round_trip_ms", 1e-6 * static_cast<double>(round_trip_ns), "ms");
  const LinkTally t = seen.all();
  if (t.states > 0) m.add("link.state_age_p95_ms", t.quantile_ms(t.state_ms, 0.95), "ms");
  if (t.pictures == 0) return;
  m.add("link.pictures_per_s", t.pictures_per_s(), "1/s");
  m.add("link.picture_age_p50_ms", t.quantile_ms(t.picture_ms, 0.5), "ms");
  m.add("link.picture_age_p95_ms", t.quantile_ms(t.picture_ms, 0.95), "ms");
  m.add("link.picture_Mbit_per_s", t.picture_Mbit_per_s(), "Mbit/s");
  m.add("link.spared_share", t.spared_share(), "1");
}

}  // namespace teletact

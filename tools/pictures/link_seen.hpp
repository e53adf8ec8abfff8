// What arrived over the link, as the operator's console has seen it: the newest minutes whole, of
// all of it how many, how large, how old.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "tasks/graph/samples.hpp"
#include "tools/files/metrics_json.hpp"

namespace teletact {

struct LinkTally {
  static constexpr std::size_t kMost_ms = 4000;  // older ones count as this
  using Ages = std::array<std::uint32_t, kMost_ms + 1>;
  std::uint64_t pictures = 0, keys = 0, states = 0, picture_bytes = 0;
  std::array<std::uint64_t, drivers::Spared::kMost + 1> by_rungs{};  // pictures
  rt::Time first{}, last{};                                          // of the pictures
  Ages picture_ms{}, state_ms{};                                     // by age, whole ms

  // In order of time.
  void add(const tasks::LinkSample& s) noexcept;
  [[nodiscard]] double pictures_per_s() const noexcept;  // between the first and the last; else 0
  [[nodiscard]] double picture_Mbit_per_s() const noexcept;
  [[nodiscard]] double spared_share() const noexcept;  // pictures with anything lowered
  // At the nearest rank; below 0: none arrived.
  [[nodiscard]] static double quantile_ms(const Ages& ages, double q) noexcept;
};

struct LinkSeen {
  // When there are twice so many, the older half goes: five minutes and more stay whole.
  static constexpr std::size_t kWhole = 40000;
  std::vector<tasks::LinkSample> newest;
  LinkTally past;  // of those that went

  void drain(tasks::LinkSamples& ring);
  [[nodiscard]] LinkTally all() const noexcept;
};

// link.round_trip_ms, link.pictures_per_s and the like (docs/metrics.md); what did not arrive is
// left out.
void add_link_metrics(const LinkSeen& seen, std::int64_t round_trip_ns, Metrics& metrics);

}  // namespace teletact

// What drivers count, as figures by name.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <utility>

#include "drivers/haptic/exchange_histogram.hpp"
#include "tools/scene/haptic_kind.hpp"

namespace teletact {

inline double as_number(std::uint64_t n) { return static_cast<double>(n); }

inline OpenedDevice::Figures counted(
    std::initializer_list<std::pair<const char*, std::uint64_t>> numbers) {
  OpenedDevice::Figures out;
  for (const auto& [name, n] : numbers) out.emplace_back(name, as_number(n));
  return out;
}

inline void add_times(OpenedDevice::Figures& out, const std::string& name,
                      const drivers::ExchangeHistogram& h) {
  out.emplace_back(name + "_p50_us", static_cast<double>(h.quantile_ns(0.5)) * 1e-3);
  out.emplace_back(name + "_p99_us", static_cast<double>(h.quantile_ns(0.99)) * 1e-3);
  out.emplace_back(name + "_max_us", static_cast<double>(h.max_ns()) * 1e-3);
  out.emplace_back(name + "_over_bound", as_number(h.over_bound()));
}

}  // namespace teletact

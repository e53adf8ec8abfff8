// What drivers count, as figures by name.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/haptic/exchange_histogram.hpp"
#include "tools/scene/haptic_kind.hpp"

namespace teletact {

inline double as_number(std::uint64_t n) { return static_cast<double>(n); }

inline void add_times(OpenedDevice::Figures& out, const std::string& name,
                      const drivers::ExchangeHistogram& h) {
  out.emplace_back(name + "_p50_us", static_cast<double>(h.quantile_ns(0.5)) * 1e-3);
  out.emplace_back(name + "_p99_us", static_cast<double>(h.quantile_ns(0.99)) * 1e-3);
  out.emplace_back(name + "_max_us", static_cast<double>(h.max_ns()) * 1e-3);
  out.emplace_back(name + "_over_bound", as_number(h.over_bound()));
}

}  // namespace teletact

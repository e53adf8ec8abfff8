// What `teletact identify` found: on stdout, as figures, and as keys of a scene.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/haptic/haptic_device.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/touch/ring_down.hpp"

namespace teletact {

struct Identified {
  IdentifyResult result;
  drivers::DeviceProperties stated;   // by its configuration
  std::uint64_t ticks = 0, late = 0;  // of a real device
};

// Section [device] of a scene, with the date of today.
[[nodiscard]] std::string identified_keys(const std::string& kind, const IdentifyResult& r);
void print_identified(const Identified& found, bool fit_delay);
[[nodiscard]] Metrics identified_metrics(const Identified& found);

}  // namespace teletact

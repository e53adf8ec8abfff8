#include "drivers/emulator/network_config.hpp"

#include <cstdio>

namespace drivers {

namespace {

constexpr double kLongestRun_s = 864000;  // ten days
// Of the time: stalls that took all of it would hold the line for ever.
constexpr double kMostStalled = 0.9;
// Of the time between two flaps, which begin anywhere in the first half of it.
constexpr double kMostDown = 0.4;

std::string network_error(const char* key, double value, const std::string& allowed) {
  char text[64];
  std::snprintf(text, sizeof text, "key 'link.network.%s' = %g: allowed ", key, value);
  return text + allowed;
}

}  // namespace

void RateChangeConfig::describe(config::Section& s) {
  s.number("at_s", at_s, 0, kLongestRun_s, "when, from the start of the run");
  s.number("rate_Mbit_per_s", rate_Mbit_per_s, 0.01, 10000, "of the bottleneck from then on");
}

void StallConfig::describe(config::Section& s) {
  s.number("at_s", at_s, 0, kLongestRun_s, "begin of the first, from the start of the run");
  s.number("for_ms", for_ms, 1, 60000, "the bottleneck carries nothing for so long");
  s.number("every_s", every_s, 0, 3600, "from begin to begin; 0: once");
}

void CutConfig::describe(config::Section& s) {
  s.number("at_s", at_s, 0, kLongestRun_s, "from then on nothing arrives; neither side is told");
  s.text("way", way, {"both", "to_robot", "to_operator"}, "one way alone: a half-open connection");
}

bool CutConfig::of(Way w) const {
  return way == "both" || (way == "to_robot") == (w == Way::kToRobot);
}

void NetworkConfig::describe(config::Section& s) {
  s.number("rate_Mbit_per_s", rate_Mbit_per_s, 0, 10000, "bottleneck, each way; 0 = none");
  s.number("queue_kB", queue_kB, 1, 100000, "bytes that wait before it; a sender with more waits");
  s.number("delay_ms", delay_ms, 0, 2000, "one-way delay");
  s.number("jitter_ms", jitter_ms, 0, 500, "uniform extra delay of a message, in order");
  s.seed("seed", seed, "of jitter, flaps and damage");
  s.list(
      "rate_change", [this](config::Section& item) { rate_changes.emplace_back().describe(item); },
      "another rate of the bottleneck, in order of time");
  s.list(
      "stall", [this](config::Section& item) { stalls.emplace_back().describe(item); },
      "the bottleneck carries nothing for a while; nothing is lost");
  s.list(
      "cut", [this](config::Section& item) { cuts.emplace_back().describe(item); },
      "the cable is cut for good");
  s.number("flaps_per_minute", flaps_per_minute, 0, 120,
           "the connection ends and both sides are told; what was on the way is lost");
  s.number("flap_down_ms", flap_down_ms, 1, 60000, "then nothing crosses for so long");
  s.number("flap_from_s", flap_from_s, 0, kLongestRun_s, "no flap before, from the start");
  s.number("corrupt_per_MB", corrupt_per_MB, 0, 100000, "bytes changed of a million, at random");
  s.number("corrupt_from_s", corrupt_from_s, 0, kLongestRun_s, "no damage before");
}

std::string NetworkConfig::wrong() const {
  double last_s = -1;
  for (const RateChangeConfig& c : rate_changes) {
    if (c.at_s <= last_s)
      return network_error("rate_change.at_s", c.at_s, "later than the one before it");
    last_s = c.at_s;
  }
  if (!rate_changes.empty() && rate_Mbit_per_s <= 0)
    return network_error("rate_Mbit_per_s", rate_Mbit_per_s, "above 0 where rate_change names one");
  double share = 0;
  for (const StallConfig& s : stalls) {
    if (s.every_s > 0) share += 1e-3 * s.for_ms / s.every_s;
  }
  if (share > kMostStalled)
    return network_error("stall", share, "stalls of 0.9 of the time, all that repeat together");
  const double between_ms = flaps_per_minute > 0 ? 60e3 / flaps_per_minute : 0;
  if (flaps_per_minute > 0 && flap_down_ms > kMostDown * between_ms)
    return network_error("flap_down_ms", flap_down_ms,
                         "0.4 of the time between two flaps, here up to " +
                             std::to_string(static_cast<int>(kMostDown * between_ms)));
  return {};
}

bool NetworkConfig::any() const noexcept {
  return rate_Mbit_per_s > 0 || delay_ms > 0 || jitter_ms > 0 || !stalls.empty() || !cuts.empty() ||
         flaps_per_minute > 0 || corrupt_per_MB > 0;
}

}  // namespace drivers

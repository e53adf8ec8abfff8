// Section [link.network]: the network that a scene wants between its boxes. A scene that does not
// name it has none, and nothing of it is built. All instants count from the epoch of the run, so
// both ends of a link emulate the same stalls, cuts and flaps without telling each other.
//
//   [link.network]
//   rate_Mbit_per_s = 10        # bottleneck, each way
//   queue_kB = 200              # bytes that wait before it; a sender with more waits
//   delay_ms = 75               # one way
//   jitter_ms = 20
//   [[link.network.rate_change]]
//   at_s = 20
//   rate_Mbit_per_s = 4
//   [[link.network.stall]]      # for 400 ms the bottleneck carries nothing; nothing is lost
//   at_s = 4
//   for_ms = 400
//   every_s = 4
//   [[link.network.cut]]        # for good, told to nobody; one way alone: half-open
//   at_s = 30
//   way = "to_robot"
#pragma once

#include <cstdint>
#include <deque>
#include <string>

#include "config/schema.hpp"

namespace drivers {

enum class Way : std::uint8_t { kToRobot, kToOperator };

struct RateChangeConfig {
  double at_s = 0;
  double rate_Mbit_per_s = 10;
  void describe(config::Section& s);
};

struct StallConfig {
  double at_s = 0;
  double for_ms = 400;
  double every_s = 0;  // 0: once
  void describe(config::Section& s);
};

struct CutConfig {
  double at_s = 0;
  std::string way = "both";
  void describe(config::Section& s);
  [[nodiscard]] bool of(Way w) const;
};

struct NetworkConfig {
  double rate_Mbit_per_s = 0;  // 0: no bottleneck
  double queue_kB = 200;
  double delay_ms = 0;
  double jitter_ms = 0;  // uniform, 0 .. jitter, of one message after the other; order is kept
  std::uint64_t seed = 1;
  std::deque<RateChangeConfig> rate_changes;  // times rise
  std::deque<StallConfig> stalls;
  std::deque<CutConfig> cuts;
  double flaps_per_minute = 0, flap_down_ms = 300, flap_from_s = 0;
  double corrupt_per_MB = 0, corrupt_from_s = 0;

  void describe(config::Section& s);
  // What no single key can be wrong about: "key 'network.stall' = ...: allowed ..."; empty: well.
  [[nodiscard]] std::string wrong() const;
  [[nodiscard]] bool any() const noexcept;
};

}  // namespace drivers

// What happens to a line and when, as its configuration says: its rate over time, stalls, flaps. A
// function of time alone, so that both ends of a link, and two runs, see the same.
//
// Times are host ns. The rate is piecewise constant; in a stall it is zero. A flap is an interval
// in which the line is down; flap k begins anywhere in the first half of the k-th part of a minute
// (uniform, by seed and k).
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "drivers/emulator/network_config.hpp"

namespace drivers {

inline constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

class LineSchedule {
 public:
  // `epoch_ns`: the start of the run, from which the configuration counts.
  LineSchedule(const NetworkConfig& c, std::int64_t epoch_ns);

  // When a line that begins at `start_ns` has carried `bytes`; `start_ns` itself without a
  // bottleneck and outside a stall.
  [[nodiscard]] std::int64_t carried_at(std::int64_t start_ns, std::size_t bytes) const noexcept;
  // Bits a nanosecond; 0: no bottleneck. A stall does not show here.
  [[nodiscard]] double rate_at(std::int64_t t_ns) const noexcept;
  // End of the stall, or of the chain of stalls, that covers t; t itself outside one.
  [[nodiscard]] std::int64_t stalled_until(std::int64_t t_ns) const noexcept;

  struct Flap {
    std::uint64_t count = 0;              // how many have begun by t
    bool down = false;                    // t lies in the last of them
    std::int64_t next_begin_ns = kNever;  // of the first after t
  };
  [[nodiscard]] Flap flap_at(std::int64_t t_ns) const noexcept;

 private:
  struct Rate {
    std::int64_t from;
    double bit_per_ns;
  };
  struct Stall {
    std::int64_t first, length, every;  // every 0: once
  };
  [[nodiscard]] std::int64_t flap_begin(std::int64_t k) const noexcept;
  [[nodiscard]] std::int64_t next_change(std::int64_t t_ns) const noexcept;

  std::vector<Rate> rates_;
  std::vector<Stall> stalls_;
  std::uint64_t seed_;
  std::int64_t flap_from_ = 0, flap_period_ = 0, flap_length_ = 0;
};

}  // namespace drivers

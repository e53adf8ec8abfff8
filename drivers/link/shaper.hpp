// Shapes a loopback link like a real network: a bottleneck rate, a fixed delay and jitter, in
// order. An effect: built only when a scene's [link.shape] names it.
#pragma once

#include <algorithm>
#include <cstdint>

#include "config/schema.hpp"
#include "rt/random.hpp"
#include "rt/time.hpp"

namespace drivers {

// Section [link.shape].
struct LinkShapeConfig {
  double delay_ms = 0;         // one way
  double jitter_ms = 0;        // uniform, 0 .. jitter
  double rate_Mbit_per_s = 0;  // 0: no bottleneck
  std::uint64_t seed = 1;

  void describe(config::Section& s) {
    s.number("delay_ms", delay_ms, 0, 2000, "one-way delay");
    s.number("jitter_ms", jitter_ms, 0, 500, "uniform extra delay, in order");
    s.number("rate_Mbit_per_s", rate_Mbit_per_s, 0, 10000, "bottleneck; 0 = none");
    s.seed("seed", seed, "of the jitter");
  }
  [[nodiscard]] bool any() const noexcept {
    return delay_ms > 0 || jitter_ms > 0 || rate_Mbit_per_s > 0;
  }
};

class LinkShaper {
 public:
  LinkShaper(const LinkShapeConfig& c, std::uint64_t direction) noexcept
      : config_(c), random_(c.seed, direction) {}

  // When bytes handed over at `now` come out at the other end (host ns). Monotone.
  [[nodiscard]] std::int64_t deliver_at(std::int64_t now_ns, std::size_t bytes) noexcept {
    std::int64_t t = std::max(now_ns, line_free_);
    if (config_.rate_Mbit_per_s > 0) {
      t += static_cast<std::int64_t>(static_cast<double>(bytes) * 8e3 / config_.rate_Mbit_per_s);
    }
    line_free_ = t;
    t += static_cast<std::int64_t>(config_.delay_ms * 1e6);
    if (config_.jitter_ms > 0)
      t += static_cast<std::int64_t>(random_.uniform() * config_.jitter_ms * 1e6);
    last_ = std::max(last_, t);
    return last_;
  }
  // True while the bottleneck still works on what it was given: a newest-wins sender waits.
  [[nodiscard]] bool busy(std::int64_t now_ns) const noexcept { return line_free_ > now_ns; }
  // How long it will; 0: it is free.
  [[nodiscard]] rt::Nanos busy_for(std::int64_t now_ns) const noexcept {
    return rt::Nanos{std::max<std::int64_t>(0, line_free_ - now_ns)};
  }

 private:
  LinkShapeConfig config_;
  rt::Random random_;
  std::int64_t line_free_ = 0, last_ = 0;
};

}  // namespace drivers

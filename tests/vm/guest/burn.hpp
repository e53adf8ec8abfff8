// CPU time as a number of loops: where time is counted in instructions, a job takes the same each
// time, and no clock is asked meanwhile.
#pragma once

#include <cstdint>

#include "rt/clock/box_time.hpp"

namespace vm {

class Burner {
 public:
  // Measures how many loops a microsecond takes; on the calling thread, for some milliseconds.
  Burner() {
    constexpr std::uint64_t kLoops = 1'000'000;
    const std::int64_t begin = rt::thread_cpu_ns();
    spin(kLoops);
    loops_per_ns_ = static_cast<double>(kLoops) / static_cast<double>(rt::thread_cpu_ns() - begin);
  }
  void burn(rt::Nanos cpu) const noexcept {
    spin(static_cast<std::uint64_t>(loops_per_ns_ * static_cast<double>(cpu.count())));
  }

 private:
  static void spin(std::uint64_t loops) noexcept {
    std::uint64_t x = loops | 1U;
    for (std::uint64_t i = 0; i < loops; ++i) {
      x ^= x << 13U;
      x ^= x >> 7U;
      asm volatile("" : "+r"(x));
    }
  }
  double loops_per_ns_ = 0;
};

}  // namespace vm

// What a fault plan does to one job. Two policies with one shape: Plain knows no faults and compiles
// to nothing, Planned asks the plan. Both executors are built with each; the choice falls at start.
#pragma once

#include <cstdint>

#include "rt/time.hpp"

namespace rt {

struct JobFaults {
  Nanos late{0};        // the release comes this much later
  Nanos extra_cpu{0};   // added to the job's own work
  Nanos block{0};       // waits without the CPU, after its inputs were latched
  Nanos hog{0};         // from this release on, something above all tasks holds the core
  Nanos theft{0};       // from this release on, the core is gone
  int page_faults = 0;  // pages touched for the first time inside the job
  bool dead = false;    // the thread ends here
  [[nodiscard]] bool any() const noexcept {
    return late.count() != 0 || extra_cpu.count() != 0 || block.count() != 0 || hog.count() != 0 ||
           theft.count() != 0 || page_faults != 0 || dead;
  }
};

struct Plain {
  static constexpr bool kEnabled = false;
  [[nodiscard]] static constexpr JobFaults job(std::uint16_t, std::uint64_t) noexcept { return {}; }
};

}  // namespace rt

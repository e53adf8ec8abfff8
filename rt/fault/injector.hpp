// What a fault plan does to one job. Two policies with one shape: Plain knows no faults and
// compiles to nothing, Planned asks the plan. Both executors are built with each; the choice falls
// at start. A build with TELETACT_FAULTS=OFF has no executor for Planned.
#pragma once

#include <cstdint>

#include "rt/time.hpp"

#ifndef TELETACT_FAULTS  // set by the build
#define TELETACT_FAULTS 1
#endif

namespace rt {

inline constexpr bool kFaultsBuilt = TELETACT_FAULTS != 0;

struct JobFaults {
  Nanos late{0};        // the release arrives this much later; its deadline stays
  Nanos extra_cpu{0};   // added to the job's own work
  Nanos block{0};       // waits without the CPU, after its inputs were latched
  Nanos hog{0};         // from the nominal release on, this much CPU above all tasks of the core
  Nanos theft{0};       // from the nominal release on, the core is gone for this long
  Nanos page_fault{0};  // what a page fault costs in virtual time
  bool touch_page = false;  // on the machine: touch a page that was given back
  bool dead = false;        // the thread ends instead of starting this release
  [[nodiscard]] bool any() const noexcept {
    return late.count() != 0 || extra_cpu.count() != 0 || block.count() != 0 || hog.count() != 0 ||
           theft.count() != 0 || page_fault.count() != 0 || touch_page || dead;
  }
};

struct Plain {
  static constexpr bool kEnabled = false;
  [[nodiscard]] static constexpr JobFaults job(std::uint16_t, std::uint64_t) noexcept { return {}; }
  [[nodiscard]] static constexpr bool has_spans() noexcept { return false; }
};

}  // namespace rt

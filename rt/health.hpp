// What a step() reports: the worst thing that happened in it, and which fault it was.
#pragma once

#include <cstdint>

namespace rt {

// Ordered: a larger value is worse, and combining keeps the worst.
enum class Severity : std::uint8_t {
  kOk = 0,
  kCounted = 1,   // noted in the audit, nothing else
  kDegraded = 2,  // works, with less: the output is held or reduced
  kRampDown = 3,  // outputs go to zero along their ramp
  kSafeStop = 4,  // outputs are made safe at once; recovery needs an operator
};

// Fault ids are listed with severity, reaction and clear rule in docs/faults.md.
using FaultId = std::uint16_t;
inline constexpr FaultId kNoFault = 0;

struct Health {
  Severity severity = Severity::kOk;
  FaultId fault = kNoFault;

  [[nodiscard]] static constexpr Health ok() noexcept { return {}; }
  [[nodiscard]] static constexpr Health of(Severity s, FaultId f) noexcept { return {s, f}; }
  friend constexpr bool operator==(const Health&, const Health&) = default;
};

// The worse of two; the first one on a tie.
[[nodiscard]] constexpr Health worst(Health a, Health b) noexcept {
  return b.severity > a.severity ? b : a;
}

}  // namespace rt

// How long a box may take to be safe once the other one is gone, from the keys that decide it.
//
// Robot box     the link silent for its liveness, one period of robot_io to notice and one for the
//               setpoints to go out, the ramp from the speed limit, the motors' tail: base standing.
// Operator box  the link silent for its liveness, one period of supervision, the ramp of the force
//               (its own or what the slew guard allows), one period of haptic: force zero.
//
// A connection that ends (the other process was killed) is known at once, so it takes the same time
// less the liveness. What the machine adds by starting jobs late is not in it: the audit has that.
#pragma once

#include <string>

#include "tasks/graph/graph_config.hpp"

namespace tasks {

inline constexpr double kSafeWithin_s = 0.300;

struct SafeTimes {
  double base_stands_s = 0, force_zero_s = 0;
};
[[nodiscard]] SafeTimes safe_times(const GraphConfig& config);

// Empty, or one line that names the keys, what they add up to and what is allowed.
[[nodiscard]] std::string check_safe_times(const GraphConfig& config);

}  // namespace tasks

// The rules of touch for a task without effects: what is counted as their cost when nobody asks.
#pragma once

#include "tasks/haptic/touch_law.hpp"

namespace tasks {

struct TouchRules : TouchLaw {
  static constexpr bool kEffects = false;
};

}  // namespace tasks

// The rules that the haptic task touches by. A target that is built to be wrong, or to count, has
// another file of this name earlier in its include path (tests/negative/haptic/rules,
// tools/measure/haptic/count/plain).
#pragma once

#include "tasks/haptic/touch_law.hpp"

namespace tasks {

using TouchRules = TouchLaw;

}  // namespace tasks

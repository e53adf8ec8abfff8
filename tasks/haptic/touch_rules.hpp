// The rules that the haptic task touches by. A target that is built to be wrong, or to count, has
// another file of this name earlier in its include path (tests/negative/haptic/rules,
// tools/measure/haptic/count/plain).
#pragma once

#if defined(TELETACT_HAPTIC_BROKEN) && TELETACT_HAPTIC_BROKEN
#include "tasks/haptic/broken.hpp"
#else
#include "tasks/haptic/touch_law.hpp"
#endif

namespace tasks {

#if defined(TELETACT_HAPTIC_BROKEN) && TELETACT_HAPTIC_BROKEN
using TouchRules = BrokenRules;
#else
using TouchRules = TouchLaw;
#endif

}  // namespace tasks

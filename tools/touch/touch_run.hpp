// The run of `teletact touch` on fields and a path.
#pragma once

#include "tools/touch/touch_options.hpp"

namespace teletact::touch {

// Writes the outputs that the options ask for. Throws std::runtime_error with one line.
void run(const Options& o);

}  // namespace teletact::touch

// The commands that measure the product are a separate program, so that the product contains no
// code of them.
#pragma once

namespace teletact {

// Replaces this process by `teletact-measure COMMAND ...`; argv[0] is the command's name. Looks for
// it beside this program (build folder), then in ../libexec/teletact (installation). Returns only
// if it is not found: throws std::runtime_error with both places.
int start_measure(int argc, char** argv);

}  // namespace teletact

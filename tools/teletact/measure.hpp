// The commands that measure the product are a program of their own, so that the product holds nothing of them.
#pragma once

namespace teletact {

// Becomes `teletact-measure COMMAND ...`, argv[0] being the command's name. It is looked for beside this program, where a
// build puts it, then in ../libexec/teletact, where an installation does. Returns only where it is not found: throws
// std::runtime_error with both places.
int start_measure(int argc, char** argv);

}  // namespace teletact

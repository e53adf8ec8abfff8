// Where the source tree and the build of a test lie: for tests that read the tree's files or start
// the built programs. Their source is generated, so that no other object knows a folder's name.
#pragma once

#include <string>

namespace tests {

// A file below the source tree; an empty name: the tree itself.
std::string in_tree(const std::string& name = {});
// A file below the build folder.
std::string in_build(const std::string& name = {});

}  // namespace tests

// The commit of a page of figures.
#pragma once

#include <string>

namespace teletact {

// Of the tree that this program was built in, "-dirty" behind it where files differ from it; "not
// recorded" where there is none.
[[nodiscard]] std::string tree_commit();

}  // namespace teletact

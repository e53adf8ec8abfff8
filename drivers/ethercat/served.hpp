// Which slaves of a chain can be driven: one that can not (its EEPROM is damaged, it wants more
// than is served) stays in the list with its reason, and takes no part in the process data.
#pragma once

#include <vector>

#include "drivers/ethercat/mapping.hpp"

namespace drivers::ethercat {

struct ServedChain {
  ProcessMapping mapping;  // of every slave; without blocks and data for those with a problem
  std::string problem;     // the first slave's, or the whole chain's; empty: it can be driven
};
// Sets each slave's `problem`, unless it has one.
[[nodiscard]] ServedChain map_served(std::vector<SlaveInfo>& slaves);

}  // namespace drivers::ethercat

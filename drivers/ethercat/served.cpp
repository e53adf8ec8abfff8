#include "drivers/ethercat/served.hpp"

namespace drivers::ethercat {

namespace {

// Its place in the chain and its address, and nothing that is mapped.
SlaveInfo without_content(const SlaveInfo& s) {
  SlaveInfo out;
  out.position = s.position;
  out.station = s.station;
  return out;
}

}  // namespace

ServedChain map_served(std::vector<SlaveInfo>& slaves) {
  ServedChain out;
  std::vector<SlaveInfo> fit;
  for (SlaveInfo& s : slaves) {
    if (s.problem.empty())
      if (const auto alone = map_process_data({s}); !alone) s.problem = alone.error();
    if (out.problem.empty()) out.problem = s.problem;
    fit.push_back(s.problem.empty() ? s : without_content(s));
  }
  auto mapping = map_process_data(fit);
  if (mapping) {
    out.mapping = std::move(mapping.value());
    return out;
  }
  // Each is served and all together are not: too much process data.
  if (out.problem.empty()) out.problem = mapping.error();
  for (const SlaveInfo& s : slaves) out.mapping.slaves.emplace_back().station = s.station;
  return out;
}

}  // namespace drivers::ethercat

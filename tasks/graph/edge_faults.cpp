#include "tasks/graph/edge_faults.hpp"

#include <string>
#include <vector>

namespace tasks {

bool edge_takes(EdgeId edge, rt::FaultKind kind) noexcept {
  if (!rt::acts_on_edge(kind)) return false;
  if (kind == rt::FaultKind::kRingFull)
    return kEdgeTable[static_cast<std::size_t>(edge)].kind == EdgeKind::kRing;
  if (kind == rt::FaultKind::kNan) {
    return edge != EdgeId::kFrame && edge != EdgeId::kTask && edge != EdgeId::kMode &&
           edge != EdgeId::kRobotMode;
  }
  return true;
}

rt::Result<bool> check_faults(const rt::FaultPlan& plan) {
  std::vector<std::string> tasks, edges;
  for (const auto& row : kTaskTable) tasks.emplace_back(row.name);
  for (const auto& row : kEdgeTable) edges.emplace_back(row.name);
  if (auto good = rt::check(plan, tasks, edges); !good) return good;
  for (std::size_t i = 0; i < plan.entries.size(); ++i) {
    const auto& e = plan.entries[i];
    for (const auto& row : kEdgeTable) {
      if (row.name != e.target || !rt::acts_on_edge(e.kind) || edge_takes(row.id, e.kind)) continue;
      return rt::Error{
          "fault plan '" + plan.name + "', fault " + std::to_string(i + 1) + ": " +
          std::string(rt::name_of(e.kind)) + " on '" + e.target + "': " +
          (e.kind == rt::FaultKind::kRingFull
               ? "this edge is no ring (rings: touch, edit)"
               : "this edge carries no numbers (none: frame, task, mode, robot_mode)")};
    }
  }
  return true;
}

}  // namespace tasks

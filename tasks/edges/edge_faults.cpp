#include "tasks/edges/edge_faults.hpp"

#include <string>
#include <vector>

namespace tasks {

namespace {

constexpr std::array<bool, kEdgeCount> kNumbers = [] {
  std::array<bool, kEdgeCount> numbers{};
  for_each_edge([&]<class M, class Sent, std::size_t N>(const Edge<M, Sent, N>& e) {
    numbers[index_of(e.row.id)] = edge::kHasNumbers<M>;
  });
  return numbers;
}();

// Names of the edges that `has` is true of.
template <class Has>
std::string names(Has&& has) {
  std::string text;
  for (const EdgeRow& row : kEdgeTable) {
    if (has(row)) text += (text.empty() ? "" : ", ") + std::string(row.name);
  }
  return text;
}

}  // namespace

bool edge_takes(EdgeId edge, rt::FaultKind kind) noexcept {
  if (!rt::acts_on_edge(kind)) return false;
  if (kind == rt::FaultKind::kRingFull) return kEdgeTable[index_of(edge)].kind == EdgeKind::kRing;
  return kind != rt::FaultKind::kNan || kNumbers[index_of(edge)];
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
      return rt::Error{"fault plan '" + plan.name + "', fault " + std::to_string(i + 1) + ": " +
                       std::string(rt::name_of(e.kind)) + " on '" + e.target + "': " +
                       (e.kind == rt::FaultKind::kRingFull
                            ? "this edge is no ring (rings: " + names([](const EdgeRow& r) {
                                return r.kind == EdgeKind::kRing;
                              }) + ")"
                            : "this edge carries no numbers (none: " + names([](const EdgeRow& r) {
                                return !kNumbers[index_of(r.id)];
                              }) + ")")};
    }
  }
  return true;
}

}  // namespace tasks

// Helpers that the nodes share: hashing what is committed, publishing health, and message faults at
// the commit step of a named edge.
#pragma once

#include <optional>
#include <type_traits>

#include "rt/channel/latest.hpp"
#include "rt/channel/ring.hpp"
#include "rt/fault/plan.hpp"
#include "rt/hash.hpp"
#include "tasks/graph/messages.hpp"

namespace tasks {

// Newest health of a task, for supervision.
struct HealthMsg {
  rt::Time heartbeat{};
  rt::Health health;
};
using HealthCell = rt::Latest<HealthMsg>;

inline void publish_health(HealthCell& cell, rt::Time now, rt::Health health) noexcept {
  cell.begin_write() = {now, health};
  cell.publish();
}

// What a fault plan does to the messages of one edge. Empty plan: one branch.
class EdgeGate {
 public:
  EdgeGate() = default;
  EdgeGate(const rt::FaultPlan& plan, std::string_view edge) : plan_(plan, edge) {}
  // Fate of the next message; counts messages, so the decision is by sequence number.
  [[nodiscard]] rt::EdgeFaults next() noexcept { return plan_.edge(seq_++); }
  [[nodiscard]] bool empty() const noexcept { return plan_.empty(); }

 private:
  rt::TargetPlan plan_;
  std::uint64_t seq_ = 0;
};

inline void hash_vec(rt::Hash64& h, const Vec3& v) noexcept {
  h.value(v.x());
  h.value(v.y());
  h.value(v.z());
}
inline void hash_pose(rt::Hash64& h, const Pose& X) noexcept {
  for (int c = 0; c < 4; ++c) {
    for (int r = 0; r < 3; ++r) h.value(X.matrix()(r, c));
  }
}

}  // namespace tasks

// Message faults: what a fault plan does to the messages of one edge, where they are committed or
// arrive. Without a plan an edge costs one branch.
//
//   drop       not published: the reader keeps what it has
//   duplicate  published twice, under two sequence numbers
//   stale      every stamp in it is that much older
//   nan        its numbers are NaN (edges that carry any)
//   ring_full  rings only: refused as by a full ring; so is a `drop` there, since a ring in memory
//              loses nothing behind its writer's back. The next event that fits carries the gap
//              flag.
//
// Messages that cross the boxes are counted where they arrive, behind the wire's own checks; all
// others where they are published.
#pragma once

#include "rt/channel/latest.hpp"
#include "rt/fault/plan.hpp"
#include "rt/result.hpp"
#include "tasks/contract/table.hpp"
#include "tasks/edges/message_values.hpp"

namespace tasks {

// One clear error when a plan names a task or an edge that kTaskTable and kEdgeTable do not have,
// or a kind that its edge can not show.
[[nodiscard]] rt::Result<bool> check_faults(const rt::FaultPlan& plan);
// Does `kind` mean anything on this edge?
[[nodiscard]] bool edge_takes(EdgeId edge, rt::FaultKind kind) noexcept;

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

// Publishes `slot`, the filled slot of cell.begin_write(), through the gate. True: it was
// published. `at`, `unsure`: see rt::Latest.
template <class T>
bool publish(EdgeGate& gate, rt::Latest<T>& cell, T& slot, rt::Time at,
             rt::Nanos unsure = rt::Nanos{0}) noexcept {
  if (gate.empty()) {
    cell.publish(at, unsure);
    return true;
  }
  const rt::EdgeFaults fate = gate.next();
  if (fate.drop) return false;
  if (fate.stale.count() != 0) edge::age(slot, fate.stale);
  if (fate.nan) edge::spoil(slot);
  cell.publish(at, unsure);
  if (fate.duplicate) {
    // The published slot is read by others and written by nobody until the next publish.
    cell.begin_write() = slot;
    cell.publish(at, unsure);
  }
  return true;
}

// A ring with its gap flag: after an event that did not fit, the next one that does says so.
template <class Ring>
void push(EdgeGate& gate, Ring& ring, TouchEvent event, bool& gap) noexcept {
  rt::EdgeFaults fate;
  if (!gate.empty()) {
    fate = gate.next();
    if (fate.stale.count() != 0) edge::age(event, fate.stale);
    if (fate.nan) edge::spoil(event);
  }
  event.gap = gap;
  if (fate.ring_full || fate.drop || !ring.try_push(event)) {
    gap = true;
    return;
  }
  gap = false;
  if (fate.duplicate) {
    event.gap = false;
    gap = !ring.try_push(event);
  }
}

// For a ring whose writer tries again: false, as if the ring were full.
template <class Ring, class Asked>
requires(!std::same_as<Asked, TouchEvent>)
    [[nodiscard]] bool push(EdgeGate& gate, Ring& ring, Asked edit) noexcept {
  rt::EdgeFaults fate;
  if (!gate.empty()) {
    fate = gate.next();
    if (fate.stale.count() != 0) edge::age(edit, fate.stale);
    if (fate.nan) edge::spoil(edit);
  }
  if (fate.ring_full || fate.drop || !ring.try_push(edit)) return false;
  if (fate.duplicate) static_cast<void>(ring.try_push(edit));
  return true;
}

}  // namespace tasks

#include "tools/box/kept_phase.hpp"

namespace teletact {

void KeptPhase::keep(std::vector<rt::PlacedTask>& placed, tasks::TaskId id) {
  for (rt::PlacedTask& p : placed) {
    if (p.body == nullptr || p.id != tasks::index_of(id)) continue;
    postponed_ = std::make_shared<rt::Postponed>();
    p.spec.postponed = postponed_;
    phase_.emplace(p.spec.period());
  }
}

rt::Nanos KeptPhase::look() {
  const rt::Nanos later = phase_->look();
  postponed_->asked_ns.fetch_add(later.count());
  return later;
}

}  // namespace teletact

// A task of a running box whose release follows what it waits for (picture_phase.hpp): fusion the
// pictures of the other box, capture the frames of a camera with a clock of its own.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "rt/sched/task.hpp"
#include "tasks/contract/table.hpp"
#include "tools/box/picture_phase.hpp"

namespace teletact {

class KeptPhase {
 public:
  // Before the tasks start: from then on `id`, one of `placed`, is released as look() asks.
  void keep(std::vector<rt::PlacedTask>& placed, tasks::TaskId id);
  // Null: it keeps none.
  [[nodiscard]] PicturePhase* phase() noexcept { return phase_ ? &*phase_ : nullptr; }
  // Asks for what phase() has found. By how much later the task is released from now on.
  rt::Nanos look();

 private:
  std::optional<PicturePhase> phase_;
  std::shared_ptr<rt::Postponed> postponed_;
};

}  // namespace teletact

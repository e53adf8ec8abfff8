// A task of a running box whose releases are postponed as what it waits for asks.
#pragma once

#include <memory>
#include <vector>

#include "rt/sched/task.hpp"
#include "tasks/contract/table.hpp"

namespace teletact {

class ReleaseShift {
 public:
  // Before the tasks start: `id`, one of `placed`. Null: it is not among them.
  const rt::TaskSpec* of(std::vector<rt::PlacedTask>& placed, tasks::TaskId id) {
    for (rt::PlacedTask& p : placed) {
      if (p.body == nullptr || p.id != tasks::index_of(id)) continue;
      postponed_ = std::make_shared<rt::Postponed>();
      p.spec.postponed = postponed_;
      return &p.spec;
    }
    return nullptr;
  }
  // All later releases, by so much more.
  void postpone(rt::Nanos more) { postponed_->asked_ns.fetch_add(more.count()); }

 private:
  std::shared_ptr<rt::Postponed> postponed_;
};

}  // namespace teletact

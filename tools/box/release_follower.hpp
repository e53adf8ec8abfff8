// A task of a running box that is released when what it waits for has typically arrived.
#pragma once

#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rt/channel/ring.hpp"
#include "rt/sched/task.hpp"
#include "tasks/contract/table.hpp"
#include "tools/box/release_phase.hpp"

namespace teletact {

class ReleaseFollower {
 public:
  // Before the tasks start: from now on `id`, where it is one of `placed`, can be postponed.
  void keep(std::vector<rt::PlacedTask>& placed, tasks::TaskId id, rt::Time epoch) {
    for (rt::PlacedTask& p : placed) {
      if (p.body == nullptr || p.id != tasks::index_of(id)) continue;
      name_ = p.spec.name;
      postponed_ = std::make_shared<rt::Postponed>();
      p.spec.postponed = postponed_;
      phase_.emplace(p.spec.rate, epoch + p.spec.offset);
      return;
    }
  }
  // Now and then, with what has arrived since. A line where releases move, else nothing. It ends
  // with "soon after <what>".
  template <std::size_t N>
  [[nodiscard]] std::string follow(rt::Ring<rt::Time, N>& arrivals, const char* what) {
    if (!phase_) return {};
    for (rt::Time at; arrivals.try_pop(at);) phase_->arrived(at);
    const rt::Nanos later = phase_->look();
    if (later == rt::Nanos{0}) return {};
    postponed_->asked_ns.fetch_add(later.count());
    char line[96];
    std::snprintf(line, sizeof line, "%s is released %.1f ms later: soon after %s", name_.c_str(),
                  1e-6 * static_cast<double>(later.count()), what);
    return line;
  }

 private:
  std::string name_;
  std::optional<ReleasePhase> phase_;
  std::shared_ptr<rt::Postponed> postponed_;
};

}  // namespace teletact

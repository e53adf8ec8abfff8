// The Planned fault policy: asks the plan for each job, by the task's row in the task table.
#pragma once

#include <string>
#include <vector>

#include "rt/fault/injector.hpp"
#include "rt/fault/plan.hpp"

namespace rt {

class Planned {
 public:
  static constexpr bool kEnabled = true;
  Planned() = default;
  // names[i] is the name of the task with id i.
  Planned(const FaultPlan& plan, const std::vector<std::string>& names) {
    for (const auto& name : names) by_task_.emplace_back(plan, name);
    for (const auto& e : plan.entries) {
      spans_ = spans_ || e.kind == FaultKind::kTheft || e.kind == FaultKind::kPriorityHog;
    }
  }
  [[nodiscard]] JobFaults job(std::uint16_t task, std::uint64_t k) const noexcept {
    if (task >= by_task_.size() || by_task_[task].empty()) return {};
    const TaskFaults f = by_task_[task].task(k);
    JobFaults out;
    out.late = f.late;
    out.extra_cpu = f.extra_cpu;
    out.block = f.block;
    out.hog = f.hog;
    out.theft = f.theft;
    out.page_fault = f.page_fault;
    out.touch_page = f.touch_page;
    out.dead = f.dead;
    return out;
  }
  // True when the plan takes cores away (theft, hog): the executors then watch nominal releases.
  [[nodiscard]] bool has_spans() const noexcept { return spans_; }

 private:
  std::vector<TargetPlan> by_task_;
  bool spans_ = false;
};

// Calls run(policy) with the plan's policy, or with Plain when there is no plan or none can be run
// in this build (the caller has refused it before).
template <class Run>
void with_faults(const FaultPlan* plan, const std::vector<std::string>& names, const Run& run) {
  if constexpr (kFaultsBuilt) {
    if (plan != nullptr) {
      run(Planned(*plan, names));
      return;
    }
  }
  run(Plain{});
}

}  // namespace rt

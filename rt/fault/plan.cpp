#include "rt/fault/plan.hpp"

#include <algorithm>

namespace rt {
namespace {

constexpr std::array<std::string_view, kFaultKinds> kNames{
    "late_release", "extra_cpu", "block", "page_fault", "priority_hog", "theft",
    "dead_thread",  "ring_full", "drop",  "duplicate",  "stale",        "nan"};

bool needs_magnitude(FaultKind kind) noexcept {
  switch (kind) {
    case FaultKind::kLateRelease:
    case FaultKind::kExtraCpu:
    case FaultKind::kBlock:
    case FaultKind::kPriorityHog:
    case FaultKind::kTheft:
    case FaultKind::kStale:
      return true;
    default:
      return false;
  }
}

std::string list_of(std::span<const std::string> names) {
  std::string text;
  for (const std::string& n : names) text += (text.empty() ? "" : ", ") + n;
  return text;
}

std::string problem_of(const FaultEntry& e, std::span<const std::string> tasks,
                       std::span<const std::string> edges) {
  const std::string kind{name_of(e.kind)};
  if (e.target.empty()) return kind + ": target is empty (a task or an edge is needed)";
  const std::string who = kind + " on '" + e.target + "': ";
  if (e.every == 0) return who + "every = 0 (allowed: 1 or more)";
  if (!(e.probability >= 0.0 && e.probability <= 1.0)) {
    return who + "probability = " + std::to_string(e.probability) + " (allowed: 0 to 1)";
  }
  if (e.magnitude.count() < 0) return who + "magnitude is negative";
  if (needs_magnitude(e.kind) && e.magnitude.count() == 0) return who + "needs a magnitude above 0";
  if (e.kind == FaultKind::kDeadThread &&
      (e.every != 1 || e.count != 0 || e.probability < 1.0 || e.magnitude.count() != 0)) {
    return who + "takes only `first`: the thread is gone for good";
  }
  const std::span<const std::string> known = acts_on_edge(e.kind) ? edges : tasks;
  const bool check_target = !(tasks.empty() && edges.empty());
  if (check_target && std::find(known.begin(), known.end(), e.target) == known.end()) {
    return who + "there is no such " + (acts_on_edge(e.kind) ? "edge" : "task") +
           " (there are: " + list_of(known) + ")";
  }
  return {};
}

}  // namespace

std::string_view name_of(FaultKind kind) noexcept { return kNames[static_cast<std::size_t>(kind)]; }

Result<FaultKind> fault_kind(std::string_view name) {
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] == name) return static_cast<FaultKind>(i);
  }
  const std::vector<std::string> all = fault_kind_names();
  return Error{"no fault kind '" + std::string(name) + "' (allowed: " + list_of(all) + ")"};
}

std::vector<std::string> fault_kind_names() { return {kNames.begin(), kNames.end()}; }

bool fires(const FaultEntry& entry, std::uint64_t plan_seed, std::uint64_t target,
           std::uint64_t n) noexcept {
  if (n < entry.first || entry.every == 0) return false;
  const std::uint64_t since = n - entry.first;
  if (since % entry.every != 0) return false;
  if (entry.count > 0 && since / entry.every >= entry.count) return false;
  if (entry.probability >= 1.0) return true;
  const std::uint64_t key =
      mix64(mix64(plan_seed, entry.seed), mix64(target, static_cast<std::uint64_t>(entry.kind)));
  return static_cast<double>(mix64(key, n) >> 11U) * 0x1.0p-53 < entry.probability;
}

TaskFaults decide_task(const FaultPlan& plan, std::uint64_t task_hash, std::uint64_t k) noexcept {
  TaskFaults f;
  for (const FaultEntry& e : plan.entries) {
    if (acts_on_edge(e.kind) || target_hash(e.target) != task_hash) continue;
    if (e.kind == FaultKind::kDeadThread) {
      f.dead = f.dead || k >= e.first;
      continue;
    }
    if (!fires(e, plan.seed, task_hash, k)) continue;
    switch (e.kind) {
      case FaultKind::kLateRelease:
        f.late += e.magnitude;
        break;
      case FaultKind::kExtraCpu:
        f.extra_cpu += e.magnitude;
        break;
      case FaultKind::kBlock:
        f.block += e.magnitude;
        break;
      case FaultKind::kPriorityHog:
        f.hog += e.magnitude;
        break;
      case FaultKind::kTheft:
        f.theft += e.magnitude;
        break;
      case FaultKind::kPageFault:
        f.touch_page = true;
        f.page_fault += e.magnitude;
        break;
      default:
        break;
    }
  }
  return f;
}

EdgeFaults decide_edge(const FaultPlan& plan, std::uint64_t edge_hash, std::uint64_t seq) noexcept {
  EdgeFaults f;
  for (const FaultEntry& e : plan.entries) {
    if (!acts_on_edge(e.kind) || target_hash(e.target) != edge_hash) continue;
    if (!fires(e, plan.seed, edge_hash, seq)) continue;
    switch (e.kind) {
      case FaultKind::kRingFull:
        f.ring_full = true;
        break;
      case FaultKind::kDrop:
        f.drop = true;
        break;
      case FaultKind::kDuplicate:
        f.duplicate = true;
        break;
      case FaultKind::kNan:
        f.nan = true;
        break;
      case FaultKind::kStale:
        f.stale += e.magnitude;
        break;
      default:
        break;
    }
  }
  return f;
}

TargetPlan::TargetPlan(const FaultPlan& plan, std::string_view target)
    : hash_(target_hash(target)) {
  plan_.name = plan.name;
  plan_.seed = plan.seed;
  for (const FaultEntry& e : plan.entries) {
    if (e.target == target) plan_.entries.push_back(e);
  }
}

Result<bool> check(const FaultPlan& plan, std::span<const std::string> tasks,
                   std::span<const std::string> edges) {
  for (std::size_t i = 0; i < plan.entries.size(); ++i) {
    const std::string problem = problem_of(plan.entries[i], tasks, edges);
    if (!problem.empty()) {
      return Error{"fault plan '" + plan.name + "', fault " + std::to_string(i + 1) + ": " +
                   problem};
    }
  }
  return true;
}

}  // namespace rt

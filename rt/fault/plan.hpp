// Fault plans: which fault, on which task or edge, at which release index or sequence number. A
// decision is a pure function of (seed, target, index); wall time has no part in it, so a plan
// gives the same faults in virtual time, on the machine, and in a replay.
//
// An entry is a candidate at index n when  n >= first,  (n - first) % every == 0  and, if count >
// 0, (n - first) / every < count.  A candidate fires if probability >= 1, or if the upper 53 bits
// of mix64(mix64(mix64(plan seed, entry seed), mix64(target hash, kind)), n), read as a number in
// [0, 1), are below probability. Entries that fire at the same index add their magnitudes.
//
// Kinds. r(k) is the nominal release epoch + offset + rate.release(k) of the named task; "the core"
// is the core that task is placed on.
//   late_release   release k arrives at r(k) + magnitude; its deadline stays r(k) + D
//   extra_cpu      job k costs magnitude more CPU
//   block          job k is suspended for magnitude at its first dispatch, using no CPU
//   page_fault     job k touches a released page; in virtual time: magnitude more CPU
//   priority_hog   from r(k) a hog above all tasks of the core and below its sentinel burns
//                  magnitude of CPU; several hogs queue
//   theft          from r(k) nothing runs on the core for magnitude of wall time; overlapping
//                  spans unite
//   dead_thread    the task's thread ends instead of starting release `first`; every, count,
//                  probability and magnitude do not apply
//   ring_full, drop, duplicate, stale, nan: act on message `n` of an edge when it is committed:
//                  refused as by a full ring / lost / published twice / stamped magnitude older /
//                  its numbers replaced by NaN
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rt/random.hpp"
#include "rt/result.hpp"
#include "rt/time.hpp"

namespace rt {

enum class FaultKind : std::uint8_t {
  kLateRelease,
  kExtraCpu,
  kBlock,
  kPageFault,
  kPriorityHog,
  kTheft,
  kDeadThread,  // of a task
  kRingFull,
  kDrop,
  kDuplicate,
  kStale,
  kNan,  // of an edge
};
inline constexpr int kFaultKinds = 12;

[[nodiscard]] std::string_view name_of(FaultKind kind) noexcept;  // "late_release"
[[nodiscard]] Result<FaultKind> fault_kind(std::string_view name);
[[nodiscard]] std::vector<std::string> fault_kind_names();
[[nodiscard]] constexpr bool acts_on_edge(FaultKind kind) noexcept {
  return kind >= FaultKind::kRingFull;
}

struct FaultEntry {
  FaultKind kind = FaultKind::kLateRelease;
  std::string target;       // name of a task or of an edge
  std::uint64_t first = 0;  // release index or sequence number
  std::uint64_t every = 1;
  std::uint64_t count = 0;  // 0: no end
  double probability = 1.0;
  std::uint64_t seed = 0;
  Nanos magnitude{0};
};

struct FaultPlan {
  std::string name;
  std::uint64_t seed = 1;
  std::vector<FaultEntry> entries;
};

// FNV-1a over the name, mixed: stable across builds and machines.
[[nodiscard]] constexpr std::uint64_t target_hash(std::string_view name) noexcept {
  std::uint64_t h = 0xcbf29ce484222325ULL;
  for (const char c : name) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  return mix64(h);
}

// What happens to job k of a task.
struct TaskFaults {
  Nanos late{0};
  Nanos extra_cpu{0};  // page faults not included
  Nanos block{0};
  Nanos page_fault{0};
  Nanos hog{0};
  Nanos theft{0};
  bool touch_page = false;  // a page_fault entry fired (its magnitude may be 0 on a real machine)
  bool dead = false;        // true for every k >= first
  [[nodiscard]] bool any() const noexcept {
    return dead || touch_page || (late + extra_cpu + block + page_fault + hog + theft).count() > 0;
  }
};

// What happens to message `seq` of an edge.
struct EdgeFaults {
  bool ring_full = false, drop = false, duplicate = false, nan = false;
  Nanos stale{0};
  [[nodiscard]] bool any() const noexcept {
    return ring_full || drop || duplicate || nan || stale.count() > 0;
  }
};

// Does this entry fire at index n? The definition above, word for word.
[[nodiscard]] bool fires(const FaultEntry& entry, std::uint64_t plan_seed, std::uint64_t target,
                         std::uint64_t n) noexcept;

// The plan's answer for a task or an edge. Pure; no allocation, so usable in a commit. Cost: one
// pass over the entries.
[[nodiscard]] TaskFaults decide_task(const FaultPlan& plan, std::uint64_t task_hash,
                                     std::uint64_t k) noexcept;
[[nodiscard]] EdgeFaults decide_edge(const FaultPlan& plan, std::uint64_t edge_hash,
                                     std::uint64_t seq) noexcept;

// The entries of one target, so that an executor's task does not walk the others' entries. Keeps a
// copy; construct before the first release.
class TargetPlan {
 public:
  TargetPlan() = default;
  TargetPlan(const FaultPlan& plan, std::string_view target);
  [[nodiscard]] bool empty() const noexcept { return plan_.entries.empty(); }
  [[nodiscard]] TaskFaults task(std::uint64_t k) const noexcept {
    return empty() ? TaskFaults{} : decide_task(plan_, hash_, k);
  }
  [[nodiscard]] EdgeFaults edge(std::uint64_t seq) const noexcept {
    return empty() ? EdgeFaults{} : decide_edge(plan_, hash_, seq);
  }

 private:
  FaultPlan plan_;
  std::uint64_t hash_ = 0;
};

// One message per bad plan: a kind without its magnitude, every = 0, a probability outside [0, 1],
// a target that is neither among the tasks (timing faults) nor among the edges (message faults).
// Empty spans: targets are not checked.
[[nodiscard]] Result<bool> check(const FaultPlan& plan, std::span<const std::string> tasks,
                                 std::span<const std::string> edges);

}  // namespace rt

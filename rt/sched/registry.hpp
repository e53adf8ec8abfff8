// Who runs with real-time priority on this host: a table in shared memory that each process enters
// before its first release, so that two programs, each admitted alone, do not share a core beyond what
// fits. Set-up time only: every call locks, allocates and may read /proc.
//
// The lock is flock(2) on the shared-memory file: the kernel releases it when its holder dies, so a
// killed process never leaves it held. A slot is valid from the moment its pid is written, which is
// last. Slots of processes that are gone (no such pid, another start time, or a zombie) are cleared
// whenever the lock is taken.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "rt/result.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/analysis.hpp"
#include "rt/time.hpp"

namespace rt {

struct RegistryEntry {
  int pid = 0;              // filled in by the registry
  std::string task;         // at most 47 characters are kept
  int cpu = 0;              // CPU number, not an index
  int priority = 0;         // SCHED_FIFO; 0: best-effort load, C / T is its share
  Nanos C{0}, T{0}, D{0}, J{0}, B{0};
};

struct RegistryOptions {
  double core_limit = 0.90;
  AnalysisOptions analysis;
};

// The rows a process has to register for its admitted tasks; `mine` says which task rows are run by
// the calling process (by name; empty: all). Platform rows and pinned best effort come with them.
[[nodiscard]] std::vector<RegistryEntry> registry_entries(const AdmissionRequest& request,
                                                          const Admission& admission,
                                                          std::span<const std::string> mine = {});

class Registry {
 public:
  // Opens or makes /dev/shm/<name>; `name` has no slash. Refuses a table of another layout.
  [[nodiscard]] static Result<Registry> open(const std::string& name);
  ~Registry();  // removes this object's rows
  Registry(Registry&&) noexcept;
  Registry& operator=(Registry&&) noexcept;
  Registry(const Registry&) = delete;
  Registry& operator=(const Registry&) = delete;

  // Enters all rows under this process's pid, or none. Refused if on some CPU the union with the rows
  // already there exceeds the limit or makes any task, ours or another's, miss its deadline; the
  // message names that task, the figures and what is already there. Rows of equal priority are taken
  // to delay each other.
  [[nodiscard]] Result<bool> try_register(std::span<const RegistryEntry> rows,
                                          const RegistryOptions& options = {});
  // Removes the rows this object entered. Only the process that entered them can.
  void unregister() noexcept;
  // Rows of live processes.
  [[nodiscard]] std::vector<RegistryEntry> entries();
  // Removes the file; for tests and for `doctor`.
  static void remove(const std::string& name) noexcept;

 private:
  struct Table;
  Registry(int fd, Table* table) noexcept : fd_(fd), table_(table) {}
  int fd_ = -1;
  Table* table_ = nullptr;
  int owner_pid_ = 0;  // a forked child must not remove its parent's rows
};

}  // namespace rt

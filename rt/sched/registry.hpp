// Who runs with real-time priority on this host: a table in shared memory that each process enters
// before its first release, so that two programs, each admitted alone, do not share a core beyond
// what fits. Set-up time only: every call locks, allocates and may read /proc.
//
// The lock is flock(2) on the shared-memory file: the kernel releases it when its holder dies, so a
// killed process never leaves it held. A slot is valid from the moment its pid is written, which is
// last. Slots of processes that are gone (no such pid, another start time, or a zombie) are cleared
// whenever the lock is taken.
//
// Every user of the host may read and write the table (mode 0666), since a core is shared by the
// processes of all users. So the table is an agreement among cooperating programs, not a
// protection. What a hostile or crashed local process can do with it: keep others from starting (by
// rows of a living pid, by filling it, by removing or replacing the file, by holding the lock: an
// error after 5 s), or make room that is not there (by clearing rows). What it can not do: harm a
// program that runs, or crash or hang one that starts; the file is copied in and nothing in it is
// believed, rows that make no sense are passed over. Do not run real-time work on a host whose
// users are not trusted to that extent.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "rt/result.hpp"
#include "rt/sched/admission.hpp"
#include "rt/sched/analysis.hpp"
#include "rt/time.hpp"

namespace rt {

struct RegistryEntry {
  int pid = 0;       // filled in by the registry
  std::string task;  // at most 47 characters are kept
  int cpu = 0;       // CPU number, not an index
  int priority = 0;  // SCHED_FIFO; 0: best-effort load, C / T is its share
  Nanos C{0}, T{0}, D{0}, J{0}, B{0};
};

struct RegistryOptions {
  double core_limit = 0.90;
  AnalysisOptions analysis;
};

// The rows to register for an admission: placed tasks, platform tasks, best effort with a core.
// `mine` says which of them the calling process runs (name and box of the spec; best effort has the
// operator's); empty: all. A task that forks and its workers are entered with D = R: another
// process may not delay them, since their rows on one core were computed from those on the other.
// Where two processes share one admission each registers its own part: its tasks, its sentinels and
// its watchdog.
using IsMine = std::function<bool(const std::string& name, Box box)>;
[[nodiscard]] std::vector<RegistryEntry> registry_entries(const AdmissionRequest& request,
                                                          const Admission& admission,
                                                          const IsMine& mine = {});

class Registry {
 public:
  // Opens or makes /dev/shm/<name>; `name` has no slash. Refuses a table of another layout.
  [[nodiscard]] static Result<Registry> open(const std::string& name);
  ~Registry();  // removes this object's rows
  Registry(Registry&&) noexcept;
  Registry& operator=(Registry&&) noexcept;
  Registry(const Registry&) = delete;
  Registry& operator=(const Registry&) = delete;

  // Enters all rows under this process's pid in place of those that this object entered before (a
  // mode change), or changes nothing. Refused if on some CPU of the rows the union with the others
  // already there exceeds the limit or makes any task, ours or another's, miss its deadline; the
  // message names that task, the figures and what is already there. Rows of equal priority are
  // taken to delay each other.
  [[nodiscard]] Result<bool> try_register(std::span<const RegistryEntry> rows,
                                          const RegistryOptions& options = {});
  // Removes the rows this object entered. Only the process that entered them can.
  void unregister() noexcept;
  // Rows of live processes.
  [[nodiscard]] std::vector<RegistryEntry> entries();
  // Removes the file; for tests and for `doctor`.
  static void remove(const std::string& name) noexcept;

 private:
  struct Slot;
  struct Table;
  class Session;
  Registry(int fd, std::string name) noexcept;
  void close() noexcept;

  int fd_ = -1;
  std::string name_;
  std::uint64_t owner_ = 0;  // this object's mark on its rows
  int owner_pid_ = 0;        // a forked child must not remove its parent's rows
};

}  // namespace rt

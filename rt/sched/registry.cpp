#include "rt/sched/registry.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <set>
#include <utility>

#include "rt/sched/admission_levels.hpp"

namespace rt {
namespace {

constexpr std::uint64_t kMagic = 0x7465'6c65'7461'6374ULL;  // "teletact"
constexpr std::uint32_t kVersion = 1;
constexpr std::size_t kSlots = 512;
constexpr mode_t kMode = 0666;  // every user of the host: registry.hpp
// The longest that a row may speak of: sums and products of a few of them do not overflow.
constexpr std::int64_t kMostNanos = 1'000'000'000'000;
// Who holds the lock works for milliseconds.
constexpr int kLockLimit_ms = 5000;

std::string system_error(const std::string& what) { return what + ": " + std::strerror(errno); }

using detail::milliseconds;

std::string fixed3(double v) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.3f", v);
  return text.data();
}

struct ProcessState {
  bool alive = false;
  std::uint64_t start = 0;  // clock ticks after boot; tells a reused pid
};

// /proc/<pid>/stat: "pid (name) state ppid ... starttime(22) ..."; the name may hold anything.
ProcessState process_state(int pid) {
  ProcessState p;
  const std::string path = "/proc/" + std::to_string(pid) + "/stat";
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) {
    // Without /proc only "no such process" is certain.
    p.alive = ::kill(pid, 0) == 0 || errno != ESRCH;
    return p;
  }
  std::array<char, 2048> text{};
  const ssize_t n = ::read(fd, text.data(), text.size() - 1);
  ::close(fd);
  if (n <= 0) return p;
  const char* after = std::strrchr(text.data(), ')');
  if (after == nullptr || after[1] == '\0') return p;
  const char state = after[2];
  p.alive = state != 'Z' && state != 'X' && state != 'x';
  const char* field = after + 2;  // field 3
  for (int i = 3; i < 22 && field != nullptr; ++i) {
    field = std::strchr(field, ' ');
    if (field != nullptr) ++field;
  }
  if (field != nullptr) p.start = std::strtoull(field, nullptr, 10);
  return p;
}

double share_of(const RegistryEntry& e) {
  return static_cast<double>(e.C.count()) / static_cast<double>(e.T.count());
}

std::string row_text(const RegistryEntry& e) {
  if (e.priority == 0) {
    return e.task + " (pid " + std::to_string(e.pid) + ", best effort " + fixed3(share_of(e)) + ")";
  }
  return e.task + " (pid " + std::to_string(e.pid) + ", priority " + std::to_string(e.priority) +
         ", C = " + milliseconds(e.C) + ", T = " + milliseconds(e.T) + ")";
}

// Empty if all rows of this CPU fit together; `there` are the rows of others, for the message.
std::string cpu_problem(int cpu, const std::vector<RegistryEntry>& rows,
                        const std::vector<RegistryEntry>& there, const RegistryOptions& options) {
  std::vector<AnalysisTask> tasks;
  std::vector<const RegistryEntry*> who;
  double best_effort = 0;
  for (const RegistryEntry& e : rows) {
    if (e.cpu != cpu) continue;
    if (e.priority == 0) {
      best_effort += share_of(e);
      continue;
    }
    tasks.push_back({e.C, e.T, e.D, e.J, e.B, -e.priority});
    who.push_back(&e);
  }
  std::string present;
  for (const RegistryEntry& e : there) {
    if (e.cpu == cpu) present += (present.empty() ? "" : ", ") + row_text(e);
  }
  const std::string tail = "; already there: " + (present.empty() ? "nothing" : present);
  const double u = utilisation(tasks, options.analysis);
  if (u + best_effort > options.core_limit) {
    return "cpu " + std::to_string(cpu) + " would be used to " + fixed3(u + best_effort) +
           ", above " + fixed3(options.core_limit) + " (real-time " + fixed3(u) + ", best effort " +
           fixed3(best_effort) + ")" + tail;
  }
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const ResponseTime r = response_time(tasks, i, options.analysis);
    if (r.meets) continue;
    return "on cpu " + std::to_string(cpu) + " task '" + who[i]->task + "' (pid " +
           std::to_string(who[i]->pid) + ") would have R = " + milliseconds(r.R) +
           " > D = " + milliseconds(tasks[i].D) + tail;
  }
  return {};
}

std::string malformed(const RegistryEntry& e) {
  const std::string who = "registry row '" + e.task + "': ";
  if (e.task.empty()) return "registry row without a task name";
  if (e.cpu < 0) return who + "cpu " + std::to_string(e.cpu) + " (allowed: 0 or more)";
  if (e.priority < 0 || e.priority > 99) {
    return who + "priority " + std::to_string(e.priority) + " (allowed: 0 to 99)";
  }
  if (e.T.count() <= 0 || e.C.count() < 0) return who + "C and T must be positive";
  if (e.priority > 0 && (e.C.count() == 0 || e.D.count() <= 0)) {
    return who + "C and D must be positive";
  }
  if (e.J.count() < 0 || e.B.count() < 0) return who + "J or B is negative";
  for (const Nanos t : {e.C, e.T, e.D, e.J, e.B})
    if (t.count() > kMostNanos) return who + "times are at most 1000 s";
  return {};
}

// Without O_CREAT first: where fs.protected_regular is set, opening with it a file of another user
// in a sticky folder is refused even if its mode allows it. The umask takes nothing from what a
// maker gives.
int open_or_make(const std::string& shm_name) noexcept {
  for (;;) {
    int fd = ::shm_open(shm_name.c_str(), O_RDWR | O_CLOEXEC, 0);
    if (fd >= 0 || errno != ENOENT) return fd;
    fd = ::shm_open(shm_name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, kMode);
    if (fd >= 0) {
      if (::fchmod(fd, kMode) == 0) return fd;
      const int why = errno;
      ::shm_unlink(shm_name.c_str());
      ::close(fd);
      errno = why;
      return -1;
    }
    if (errno != EEXIST) return -1;  // else: another process made it meanwhile
  }
}

std::uint64_t next_owner() noexcept {
  static std::atomic<std::uint64_t> counter{0};
  return ++counter;
}

}  // namespace

// A slot is free while pid is 0. pid is written last and cleared first.
struct Registry::Slot {
  std::int32_t pid, cpu, priority, unused;
  std::uint64_t start, owner;
  std::int64_t C, T, D, J, B;
  std::array<char, 48> task;
};
struct Registry::Table {
  std::uint64_t magic;
  std::uint32_t version, slot_size;
  std::array<Slot, kSlots> slots;
};

namespace {

// Of the file nothing is believed: whoever may write it may have written anything.
RegistryEntry entry_of(const std::int64_t (&times)[5], const std::array<char, 48>& task) {
  RegistryEntry e;
  e.task.assign(task.data(), ::strnlen(task.data(), task.size()));
  for (char& c : e.task) c = c >= 0x20 && c < 0x7f ? c : '?';
  e.C = Nanos{times[0]};
  e.T = Nanos{times[1]};
  e.D = Nanos{times[2]};
  e.J = Nanos{times[3]};
  e.B = Nanos{times[4]};
  return e;
}

}  // namespace

// The file, copied in while the lock is held. Reads and writes instead of a mapping: a file that
// somebody cuts short is an error then, and no SIGBUS in a program that drives a robot.
class Registry::Session {
 public:
  Session(int fd, const std::string& name) : fd_(fd), path_("/dev/shm/" + name) { lock(); }
  ~Session() {
    ::flock(lock_fd(), LOCK_UN);
    if (own_ >= 0) ::close(own_);
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Empty: the table is there. A new file is made one.
  [[nodiscard]] const std::string& problem() const noexcept { return problem_; }

  void clear_dead() {
    for (std::size_t i = 0; i < kSlots; ++i) {
      const Slot& s = table_.slots[i];
      if (s.pid == 0) continue;
      const ProcessState p = process_state(s.pid);
      if (!p.alive || (p.start != 0 && s.start != 0 && p.start != s.start)) set_pid(i, 0);
    }
  }
  // Without those that make no sense: no program of ours has written them.
  [[nodiscard]] std::vector<RegistryEntry> rows(int skip_pid, std::uint64_t skip_owner) const {
    std::vector<RegistryEntry> out;
    for (const Slot& s : table_.slots) {
      if (s.pid == 0 || (s.pid == skip_pid && s.owner == skip_owner)) continue;
      RegistryEntry e = entry_of({s.C, s.T, s.D, s.J, s.B}, s.task);
      e.pid = s.pid;
      e.cpu = s.cpu;
      e.priority = s.priority;
      if (malformed(e).empty()) out.push_back(e);
    }
    return out;
  }
  void remove(int pid, std::uint64_t owner) {
    for (std::size_t i = 0; i < kSlots; ++i)
      if (table_.slots[i].pid == pid && table_.slots[i].owner == owner) set_pid(i, 0);
  }
  [[nodiscard]] std::size_t free_slots(int pid, std::uint64_t owner) const {
    return static_cast<std::size_t>(std::count_if(
        table_.slots.begin(), table_.slots.end(),
        [&](const Slot& s) { return s.pid == 0 || (s.pid == pid && s.owner == owner); }));
  }
  void add(const RegistryEntry& e, int pid, std::uint64_t start, std::uint64_t owner) {
    const auto free = std::find_if(table_.slots.begin(), table_.slots.end(),
                                   [](const Slot& s) { return s.pid == 0; });
    if (free == table_.slots.end()) return;
    *free = {0,           e.cpu,       e.priority,  0,           start,       owner,
             e.C.count(), e.T.count(), e.D.count(), e.J.count(), e.B.count(), {}};
    std::memcpy(free->task.data(), e.task.data(), std::min(e.task.size(), free->task.size() - 1));
    const auto i = static_cast<std::size_t>(free - table_.slots.begin());
    write(&table_.slots[i], sizeof(Slot), place_of(i));
    set_pid(i, pid);
  }

 private:
  [[nodiscard]] int lock_fd() const noexcept { return own_ >= 0 ? own_ : fd_; }
  [[nodiscard]] static std::size_t place_of(std::size_t i) noexcept {
    return offsetof(Table, slots) + i * sizeof(Slot);
  }
  void set_pid(std::size_t i, std::int32_t pid) {
    table_.slots[i].pid = pid;
    write(&table_.slots[i].pid, sizeof pid, place_of(i) + offsetof(Slot, pid));
  }
  void write(const void* from, std::size_t n, std::size_t at) {
    if (::pwrite(fd_, from, n, static_cast<off_t>(at)) != static_cast<ssize_t>(n))
      problem_ = system_error("cannot write " + path_);
  }

  // flock on a file description of its own: two threads, or a parent and its forked child, that
  // share one Registry's descriptor would otherwise both hold "the" lock.
  void lock() {
    const std::string path = "/proc/self/fd/" + std::to_string(fd_);
    own_ = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
    for (int i = 0; ::flock(lock_fd(), LOCK_EX | LOCK_NB) != 0; ++i) {
      if (errno != EINTR && errno != EWOULDBLOCK) {
        problem_ = system_error("cannot lock " + path_);
        return;
      }
      if (i >= kLockLimit_ms) {
        problem_ = path_ + " is locked by another process for " +
                   std::to_string(kLockLimit_ms / 1000) + " s: end it (fuser " + path_ + ")";
        return;
      }
      ::usleep(1000);
    }
    load();
  }
  void load() {
    struct stat info {};
    if (::fstat(fd_, &info) != 0) {
      problem_ = system_error("cannot stat " + path_);
      return;
    }
    if (info.st_size == 0 && ::ftruncate(fd_, static_cast<off_t>(sizeof(Table))) != 0) {
      problem_ = system_error("cannot size " + path_);
      return;
    }
    if (info.st_size != 0 && info.st_size != static_cast<off_t>(sizeof(Table))) {
      problem_ = path_ + " has " + std::to_string(info.st_size) + " bytes, this version needs " +
                 std::to_string(sizeof(Table)) +
                 ": another version runs; stop it, or remove the file";
      return;
    }
    if (::pread(fd_, &table_, sizeof table_, 0) != static_cast<ssize_t>(sizeof table_)) {
      problem_ = path_ + " was cut short while it was read";
      return;
    }
    // New, or its maker died before it wrote the magic: all slots are still zero, hence free.
    if (table_.magic == 0) {
      table_.version = kVersion;
      table_.slot_size = sizeof(Slot);
      write(&table_.version, sizeof table_.version, offsetof(Table, version));
      write(&table_.slot_size, sizeof table_.slot_size, offsetof(Table, slot_size));
      table_.magic = kMagic;
      write(&table_.magic, sizeof table_.magic, 0);
    }
    if (table_.magic != kMagic || table_.version != kVersion || table_.slot_size != sizeof(Slot)) {
      problem_ = path_ + " is not a task registry of version " + std::to_string(kVersion) +
                 "; stop what uses it, or remove the file";
    }
  }

  int fd_, own_ = -1;
  std::string path_, problem_;
  Table table_{};
};

Registry::Registry(int fd, std::string name) noexcept
    : fd_(fd), name_(std::move(name)), owner_(next_owner()), owner_pid_(::getpid()) {}

Registry::Registry(Registry&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      name_(std::move(other.name_)),
      owner_(other.owner_),
      owner_pid_(other.owner_pid_) {}

Registry& Registry::operator=(Registry&& other) noexcept {
  if (this == &other) return *this;
  close();
  fd_ = std::exchange(other.fd_, -1);
  name_ = std::move(other.name_);
  owner_ = other.owner_;
  owner_pid_ = other.owner_pid_;
  return *this;
}

Registry::~Registry() { close(); }

void Registry::close() noexcept {
  if (fd_ < 0) return;
  unregister();
  ::close(fd_);
  fd_ = -1;
}

Result<Registry> Registry::open(const std::string& name) {
  if (name.empty() || name.find('/') != std::string::npos || name.size() > 200) {
    return Error{"registry name '" + name + "' (allowed: 1 to 200 characters, no slash)"};
  }
  const std::string path = "/dev/shm/" + name;
  const int fd = open_or_make("/" + name);
  if (fd < 0) return Error{system_error("cannot open the task registry " + path)};
  std::string problem;
  {
    const Session session(fd, name);
    problem = session.problem();
  }
  if (problem.empty()) return Registry(fd, name);
  ::close(fd);
  return Error{problem};
}

Result<bool> Registry::try_register(std::span<const RegistryEntry> rows,
                                    const RegistryOptions& options) {
  for (const RegistryEntry& e : rows) {
    if (const std::string text = malformed(e); !text.empty()) return Error{text};
  }
  const int pid = ::getpid();
  if (pid != owner_pid_) {  // a forked child registers as itself; the parent's rows are not its own
    owner_pid_ = pid;
    owner_ = next_owner();
  }
  Session session(fd_, name_);
  if (!session.problem().empty()) return Error{session.problem()};
  session.clear_dead();
  const std::vector<RegistryEntry> others = session.rows(pid, owner_);
  std::vector<RegistryEntry> all = others;
  std::set<int> cpus;
  for (const RegistryEntry& e : rows) {
    all.push_back(e);
    all.back().pid = pid;
    cpus.insert(e.cpu);
  }
  if (session.free_slots(pid, owner_) < rows.size()) {
    return Error{"the task registry " + name_ + " is full (" + std::to_string(kSlots) + " rows)"};
  }
  for (const int cpu : cpus) {
    const std::string problem = cpu_problem(cpu, all, others, options);
    if (!problem.empty()) return Error{"not registered: " + problem};
  }
  const std::uint64_t start = process_state(pid).start;
  session.remove(pid, owner_);
  for (const RegistryEntry& e : rows) session.add(e, pid, start, owner_);
  if (!session.problem().empty()) return Error{session.problem()};
  return true;
}

void Registry::unregister() noexcept {
  if (fd_ < 0 || ::getpid() != owner_pid_) return;
  // Where that fails the rows are cleared by the next one, when this process has ended.
  Session session(fd_, name_);
  if (session.problem().empty()) session.remove(owner_pid_, owner_);
}

std::vector<RegistryEntry> Registry::entries() {
  Session session(fd_, name_);
  if (!session.problem().empty()) return {};
  session.clear_dead();
  return session.rows(0, 0);
}

void Registry::remove(const std::string& name) noexcept { ::shm_unlink(("/" + name).c_str()); }

std::vector<RegistryEntry> registry_entries(const AdmissionRequest& request,
                                            const Admission& admission, const IsMine& mine) {
  std::vector<RegistryEntry> rows;
  const auto wanted = [&](const std::string& name, Box box) { return !mine || mine(name, box); };
  for (const AdmittedTask& t : admission.tasks) {
    if (t.core < 0 || !wanted(t.name, t.box)) continue;
    // What ties two cores together was worked out from these very responses: nothing that another
    // process adds may delay either side, or the other core's rows would no longer be true.
    const bool tied = !t.parent.empty() || t.join_wait.count() > 0;
    rows.push_back({0, t.name, t.cpu, t.priority, t.C, t.T, tied ? t.R : t.D, t.J, t.B});
  }
  for (const AdmittedTask& t : admission.platform) {
    if (!wanted(t.name, t.box)) continue;
    rows.push_back({0, t.name, t.cpu, t.priority, t.C, t.T, t.D, t.J, t.B});
  }
  for (const BestEffortLoad& load : request.best_effort) {
    if (!load.core || !wanted(load.name, Box::kOperator)) continue;
    constexpr Nanos kWindow{1'000'000'000};
    const auto c = static_cast<std::int64_t>(load.share * 1e9 + 0.5);
    rows.push_back({0, load.name, request.cpus[static_cast<std::size_t>(*load.core)], 0, Nanos{c},
                    kWindow, kWindow, Nanos{0}, Nanos{0}});
  }
  return rows;
}

}  // namespace rt

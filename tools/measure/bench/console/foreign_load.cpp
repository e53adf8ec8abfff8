#include "tools/measure/bench/console/foreign_load.hpp"

#include <unistd.h>

#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace teletact {

namespace {

constexpr pid_t kKernel = 2;  // kthreadd
constexpr auto kEach = std::chrono::seconds{1};

std::map<pid_t, ProcessStat> all_processes() {
  std::map<pid_t, ProcessStat> out;
  std::error_code failed;
  for (const auto& entry : std::filesystem::directory_iterator("/proc", failed)) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != name.npos) continue;
    std::ifstream in(entry.path() / "stat");
    std::string line;
    ProcessStat s;
    if (std::getline(in, line) && read_process_stat(line, s)) out[s.pid] = s;
  }
  return out;
}

}  // namespace

bool read_process_stat(const std::string& line, ProcessStat& out) {
  // The name stands in brackets and may hold any of them.
  const auto open = line.find(" ("), close = line.rfind(") ");
  if (open == line.npos || close == line.npos) return false;
  std::istringstream head(line.substr(0, open)), rest(line.substr(close + 2));
  char state = 0;
  std::int64_t skipped = 0;
  std::uint64_t user = 0, system = 0;
  head >> out.pid;
  rest >> state >> out.parent;
  for (int i = 0; i < 9; ++i) rest >> skipped;
  rest >> user >> system;
  for (int i = 0; i < 6; ++i) rest >> skipped;
  rest >> out.born;
  out.ticks = user + system;
  return !head.fail() && !rest.fail();
}

std::map<pid_t, ProcessStat> foreign(const std::map<pid_t, ProcessStat>& all, pid_t self) {
  std::map<pid_t, ProcessStat> out;
  for (const auto& [pid, process] : all) {
    bool own = false;
    // The way up; a table that is read while it changes might lead in a circle.
    pid_t at = pid;
    for (std::size_t i = 0; i < all.size() && at > 1 && !own; ++i) {
      own = at == self || at == kKernel;
      const auto up = all.find(at);
      at = up == all.end() ? 0 : up->second.parent;
    }
    if (!own) out[pid] = process;
  }
  return out;
}

ForeignLoad::ForeignLoad() : since_(std::chrono::steady_clock::now()) {
  look();
  ticks_ = 0;  // what they used before is not of now
  thread_ = std::jthread([this](const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any sleep;
    std::unique_lock held(mutex);
    while (!sleep.wait_for(held, stop, kEach, [] { return false; }) && !stop.stop_requested())
      look();
  });
}

ForeignLoad::~ForeignLoad() = default;

// What somebody else used since the last look; a program that is new has used all of it since.
void ForeignLoad::look() {
  const std::lock_guard held(mutex_);
  std::map<pid_t, Seen> now;
  for (const auto& [pid, s] : foreign(all_processes(), ::getpid())) {
    const auto before = others_.find(pid);
    const bool known = before != others_.end() && before->second.born == s.born;
    if (s.ticks > (known ? before->second.ticks : 0))
      ticks_ += s.ticks - (known ? before->second.ticks : 0);
    now[pid] = {s.born, s.ticks};
  }
  others_ = std::move(now);
}

double ForeignLoad::cores() {
  look();
  const std::lock_guard held(mutex_);
  const double wall =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - since_).count();
  return static_cast<double>(ticks_) / static_cast<double>(::sysconf(_SC_CLK_TCK)) / wall;
}

}  // namespace teletact

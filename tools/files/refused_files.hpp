// Files that the disk refuses to take while a box runs: each is told in one line, once, and the run
// goes on. Whether there were any is known at the end, for the exit code. Ordinary threads.
#pragma once

#include <cstdio>
#include <mutex>
#include <set>
#include <string>

namespace teletact {

class RefusedFiles {
 public:
  // `line` names the file and what is missing because of it; the same line again says nothing.
  void tell(const std::string& box, const std::string& line) { once(line, box, line); }
  // Of a file that grows while the box runs.
  void tell(const std::string& box, const std::string& file, const std::string& what_now) {
    once(file, box, "the disk refuses " + file + " (full?): " + what_now + "; the run goes on");
  }
  [[nodiscard]] bool any() const {
    const std::lock_guard lock(mutex_);
    return !told_.empty();
  }

 private:
  void once(const std::string& key, const std::string& box, const std::string& line) {
    const std::lock_guard lock(mutex_);
    if (!told_.insert(key).second) return;
    std::fprintf(stderr, "teletact %s: %s\n", box.c_str(), line.c_str());
    std::fflush(stderr);
  }
  mutable std::mutex mutex_;
  std::set<std::string> told_;
};

}  // namespace teletact

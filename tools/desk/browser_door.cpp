// Opening a browser without its address in anybody's list of processes.
#include <fcntl.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "tools/desk/browser_door.hpp"

extern char** environ;

namespace teletact {

namespace {

// A page that leads on to the address, in the user's own run-time folder.
std::string write_door(const std::string& url) {
  const char* folder = std::getenv("XDG_RUNTIME_DIR");
  if (folder == nullptr || *folder == '\0') return {};
  const std::string path = std::string(folder) + "/teletact-console.html";
  ::unlink(path.c_str());
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
  if (fd < 0) return {};
  const std::string page =
      "<!doctype html><meta charset=\"utf-8\"><title>teletact</title>"
      "<script>location.replace(\"" +
      url + "\")</script>\n";
  const bool whole = ::write(fd, page.data(), page.size()) == static_cast<ssize_t>(page.size());
  ::close(fd);
  return whole ? path : std::string();
}

// Without any descriptor of this program but the three that every program has: a browser that
// outlives the box would keep its port and its files.
bool spawn(const char* program, char* const* argv, pid_t& pid) {
  posix_spawn_file_actions_t actions;
  if (::posix_spawn_file_actions_init(&actions) != 0) return false;
  const bool started =
      ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1) == 0 &&
      ::posix_spawnp(&pid, program, &actions, nullptr, argv, environ) == 0;
  ::posix_spawn_file_actions_destroy(&actions);
  return started;
}

}  // namespace

void BrowserDoor::remove() noexcept {
  if (!path_.empty()) ::unlink(path_.c_str());
  path_.clear();
}

bool BrowserDoor::open(const std::string& url) {
  remove();
  if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr) return false;
  path_ = write_door(url);
  if (path_.empty()) return false;
  std::string program = "xdg-open", argument = path_;
  char* argv[] = {program.data(), argument.data(), nullptr};
  if (!spawn("xdg-open", argv, asked_)) {
    asked_ = 0;
    remove();
    return false;
  }
  return true;
}

BrowserDoor::Asked BrowserDoor::look() noexcept {
  if (asked_ == 0) return Asked::kNobody;
  int status = 0;
  const pid_t ended = ::waitpid(asked_, &status, WNOHANG);
  if (ended == 0) return Asked::kRuns;
  const bool shown = ended == asked_ && WIFEXITED(status) && WEXITSTATUS(status) == 0;
  asked_ = 0;
  if (!shown) remove();
  return shown ? Asked::kShown : Asked::kFailed;
}

}  // namespace teletact

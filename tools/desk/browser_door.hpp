// Asks the desktop to show a page. The address goes through a file that this user alone may read
// (0600, in XDG_RUNTIME_DIR), since a program's arguments are there for every user to see. It is
// removed when it has led somebody there, at the latest with this object.
//
// The program that is asked may be the browser itself, which ends when its window is closed:
// nothing waits for it.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

namespace teletact {

class BrowserDoor {
 public:
  BrowserDoor() = default;
  BrowserDoor(const BrowserDoor&) = delete;
  BrowserDoor& operator=(const BrowserDoor&) = delete;
  ~BrowserDoor() { remove(); }

  // False: there is no desktop, or nothing to ask it with.
  [[nodiscard]] bool open(const std::string& url);
  // How it went, looked at now and then; the end of what was asked is told once.
  enum class Asked : std::uint8_t { kNobody, kRuns, kShown, kFailed };
  Asked look() noexcept;
  void remove() noexcept;

 private:
  std::string path_;  // of the file; empty: there is none
  pid_t asked_ = 0;   // the program, while it runs
};

}  // namespace teletact

// Asks the desktop to show a page. The address goes through a file that this user alone may read
// (0600, in XDG_RUNTIME_DIR), since a program's arguments are there for every user to see. It is
// removed when it has led somebody there, at the latest with this object.
#pragma once

#include <string>

namespace teletact {

class BrowserDoor {
 public:
  BrowserDoor() = default;
  BrowserDoor(const BrowserDoor&) = delete;
  BrowserDoor& operator=(const BrowserDoor&) = delete;
  ~BrowserDoor() { remove(); }

  // False: there is no desktop, or no browser.
  [[nodiscard]] bool open(const std::string& url);
  void remove() noexcept;

 private:
  std::string path_;  // of the file; empty: there is none
};

}  // namespace teletact

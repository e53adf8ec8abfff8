// The addresses of a host name. The system's resolver blocks, for half a minute where name servers
// are dead, and can not be interrupted. So it runs in a thread of its own that nobody waits for, at
// the end neither: a box that stops does so at once. One look-up at a time.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/road/road_options.hpp"

namespace drivers {

class RoadNames {
 public:
  RoadNames(std::string host, RoadLookup lookup);

  // Begins a look-up. One that is still out, or whose answer nobody took, is used instead.
  void ask();
  // The answer to ask(), once.
  [[nodiscard]] std::optional<rt::Result<std::vector<std::string>>> answer();

 private:
  struct Out;
  std::string host_;
  RoadLookup lookup_;
  std::shared_ptr<Out> out_;  // shared with the thread, which may outlive this
};

}  // namespace drivers

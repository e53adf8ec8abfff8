// The addresses of a host name. The system's resolver blocks, for half a minute where name servers
// are dead, and can not be interrupted. So it runs in a thread of its own that nobody waits for, at
// the end neither: a box that stops does so at once. One look-up at a time.
#pragma once

#include <cstddef>
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
  // One that swallows what is sent to it takes all of an attempt's time: from now on answers begin
  // behind the address that they began with.
  void pass_over_first() noexcept { ++passed_over_; }
  // The answer to ask(), once.
  [[nodiscard]] std::optional<rt::Result<std::vector<std::string>>> answer();

 private:
  struct Out;
  std::string host_;
  RoadLookup lookup_;
  std::size_t passed_over_ = 0;
  std::shared_ptr<Out> out_;  // shared with the thread, which may outlive this
};

}  // namespace drivers

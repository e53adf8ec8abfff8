// The link to the robot at the moment, for the page: of the newest two seconds.
#pragma once

#include <cstdint>
#include <deque>
#include <span>

#include "tasks/graph/samples.hpp"

namespace teletact {

struct LinkNow {
  static constexpr rt::Nanos kWindow = std::chrono::seconds{2};
  double fps = 0;              // pictures that arrived, a second
  double mbit_s = 0;           // of all that is sampled: pictures and robot states, heads included
  double picture_age_ms = -1;  // of the newest picture, since the middle of its exposure; < 0: none
  double state_age_ms = -1;    // of the newest robot state, since it was taken
  [[nodiscard]] friend bool operator==(const LinkNow&, const LinkNow&) = default;
};

// `samples` in order of arrival; those of (now - kWindow, now] count.
[[nodiscard]] LinkNow link_now(std::span<const tasks::LinkSample> samples, rt::Time now);

// The share of the camera's pictures that did not arrive, by their numbers, in the window: lost, or
// left out by the sender because a newer one was there.
class PictureLoss {
 public:
  // A picture that was seen at `now`: the camera's number of it, and how many have arrived so far.
  void see(std::uint64_t number, std::uint64_t arrived, rt::Time now);
  [[nodiscard]] double share() const;  // below 0: not known yet

 private:
  struct Seen {
    rt::Time at{};
    std::uint64_t number = 0, arrived = 0;
  };
  std::deque<Seen> seen_;
};

}  // namespace teletact

// How long a lasting transport waits before it dials again: 20 ms, then twice as long each time, at
// most 1 s; from the start again once a session was ready. So a peer that starts again is found
// within about a second, and one that refuses every connection costs one attempt a second.
#pragma once

#include <algorithm>

#include "rt/time.hpp"

namespace drivers {

class BackOff {
 public:
  static constexpr rt::Nanos kFirst = std::chrono::milliseconds{20};
  static constexpr rt::Nanos kMost = std::chrono::seconds{1};

  // The wait after one more attempt that came to nothing.
  [[nodiscard]] rt::Nanos next() noexcept {
    const rt::Nanos wait = wait_;
    wait_ = std::min(2 * wait_, kMost);
    return wait;
  }
  void succeeded() noexcept { wait_ = kFirst; }

 private:
  rt::Nanos wait_ = kFirst;
};

}  // namespace drivers

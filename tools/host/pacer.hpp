// Paces simulated time by the real clock, for a person who watches a run without real-time rights.
// Simulated time is never ahead of real time. If the machine is too slow it lags. A lag above
// kForgiven is not made up for, because what a person sees and touches must not run fast. It is an
// actor of the virtual clock, outside of every job, so the run's bytes are those of the unpaced
// run.
#pragma once

#include <cstdint>
#include <functional>

#include "rt/sched/virtual_executor.hpp"

namespace teletact {

class Pacer final : public rt::Actor {
 public:
  static constexpr std::int64_t kStep = 1000000;        // ns of simulated time between two looks
  static constexpr std::int64_t kForgiven = 100000000;  // ns

  // `start`: simulated instant of the first look, when real time begins to count. `now`: a
  // monotonic clock. `sleep_until` may come back early (a signal): then so much less is waited.
  Pacer(std::int64_t start, std::function<std::int64_t()> now,
        std::function<void(std::int64_t)> sleep_until)
      : next_(start), now_(std::move(now)), sleep_until_(std::move(sleep_until)) {}

  [[nodiscard]] std::int64_t next_host_ns() const noexcept override { return next_; }
  void act(std::int64_t host_ns) override {
    next_ = host_ns + kStep;
    const std::int64_t now = now_();
    if (!began_) {
      began_ = true;
      start_ = now;
      ahead_ = now - host_ns;
    }
    // What lies up to the next look may run once it is past on the real clock.
    const std::int64_t due = next_ + ahead_;
    if (now < due) {
      sleep_until_(due);
    } else if (now - due > kForgiven) {
      lag_ += now - due;
      ahead_ += now - due;
    }
  }
  // Real time since the first look, and the part of it by which simulated time stays behind.
  [[nodiscard]] std::int64_t wall_ns() const { return began_ ? now_() - start_ : 0; }
  [[nodiscard]] std::int64_t lag_ns() const noexcept { return lag_; }

 private:
  std::int64_t next_, start_ = 0, lag_ = 0;
  std::int64_t ahead_ = 0;  // real minus simulated
  std::function<std::int64_t()> now_;
  std::function<void(std::int64_t)> sleep_until_;
  bool began_ = false;
};

}  // namespace teletact

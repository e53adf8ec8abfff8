// Which quality step the next frame takes, so that a stream keeps to its share of bytes a frame.
//
// Coarser when the running mean of the last frames is over the share, or what was sent is two
// frames' shares ahead of it; finer when the mean was below 3/4 of it for a third of a second (10
// frames) and nothing is owed. Integers only: the same sizes give the same steps.
#pragma once

#include <algorithm>
#include <cstdint>

namespace drivers {

class RateSteps {
 public:
  // Steps run from finest to coarsest (finest <= first <= coarsest).
  RateSteps(int finest, int first, int coarsest) noexcept
      : finest_(finest), coarsest_(coarsest), step_(first) {}

  [[nodiscard]] int step() const noexcept { return step_; }
  // After each frame: its bytes, and what the road had room for. share 0: no limit.
  void sent(std::int64_t bytes, std::int64_t share) noexcept {
    if (share <= 0) return;
    owed_ = std::max<std::int64_t>(0, owed_ + bytes - share);
    mean_ = mean_ == 0 ? bytes : (3 * mean_ + bytes) / 4;
    ++since_;
    low_ = 4 * mean_ < 3 * share && owed_ == 0 ? low_ + 1 : 0;
    // Two frames show what a step did before the next one is taken.
    const bool over = (mean_ > share && since_ > 2) || owed_ > 2 * share;
    if (over && since_ > 1 && step_ < coarsest_) {
      ++step_, mean_ = 0, since_ = 0, low_ = 0;
    } else if (low_ >= 10 && step_ > finest_) {
      --step_, mean_ = 0, since_ = 0, low_ = 0;
    }
  }

 private:
  int finest_, coarsest_, step_;
  std::int64_t owed_ = 0, mean_ = 0;
  int low_ = 0, since_ = 0;
};

}  // namespace drivers

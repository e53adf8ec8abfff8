// What the sources of the fusion task share.
#pragma once

#include <cstdint>

#include "perception/geometry/rgbd_frame.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/sched/fork_join.hpp"

namespace tasks {

inline constexpr std::uint64_t kWorkOfBlock = 512;

// Adds the CPU of its scope, of the way through, to a counter while profiling is on.
class Stage {
 public:
  Stage(bool on, const rt::ForkJoin& crew, std::int64_t& sum) noexcept
      : crew_(crew), sum_(on ? &sum : nullptr), begin_(on ? now() : 0) {}
  ~Stage() {
    if (sum_ != nullptr) *sum_ += now() - begin_;
  }
  Stage(const Stage&) = delete;
  Stage& operator=(const Stage&) = delete;

 private:
  [[nodiscard]] std::int64_t now() const noexcept {
    return rt::thread_cpu_ns() + crew_.beyond_ns();
  }
  const rt::ForkJoin& crew_;
  std::int64_t* sum_;
  std::int64_t begin_;
};

inline perception::ImageView<const perception::Rgb> colour_of(
    const perception::RgbdFrame& frame) noexcept {
  return frame.has_colour ? frame.rgb() : perception::ImageView<const perception::Rgb>{};
}

}  // namespace tasks

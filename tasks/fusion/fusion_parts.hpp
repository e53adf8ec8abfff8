// What the parts of the fusion task share: the threads they run on, what they cost, what is
// believed of the camera.
#pragma once

#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/sched/fork_join.hpp"
#include "rt/time.hpp"
#include "tasks/fusion/fusion_io.hpp"

namespace tasks {

inline constexpr std::uint64_t kWorkOfBlock = 512;

// The threads of a step, and the CPU of its stages while profiling is on.
struct FusionStages {
  rt::ForkJoin* crew = &rt::serial();
  bool profiling = false;
  FusionProfile times;
};

// Adds the CPU of its scope, of the way through, to a stage while profiling is on.
class Stage {
 public:
  Stage(FusionStages& stages, std::int64_t FusionProfile::*stage) noexcept
      : crew_(*stages.crew),
        sum_(stages.profiling ? &(stages.times.*stage) : nullptr),
        begin_(stages.profiling ? now() : 0) {}
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

// Where the camera is believed to be, and what came of the images so far.
struct CameraState {
  Pose X_WC = Pose::Identity();  // last pose believed
  bool started = false;          // there is a map: an image was consumed, or a map was loaded
  rt::Time exposure{};           // of the last frame consumed
  rt::Time fused{};              // of the last frame integrated
  rt::Time seen{};               // of the last frame claimed
  std::uint64_t frames = 0, frames_claimed = 0;
};

inline perception::ImageView<const perception::Rgb> colour_of(
    const perception::RgbdFrame& frame) noexcept {
  return frame.has_colour ? frame.rgb() : perception::ImageView<const perception::Rgb>{};
}

}  // namespace tasks

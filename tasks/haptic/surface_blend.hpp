// The surface that is touched: the newest patch, into which the one before it fades over one fusion
// period, and the field of both. A patch that steps up under the hand is blended over 1.46 periods.
//
// A patch that was handed in is read until the second one after it is handed in.
// Nothing here allocates, locks or throws.
#pragma once

#include <cstdint>

#include "perception/patch/surface_patch.hpp"
#include "tasks/haptic/field.hpp"

namespace tasks {

class SurfaceBlend {
 public:
  enum class Taken : std::uint8_t {
    kNothing,  // none, or the same again
    kRefused,  // malformed
    kOnward,   // of the same map, or the first of all
    kOtherMap  // old places mean nothing in it
  };

  SurfaceBlend() = default;
  explicit SurfaceBlend(double blend_s) : blend_s_(blend_s) {}

  // No blend is running: a patch may be taken.
  [[nodiscard]] bool wants_patch() const noexcept { return older_ == nullptr; }
  [[nodiscard]] bool blending() const noexcept { return older_ != nullptr; }
  [[nodiscard]] const perception::SurfacePatch* older() const noexcept { return older_; }
  [[nodiscard]] const perception::SurfacePatch* newest() const noexcept { return newer_; }
  [[nodiscard]] Field& field() noexcept { return field_; }
  [[nodiscard]] const Field& field() const noexcept { return field_; }
  // How far the blend is, 1 = settled.
  [[nodiscard]] double share() const noexcept { return share_; }
  // The blend that runs, or ran last, is a step of the surface.
  [[nodiscard]] bool steps() const noexcept { return steps_; }

  // Every pointer handed in is one acquire of the channel: what was taken before the last one is
  // about to be reused, whether or not this task liked what came since. After kOnward and kOtherMap
  // begin() has to follow.
  Taken take(const perception::SurfacePatch* patch) noexcept;
  // What the blend brings to a hand that stands: force at the device, and energy into its spring.
  // Zero where nothing blends.
  void begin(double rise_N, double held_J) noexcept;
  // `pace`: below 1, the blend is slowed down.
  void advance(double dt, double pace) noexcept;

 private:
  double blend_s_ = 0;
  Field field_;
  const perception::SurfacePatch* older_ = nullptr;  // non-null while blending
  const perception::SurfacePatch* newer_ = nullptr;
  double share_ = 1;
  double time_ = 1;    // 0 to 1, what the share is made of
  double rise_N_ = 0;  // what this blend adds to the force on a hand that stands
  bool steps_ = false;
  bool allowed_ = true;  // false: what older_ would be is no longer retained
};

}  // namespace tasks

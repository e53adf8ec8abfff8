// What a predictor of the base's motion may know: its samples, and the commands it was given.
//
// Samples rise strictly in time; a source faster than 64 Hz is thinned (the newest sample is always
// kept). Commands hold from their instant until the next one and may be known ahead of the samples.
// Fixed memory, allocated in the constructor. Frames: pose X_OB in a fixed frame, twist in the body
// frame. SI; times in seconds from any zero.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "perception/geometry/planar.hpp"

namespace tasks {

struct MotionSample {
  double t = 0;  // s
  perception::Pose2 X_OB;
  perception::Twist2 v_B;
};

// vx, vy, wz.
using Axes = std::array<double, 3>;
[[nodiscard]] inline Axes axes(const perception::Twist2& v) noexcept { return {v.vx, v.vy, v.wz}; }
[[nodiscard]] inline perception::Twist2 twist(const Axes& a) noexcept { return {a[0], a[1], a[2]}; }

// The constant body twist times time that leads from one pose to another; turns below pi.
[[nodiscard]] perception::Twist2 way_between(const perception::Pose2& from,
                                             const perception::Pose2& to) noexcept;

class MotionHistory {
 public:
  // Larger values are no measurement of a robot: squares of them must stay finite.
  static constexpr double kLargest = 1e6;
  static constexpr double kMinSpacing_s = 0.0155;  // samples nearer than this replace the last one

  MotionHistory();

  // False and ignored: not finite, larger than kLargest, or not later than the last one.
  bool add(const MotionSample&) noexcept;
  bool add_command(double t, const perception::Twist2& cmd_B) noexcept;
  void clear() noexcept;

  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] const MotionSample& sample(std::size_t i) const noexcept { return at(i).sample; }
  [[nodiscard]] const MotionSample& newest() const noexcept { return at(size_ - 1).sample; }
  [[nodiscard]] double first_t() const noexcept { return at(0).sample.t; }

  // At an instant not before the first sample, between samples on a line; after the newest: its
  // velocity. `hint` is an index not before the wanted one, and becomes it: a walk backwards costs
  // no search.
  [[nodiscard]] Axes velocity(double t, std::size_t& hint) const noexcept;
  // Integral of the body velocities since the first sample.
  [[nodiscard]] Axes travelled(double t, std::size_t& hint) const noexcept;
  // Pose between samples on the arc that joins them; false: outside what is held.
  [[nodiscard]] bool pose_at(double t, perception::Pose2& out) const noexcept;

  // The command in force; null: none so early.
  [[nodiscard]] const Axes* command_at(double t) const noexcept;

 private:
  struct Entry {
    MotionSample sample;
    Axes travelled{};  // trapezoids
  };
  struct Command {
    double t = 0;
    Axes value{};
  };
  static constexpr std::size_t kEntries = 2048, kCommands = 4096;

  [[nodiscard]] const Entry& at(std::size_t i) const noexcept {
    return entries_[(head_ + i) % kEntries];
  }
  [[nodiscard]] std::size_t last_not_after(double t) const noexcept;

  std::vector<Entry> entries_;
  std::vector<Command> commands_;
  std::size_t head_ = 0, size_ = 0, command_head_ = 0, command_size_ = 0;
};

}  // namespace tasks

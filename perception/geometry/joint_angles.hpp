// A robot's joint readings at the exposure of an image, with their stated error and age.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace perception {

struct JointAngles {
  static constexpr int kMost = 16;
  int count = 0;  // 0: nothing is known of any joint (recordings, robots without an arm)
  std::array<float, kMost> position{};  // rad, prismatic joints m; in the order of the description
  std::array<float, kMost> speed{};     // rad/s, m/s
  float error = 0;                      // stated: largest error of any reading, rad or m
  float age_s = 0;  // stated: largest distance in time from the middle of the exposure

  // All values are in the range of a joint; anything else was damaged on its way.
  [[nodiscard]] bool plausible() const noexcept {
    const auto within = [](float x, float lo, float hi) { return x >= lo && x <= hi; };  // NaN: no
    if (count < 0 || count > kMost || !within(error, 0, 10) || !within(age_s, 0, 3600))
      return false;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i)
      if (!within(position[i], -1000, 1000) || !within(speed[i], -1000, 1000)) return false;
    return true;
  }
  friend bool operator==(const JointAngles&, const JointAngles&) = default;
};

}  // namespace perception

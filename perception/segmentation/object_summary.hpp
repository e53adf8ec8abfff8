// What a segmented object is to the rest of the system: where it is, how it lies, how large, its
// colour.
#pragma once

#include <span>

#include "perception/geometry/pose.hpp"
#include "perception/segmentation/lab.hpp"

namespace perception {

struct ObjectSummary {
  // Origin: centroid of the points. Axes: principal axes, the longest first, right-handed; each
  // points to the side where the points reach farther, so that the frame does not flip with noise.
  Pose X_FO = Pose::Identity();  // object in the frame F of the points
  Vec3 extent_m{0, 0, 0};  // of the box along the axes that holds the points but 1 % at each end
  Vec3 centre_m{0, 0, 0};  // of that box, in O
  Rgb colour;              // mean
  int points = 0;
};

// Fewer than 3 points give points = 0 and the colour alone. `scratch` holds points.size() values.
[[nodiscard]] ObjectSummary summarise(std::span<const Vec3f> points, std::span<const Rgb> colours,
                                      std::span<float> scratch) noexcept;

}  // namespace perception

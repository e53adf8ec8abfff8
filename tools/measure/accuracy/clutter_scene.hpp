// A table full of things as an RGB-D camera sees it, with true masks: boxes stacked and flush,
// cans, balls, a
// cup, thin rods, things that hide others. Cast ray by ray; no constant of segmentation was
// chosen on it.
//
// Depth: axial noise that grows with z^2, lateral noise of a ray, no reading beside edges, on
// slanted surfaces and in
// small holes, a shadow to the left of what stands in front (the projector's side). Colour:
// patterns, shading, noise.
// A thing is judged where at least 400 of its pixels are seen. Same seed, same scene.
#pragma once

#include <cstdint>

#include "tools/measure/bench/table2/labelled_frames.hpp"

namespace teletact {

struct ClutterScene {
  LabelledFrame frame;  // depth in mm
  perception::Intrinsics k;
};

[[nodiscard]] ClutterScene clutter_scene(std::uint64_t seed);

}  // namespace teletact

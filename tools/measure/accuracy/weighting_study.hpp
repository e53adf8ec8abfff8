// teletact accuracy weighting: what the weights of the readings in the tracker's least squares cost
// and buy, with the watch for moving things and without it. Settings of fusion.tracker.noise_m,
// noise_per_m2, noise_from_m:
//
//   uniform   per_m2 0: every reading the same
//   noise     1.5 mm + 1.9 mm/m2 (z - 0.4 m)^2: what a structured-light camera's readings scatter
//             by
//   default   the product's
//   steep     1.5 mm + 8 mm/m2 (z - 1.2 m)^2
//
// The default was chosen on the scene `room` and on the recording as it goes; a data set's name
// says so (chosen_*). All others (unseen_*: the recording backwards, other scenes, samples of
// things that move with a seed of their own) had no part in it. The rule also tells which points
// are on the model's surface, so that a setting changes what counts as lost.
//
//   ate_mm, worst_mm, claimed, cpu_ms   as in fusion_study.hpp; of moving samples the median, the
//                                       largest, the mean, the mean
//   wrong                               of moving samples: those with a claim more than 20 mm off,
//                                       above a share of .30 50 mm
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tools/measure/accuracy/fusion_study.hpp"

namespace teletact {

struct WeightingOptions {
  std::vector<std::string> scenes{"room", "stairs", "turn"};
  int frames = 200;
  std::vector<double> voxels_mm{20};
  int samples = 6;  // of things that move, half images
  std::uint64_t seed = 31;
  std::string rgbd;  // as in FusionStudyOptions
  int rgbd_frames = 150;
  std::optional<drivers::TumOptions::Pinhole> pinhole = std::nullopt;
};

// The frames from the last to the first, at the instants of the first to the last.
[[nodiscard]] FusionSequence backwards(const FusionSequence& sequence);

// Throws std::runtime_error on an unknown scene or a recording without poses.
[[nodiscard]] Study study_weighting(std::ostream& progress, const WeightingOptions& options);

}  // namespace teletact

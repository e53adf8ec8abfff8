// Compares a run on a recording with the ground truth that came with it. No task ever gets any of
// it.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "perception/geometry/pose.hpp"
#include "tasks/graph/samples.hpp"

namespace teletact {

// Length of the recording, s. Throws std::runtime_error with the reader's message.
[[nodiscard]] double recording_seconds(const std::string& dir);
// Of the images that fusion took.
struct TrackingFigures {
  // Translation error over claimed frames, aligned by the first claimed pose: RMS and largest; -1
  // without true poses or frames.
  double ate_first_pose_mm = -1, off_mm = -1;
  std::size_t frames = 0, tracked = 0, claimed = 0;
};
// Where the camera truly was at an exposure, in any one frame; none: not known.
using TruthAt = std::function<std::optional<perception::Pose>(rt::Time exposure)>;
[[nodiscard]] TrackingFigures tracking_figures(const std::vector<tasks::FusionSample>& samples,
                                               const TruthAt& truth_WC);

// `frames`: of the recording that reached fusion; the held last one counts once.
using RecordingFigures = TrackingFigures;
[[nodiscard]] RecordingFigures recording_figures(const std::string& dir,
                                                 const std::vector<tasks::FusionSample>& samples);

}  // namespace teletact

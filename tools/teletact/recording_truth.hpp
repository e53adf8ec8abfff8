// Figures of a run on a recording that compare with what came with the recording. Nothing of it ever
// reaches a task.
#pragma once

#include <string>
#include <vector>

#include "tasks/graph/samples.hpp"

namespace teletact {

// Length of the recording, s. Throws std::runtime_error with the reader's message.
[[nodiscard]] double recording_seconds(const std::string& dir);
struct RecordingFigures {
  double ate_first_pose_mm = -1;  // RMS translation error over claimed frames, aligned by the first
                                  // claimed pose; -1 without true poses or frames
  std::size_t frames = 0;  // of the recording that reached fusion; the held last one counts once
  std::size_t tracked = 0, claimed = 0;  // of these
};
[[nodiscard]] RecordingFigures recording_figures(const std::string& dir,
                                                 const std::vector<tasks::FusionSample>& samples);

}  // namespace teletact

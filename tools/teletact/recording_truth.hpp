// Figures of a run on a recording that compare with what came with the recording. Nothing of it ever
// reaches a task.
#pragma once

#include <string>
#include <vector>

#include "tasks/graph/samples.hpp"

namespace teletact {

// Length of the recording, s. Throws std::runtime_error with the reader's message.
[[nodiscard]] double recording_seconds(const std::string& dir);
// RMS translation error over claimed frames, aligned by the first claimed pose, mm; -1 without
// groundtruth.txt or frames.
[[nodiscard]] double recording_error_mm(const std::string& dir,
                                        const std::vector<tasks::FusionSample>& samples);

}  // namespace teletact

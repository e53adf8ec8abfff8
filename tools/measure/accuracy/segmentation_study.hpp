// teletact accuracy segmentation: error of one touch (1 - mean IoU) against thread CPU, over the
// knobs of the touch segmentation, on folders of RGB-D frames with true masks
// (tools/measure/bench/table2/touches.hpp).
#pragma once

#include <cstdint>
#include <ostream>
#include <string>

#include "tools/measure/accuracy/study.hpp"

namespace teletact {

struct SegmentationStudyOptions {
  std::string data;  // folder that holds mosd_learn, tabletop or ycb_video
  std::uint64_t seed = 1;
};

// Throws std::runtime_error when the folder holds none of them.
[[nodiscard]] Study study_segmentation(std::ostream& progress,
                                       const SegmentationStudyOptions& options);

}  // namespace teletact

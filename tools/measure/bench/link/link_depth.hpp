// How far the depth that the operator's box decoded is from the truth, over the same of the
// camera's own readings. The pictures come from the recording of that box's link: its bytes as they
// arrived, decoded again by the product's decoder. Truth and readings are rendered again, from the
// twin's true pose, by the camera's number of each picture.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/host/run_results.hpp"
#include "tools/scene/scene.hpp"

namespace teletact {

struct LinkDepth {
  std::uint64_t decoded = 0;  // pictures, all of the recording
  std::uint64_t judged = 0;   // of them, held against the truth
  double over_sensor = 0;     // RMS of error / sigma, decoded over sensor; NaN: nothing was judged
  std::string problem;        // empty: it could be measured
};

struct LinkDepthOptions {
  std::string recording;    // operator.inputs
  double from_s = 3;        // behind the first picture: a filter of the codec has settled
  std::uint64_t each = 10;  // every n-th picture is judged
};

// `scene`: as both boxes had it. Away from depth edges, where jitter and drop-out act.
[[nodiscard]] LinkDepth link_depth(const Scene& scene, const RobotHalf& robot,
                                   const LinkDepthOptions& options);

}  // namespace teletact

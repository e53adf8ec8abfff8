// teletact bench segmentation: IoU of one touch, and what an answer costs.
//
// DIR holds folders of RGB-D frames with true masks: NAME/rgb/*.png, NAME/depth/*.png, NAME/label/*.png
// (16 bit), intrinsics as the folder's kind has them. Known kinds: mosd_learn (label / 10 is the object,
// below 2 the table, 0 no label), tabletop and ycb_video (label is the object, 0 everything else).
// Ten touches an object, uniform over its mask at least 3 pixels from its edge where it is that thick.
// IoU is the mean over an object's touches, then over objects.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "tools/bench/bench_metric.hpp"

namespace teletact {

struct TouchRow {
  std::string folder;
  int frames = 0, objects = 0, touches = 0;
  double iou_default = 0, iou_paper = 0;
  double iou_low = 0;                     // default: the object at the 10 % quantile
  double first_ms = 0, first_p95_ms = 0;  // thread CPU of frame and touch together, the whole image
  double iou_follow = 0;                  // a mask that follows the true one
  // As fusion does it (followed.hpp): the answer to a touch, a frame with one object, and what each
  // further one adds to it; IoU of the map's labels.
  double touch_ms = 0, touch_p95_ms = 0, follow_ms = 0, further_ms = 0, iou_fused = 0;
};

struct TouchResult {
  std::uint64_t seed = 0;
  std::vector<TouchRow> rows;
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// Folders of other names are left out; none known: std::runtime_error.
[[nodiscard]] TouchResult bench_touches(std::ostream& progress, const std::string& folder,
                                        std::uint64_t seed);

}  // namespace teletact

// teletact bench segmentation: IoU of one touch, and what an answer costs.
//
// DIR is, or holds, folders of RGB-D frames with true masks: NAME/rgb/*.png, NAME/depth/*.png,
// NAME/label/*.png (16 bit), NAME/intrinsics.txt (drivers/camera/recording/intrinsics_file.hpp; the
// depth's unit too). A label is an object, 0 everything else, 65535 is not judged. By name: mosd...
// (label / 10 is the object, below 2 the table, 0 no label), tabletop, ycb_video; these need no
// intrinsics.txt. Ten touches an object, uniform over its mask at least 3 pixels from its edge
// where it is that thick. IoU is the mean over an object's touches, then over objects.
#pragma once

#include <array>
#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "perception/segmentation/touch_segmenter.hpp"
#include "tools/files/bench_metric.hpp"
#include "tools/measure/bench/limit.hpp"

namespace teletact {

struct TouchRow {
  std::string folder;
  [[nodiscard]] std::string name() const;  // of its metrics: a-z, 0-9, _; of mosd_learn: mosd
  int frames = 0, objects = 0, touches = 0;
  double iou_default = 0, iou_paper = 0;
  std::array<double, 2>
      iou_half{};      // default: the 1st, 3rd, ... and the 2nd, 4th, ... frame; NaN: no object
  double iou_low = 0;  // default: the object at the 10 % quantile
  double first_ms = 0, first_p95_ms = 0;  // thread CPU of frame and touch together, the whole image
  double iou_follow = 0;                  // a mask that follows the true one
  // As fusion does it (followed.hpp): the answer to a touch, a frame with one object, and what each
  // further one adds to it; IoU of the map's labels.
  double touch_ms = 0, touch_p95_ms = 0, follow_ms = 0, further_ms = 0, iou_fused = 0;
};

struct TouchResult {
  std::uint64_t seed = 0;
  std::vector<TouchRow> rows;
  double other_load = 0;  // cores, meanwhile
  // Mean IoU of a touch >= .85 on mosd_learn, >= .80 on tabletop; of every folder 12 ms for the
  // answer to a touch, 3.3 ms for a frame with one object, .5 ms for each further one (medians; not
  // measured beside others).
  [[nodiscard]] std::vector<Limit> limits() const;
  [[nodiscard]] int missed() const { return teletact::missed(limits()); }
  [[nodiscard]] std::vector<BenchMetric> metrics() const;
  void print(std::ostream& out) const;
};

// A folder without intrinsics is left out, which is said on `progress`; none left:
// std::runtime_error. With touches_only neither method paper runs nor is an object followed: their
// figures stay 0.
[[nodiscard]] TouchResult bench_touches(std::ostream& progress, const std::string& folder,
                                        std::uint64_t seed,
                                        const perception::TouchConfig& config = {},
                                        bool touches_only = false);

}  // namespace teletact

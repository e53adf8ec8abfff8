// Objects followed as fusion does it: one RGB-D frame again and again into a map, one touch an
// object, masks, votes, summaries (perception/objects). The camera stands still and its pose is
// known, so what is measured is what objects cost a frame, and what their labels in the map are
// worth.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "perception/objects/object_map.hpp"

namespace teletact {

struct FollowedRun {
  std::vector<double>
      touch_ms;  // of the frames that answered a touch: thread CPU of segment and vote
  std::vector<double> one_ms;               // of the frames with one object
  double one_mean_ms = 0, all_mean_ms = 0;  // a frame with one object, with all of them
  int objects = 0;                          // answered with a new object, and held at the end
  std::vector<double> iou;                  // of the map's labels at the readings, an object
};

class FollowedObjects {
 public:
  FollowedObjects(const perception::Intrinsics& k, float mm_per_unit);
  ~FollowedObjects();

  struct Touch {
    std::uint16_t object;  // as in `label`
    int u, v;
  };
  // label: object, 0 rest, 65535 not judged.
  [[nodiscard]] FollowedRun run(perception::ImageView<const perception::Rgb> rgb,
                                perception::ImageView<const std::uint16_t> depth,
                                const perception::Image<std::uint16_t>& label,
                                const std::vector<Touch>& touches);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace teletact

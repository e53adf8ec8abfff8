// The limits by which MotionWatch tells what moves, and what it says of an image
// (motion_watch.hpp).
#pragma once

#include <cstdint>

#include "config/schema.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/motion/consensus.hpp"

namespace perception {

struct MotionConfig {
  bool on = true;
  // chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
  double front_m = 0.018;  // in front of the map's surface by this ...
  // chosen on: not recorded; judged on: moving 606, moving 707
  double front_voxel = 0.4;  // ... and this share of a voxel ...
  double front_sigma = 3;    // ... and so many sigma of a coarse pixel: evidence
  // chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
  double least_share = 0.15;  // of a thing that is evidence
  // chosen on: not recorded; judged on: moving 606, moving 707
  int least_pixels = 10;  // of the coarse image
  int rest_frames = 20;
  // chosen on: recording both ways at 10 and 20 mm, moving 1 first 40; judged on: moving 606, moving 707
  double least_explained = 0.975;  // of what stands still, by a pose that is tracked by its noise
  // chosen on: not recorded; judged on: moving 606, moving 707
  double rest_cell_m = 0.025;
  void describe(config::Section& s);
};

struct MotionResult {
  bool moving = false;  // some pixels are masked
  bool doubtful =
      false;  // the prior leaves much of what may stand still unexplained: hypotheses have competed
  bool sudden =
      false;  // much more moves than in the last image: compete() and find() have to look again
  bool certain = true;           // no other motion explains the image nearly as well
  Pose X_WC = Pose::Identity();  // by what stands still; where tracking starts
  ConsensusResult consensus;
  double masked_share = 0;  // of the coarse pixels with depth
  int evidence = 0, cells_misfit = 0;
  std::uint64_t work = 0;
};

}  // namespace perception

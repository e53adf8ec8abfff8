#include "perception/motion/motion_config.hpp"

namespace perception {

void MotionConfig::describe(config::Section& s) {
  s.flag("on", on, "look for what moves; off: everything is the place")
      .number("front_m", front_m, 0.001, 0.2, "in front of the map's surface by this much ...")
      .number("front_voxel", front_voxel, 0, 4, "... and this share of a voxel ...")
      .number("front_sigma", front_sigma, 0, 20, "... and so many sigma: it moves")
      .number("least_share", least_share, 0.01, 1, "of a thing that has to be seen to move")
      .integer("least_pixels", least_pixels, 4, 1000, "of the coarse image, of a thing")
      .integer("rest_frames", rest_frames, 2, 300, "in its place, and it is part of the map")
      .number("least_explained", least_explained, 0, 1,
              "of what stands still, by a tracked pose; below, it is carried")
      .number("rest_cell_m", rest_cell_m, 0.005, 0.2, "edge of such a place");
}

}  // namespace perception

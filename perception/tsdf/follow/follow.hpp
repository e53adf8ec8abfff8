// Follows surfaces that move slowly while they are in view, block by block. Static surfaces keep
// the low noise of their running mean of a hundred readings.
//
// A running mean of w readings lags w frames behind a moving surface. The lag is visible: all
// readings of an area end on the same side of the map's surface. So, each frame:
//
//   1. Compare some readings with the map, on a grid that shifts with the frame. The field at the
//      end of a reading is its offset along the ray. The readings of a block, of this and the last
//      frames, give the motion of its surface; their scatter gives its standard error. Beyond
//      kLeast_m and kErrors standard errors the block may have moved. If no block did, stop here.
//   2. Rule out an error of the camera's pose, which offsets the whole image. The small motion that
//      most of the image agrees on is fitted robustly to tiles of it (point to plane). A block has
//      moved only if it is off both with and without that motion, by more than the scatter of the
//      rest of the image. Without a majority nothing is changed.
//   3. Examine such blocks and their neighbours node by node, and smooth the result over neighbours
//      that agree. Move their nodes with the surface and set their weight to kMoved readings, so
//      that remaining errors fade soon. Nodes at the ends of the band, whose distance is only a
//      bound, get kEnds.
//
// Distances and offsets are along the ray, so over a plane all nodes of a block move by the same
// amount. A single noisy spot moves nothing: the mean of a block has tens of pixels.
// Readings that are off by kSlowReach truncations or more are no slow motion. They are left to the
// running mean and to the mask of moving things.
// Doubles in a fixed order: the same bytes with any instruction set and any number of threads.
//
// Thread    of the map's writer. No allocation after the constructor.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct FollowScratch;

struct FollowCounts {
  std::int32_t blocks_moved = 0;
  std::int64_t tests = 0;  // readings compared, and nodes of what was looked at
};

class SurfaceFollower {
 public:
  // Both belong to the map and must outlive this object.
  SurfaceFollower(rt::NonRealtime&, MapStore& store, const DepthPyramid& pyramid);
  ~SurfaceFollower();
  SurfaceFollower(const SurfaceFollower&) = delete;
  SurfaceFollower& operator=(const SurfaceFollower&) = delete;

  // Follows by the image in the pyramid, between allocation and update. frame: its number, one more
  // than that of the frame before; X_CW_last: camera pose of that frame.
  FollowCounts step(const FrameCamera& view, std::uint32_t frame, const Pose& X_CW_last) noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  MapStore& store_;
  const DepthPyramid& pyramid_;
  std::unique_ptr<FollowScratch> scratch_;
};

}  // namespace perception

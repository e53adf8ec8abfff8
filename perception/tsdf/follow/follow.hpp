// A surface that creeps, rises or settles while it is looked at is followed, block by block; what stands keeps the noise of
// its hundred readings.
//
// A running mean of w readings lags w frames behind what moves. How far it lags is seen: readings end off the surface that the
// map has, all of a patch to the same side, and what a mean of a hundred leaves of a slow motion adds up. So:
//
//   1. some readings of the image, on a grid that shifts with the frame, are compared with the map: the field where they end is
//      by how much they are off, along the ray. A block's readings of this and the last frames say how far its surface has
//      moved, and their own scatter how well that is known. Beyond kLeast_m and kErrors standard errors: it may have moved.
//      Nothing did: that was all, and the map is left to the mean.
//   2. an error of the camera's pose is off in the whole image. The small motion that most of the image agrees on is fitted
//      robustly to tiles of it (point to plane); a block has moved only if it is off with and without that motion, by more
//      than the rest of the image scatters. Where no majority agrees nothing is learned.
//   3. such blocks and those beside them are looked at node by node, and what holds is smoothed over neighbours that agree. Their
//      nodes are moved with the surface and count kMoved readings, so that what is left of an error is soon gone; those at the
//      ends of the band, whose distance is a bound, count kEnds.
//
// Distances are along the ray, and so are offsets: over a plane in any direction all nodes of a block move by the same.
// A single place of noise moves nothing: a block's mean has tens of pixels in it.
// Readings that are off by kMost truncations and more are no slow motion: left to the mean, and to the mask of what moves.
// Plain doubles in a fixed order: the same bytes with any instruction set and any number of threads.
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
  // Both are the map's and stay as long.
  SurfaceFollower(rt::NonRealtime&, MapStore& store, const DepthPyramid& pyramid);
  ~SurfaceFollower();
  SurfaceFollower(const SurfaceFollower&) = delete;
  SurfaceFollower& operator=(const SurfaceFollower&) = delete;

  // Of the image in the pyramid, between allocation and update. frame: its number, one more than that of the frame before;
  // X_CW_last: the camera of that.
  FollowCounts step(const FrameCamera& view, std::uint32_t frame, const Pose& X_CW_last) noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  MapStore& store_;
  const DepthPyramid& pyramid_;
  std::unique_ptr<FollowScratch> scratch_;
};

}  // namespace perception

// Free space where no block is: cubes of nodes that lie wholly in front of every reading they project
// onto. Top down: a chunk, then halves, down to 2^3 nodes; a cube that is decided either way ends the
// descent, so the cost follows the border of what is newly seen, not the volume.
//
// One bit per 2^3 nodes (all of them, conservatively); a chunk that was carved in the last frame waits for the next one every
// other time. Free is not unknown. Blocks keep their own bits.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"
#include "perception/tsdf/integrate/block_allocator.hpp"
#include "perception/tsdf/integrate/integrate_stats.hpp"
#include "perception/tsdf/integrate/kept_volume.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

class FreeSpaceCarver {
 public:
  // All of them are the map's and stay as long.
  FreeSpaceCarver(rt::NonRealtime&, MapStore&, BlockAllocator&, const KeptVolume&,
                  const DepthPyramid&);

  // Of the image in the pyramid. frame: its number, one more than that of the frame before.
  void carve(const FrameCamera& view, std::uint32_t frame, rt::ForkJoin& crew,
             IntegrateStats&) noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  // c: the cube's chunk, or null; then it is made where something is free.
  void carve_cube(const FrameCamera& view, MapLayout::Chunk*& c, const std::array<int, 3>& node0,
                  int edge, IntegrateStats&) noexcept;

  MapStore& store_;
  BlockAllocator& allocator_;
  const KeptVolume& volume_;
  const DepthPyramid& pyramid_;
  std::vector<MapLayout::Chunk*> to_carve_;  // of the frame being fused
};

}  // namespace perception

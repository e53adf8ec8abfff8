// Free space outside of blocks: cubes of nodes that lie wholly in front of every reading onto which
// they project. The search goes top down from a chunk by halves to 2^3 nodes and stops at a cube
// that is decided either way. So the cost follows the border of newly seen space, not its volume.
//
// One bit per 2^3 nodes, set only if all of them are free. A chunk that was carved in the last
// frame is skipped every other time. Free is not the same as unknown. Blocks keep their own bits.
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
  // All of them belong to the map and must outlive this object.
  FreeSpaceCarver(rt::NonRealtime&, MapStore&, BlockAllocator&, const KeptVolume&,
                  const DepthPyramid&);

  // Carves by the image in the pyramid. frame: its number, one more than that of the frame before.
  void carve(const FrameCamera& view, std::uint32_t frame, rt::ForkJoin& crew,
             IntegrateStats&) noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  // c: the cube's chunk, or null; then it is created if something is free.
  void carve_cube(const FrameCamera& view, MapLayout::Chunk*& c, const std::array<int, 3>& node0,
                  int edge, IntegrateStats&) noexcept;

  MapStore& store_;
  BlockAllocator& allocator_;
  const KeptVolume& volume_;
  const DepthPyramid& pyramid_;
  std::vector<MapLayout::Chunk*> to_carve_;  // of the frame being fused
};

}  // namespace perception

// Creates the blocks that a frame's bands pass through. Only the ends of rays get voxels.
//
// Order     blocks are created row by row, within a row in the order of their coordinates. So the
//           map does not depend on how many rays or threads search together.
// Full      a full pool refuses; IntegrateStats counts it.
// Thread    of the map's writer; `crew` searches, the caller creates. No allocation after the
//           constructor.
#pragma once

#include <cstddef>
#include <memory>

#include "perception/tsdf/blocks/chunk_directory.hpp"
#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"
#include "perception/tsdf/integrate/integrate_stats.hpp"
#include "perception/tsdf/integrate/kept_volume.hpp"
#include "perception/tsdf/pager/pager.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

struct AllocateScratch;
struct BandJob;  // band_kernel.hpp

class BlockAllocator {
 public:
  // All of them belong to the map and must outlive this object.
  BlockAllocator(rt::NonRealtime&, MapStore&, Pager&, const KeptVolume&, const DepthPyramid&);
  ~BlockAllocator();
  BlockAllocator(const BlockAllocator&) = delete;
  BlockAllocator& operator=(const BlockAllocator&) = delete;

  // For the image in the pyramid: every pixel_step-th pixel of every pixel_step-th row.
  void allocate_band(const FrameCamera& view, int pixel_step, rt::ForkJoin& crew,
                     IntegrateStats&) noexcept;
  // Makes the chunk, or brings it back; nullptr: pool full.
  [[nodiscard]] MapLayout::Chunk* chunk_for(int cx, int cy, int cz, IntegrateStats&) noexcept;
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  // Makes the block exist. `near` is a chunk to try first (or null); returns the one to try next.
  MapLayout::Chunk* touch_block(int bx, int by, int bz, MapLayout::Chunk* near,
                                IntegrateStats&) noexcept;
  [[nodiscard]] BandJob job_of(const FrameCamera& view) noexcept;
  void find_in_band(const Intrinsics& k, const BandJob&, int pixel_step, int skip,
                    int band) noexcept;

  MapStore& store_;
  Pager& pager_;
  const KeptVolume& volume_;
  const DepthPyramid& pyramid_;
  ChunkDirectory directory_;  // round the camera of the frame being fused
  std::unique_ptr<AllocateScratch> scratch_;
};

}  // namespace perception

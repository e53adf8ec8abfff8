// Fuses one frame into the map: prepare the image, allocate the band, follow slowly moving
// surfaces, update the blocks in view, carve free space.
//
// Distance  projective: along the viewing ray, (depth - z) * |ray|, so |grad| need not be 1.
// Band      the truncation along the ray; at grazing angles up to three times that, with the
//           distance clipped to it, so that 2.5 voxels across the surface are known on either side.
// Thread    of the map's writer, with a crew; the same bytes for any number of threads. No
//           allocation after the constructor.
#pragma once

#include <cstddef>
#include <cstdint>

#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/blocks/update_camera.hpp"
#include "perception/tsdf/blocks/viewed_blocks.hpp"
#include "perception/tsdf/follow/follow.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"
#include "perception/tsdf/integrate/block_allocator.hpp"
#include "perception/tsdf/integrate/free_space.hpp"
#include "perception/tsdf/integrate/integrate_stats.hpp"
#include "perception/tsdf/integrate/kept_volume.hpp"
#include "perception/tsdf/pager/pager.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

class Integrator {
 public:
  // All of them belong to the map and must outlive this object.
  Integrator(rt::NonRealtime&, MapStore&, Pager&, ViewedBlocks&);

  // See TsdfMap::integrate().
  IntegrateStats integrate(const FrameView& frame, const Pose& X_WC, int pixel_step) noexcept;
  void clear() noexcept { volume_.clear(); }

  void use(rt::ForkJoin& crew) noexcept { crew_ = &crew; }
  void profile(bool on) noexcept { profiling_ = on; }
  [[nodiscard]] const IntegrateTimes& last_times() const noexcept { return times_; }
  // Of the last image.
  [[nodiscard]] const DepthPyramid& pyramid() const noexcept { return pyramid_; }
  [[nodiscard]] std::size_t memory_bytes() const noexcept {  // held beside the object itself
    return pyramid_.memory_bytes() + allocator_.memory_bytes() + carver_.memory_bytes() +
           follower_.memory_bytes();
  }

 private:
  void follow(const FrameCamera&, IntegrateStats&) noexcept;
  void update_blocks(const FrameCamera&, IntegrateStats&) noexcept;
  // Lists the blocks whose band the image may show; returns their number.
  int find_in_view(const FrameCamera&) noexcept;
  void update_range(const FrameCamera&, const UpdateCamera&, int first, int last,
                    IntegrateStats&) noexcept;

  MapStore& store_;
  Pager& pager_;
  ViewedBlocks& viewed_;
  std::uint32_t frame_ = 0;  // of integrate()
  DepthPyramid pyramid_;
  KeptVolume volume_;
  BlockAllocator allocator_;
  SurfaceFollower follower_;
  FreeSpaceCarver carver_;
  bool range_weight_, profiling_ = false;
  IntegrateTimes times_;
  rt::ForkJoin* crew_ = &rt::serial();
};

}  // namespace perception

// The fused scene: a sparse truncated signed distance field (Curless and Levoy 1996; Newcombe et
// al., KinectFusion, 2011; Niessner et al., voxel hashing, 2013), with colour, labels and free
// space.
//
// TsdfMap owns the parts and calls them in order:
//
//   blocks/     what is stored: layout of grid, voxel and chunk; pools of blocks and of labels;
//               what readers see (MapView)
//   image/      the frame: depth pyramid, camera, boxes in its image
//   kernels/    the inner loops of update and votes, one block at a time
//   integrate/  a frame into the map: allocation, update, free space; decay
//   follow/     surfaces that move slowly
//   labels/     label images into the map
//   pager/      what is far, compressed; records for files
//   mesh/, patch/  readers: the surface as triangles, the window that is touched
//
// Blocks    allocated only where a ray passes through its band.
// Free      a node is seen free when a ray passed in front of its reading there: one bit a node in
//           blocks, one bit per 2^3 nodes where no block is. Free is not unknown.
// Memory    everything is allocated and touched in the constructor. A full pool loses nothing that
//           is stored: new blocks are refused and counted.
// Far       chunks farther than far_m from the camera can be compressed and come back on approach:
//           page(). Readers see only what is in the pool; integrate() first restores what its
//           camera sees.
// Volume    with volume_m the map is limited to a cube of whole blocks (integrate/kept_volume.hpp).
// Decay     with decay_half_life_s, what is not seen again loses weight and becomes unknown.
// Order     every result is a function of the sequence of calls: same input, same bytes.
// Thread    one thread changes the map; any number may read between two changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/image.hpp"
#include "perception/geometry/pose.hpp"
#include "perception/geometry/rgbd_frame.hpp"
#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/blocks/map_view.hpp"
#include "perception/tsdf/blocks/viewed_blocks.hpp"
#include "perception/tsdf/image/frame_view.hpp"
#include "perception/tsdf/integrate/decay.hpp"
#include "perception/tsdf/integrate/integrator.hpp"
#include "perception/tsdf/labels/label_votes.hpp"
#include "perception/tsdf/pager/map_records.hpp"
#include "perception/tsdf/pager/pager.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/sched/fork_join.hpp"

namespace perception {

// Read as a MapView.
class TsdfMap : public MapView {
 public:
  // Throws std::invalid_argument naming the key, value and range.
  TsdfMap(rt::NonRealtime&, const TsdfConfig&);
  TsdfMap(const TsdfMap&) = delete;
  TsdfMap& operator=(const TsdfMap&) = delete;

  // Fuses one frame. pixel_step (1, 2, 4, 8) thins the rays that allocate; all voxels of the
  // blocks in view are always updated. X_WC: camera (optical frame) in the world, rigid.
  IntegrateStats integrate(const FrameView& frame, const Pose& X_WC, int pixel_step) noexcept {
    return integrator_.integrate(frame, X_WC, pixel_step);
  }

  // The label image of the frame that was last integrated, same pixels, votes: 0 background, 1 ..
  // kMostLabel an object, anything else says nothing. Once a frame. `fresh`: see vote_at().
  LabelStats vote_labels(ImageView<const std::uint8_t> labels, std::uint8_t fresh = 0) noexcept {
    return voter_.vote(labels, fresh);
  }

  // Threads that take part in integrate(); the bytes are the same for any number.
  void use(rt::ForkJoin& crew) noexcept { integrator_.use(crew); }
  void profile(bool on) noexcept { integrator_.profile(on); }
  [[nodiscard]] const IntegrateTimes& last_times() const noexcept {
    return integrator_.last_times();
  }

  // Forgets everything; map_id() changes.
  void clear() noexcept;
  // Voxels, colour, labels and free space of the nodes in the closed box become unknown; blocks
  // left without any weight go back to the pool. What is put away and reaches into the box comes
  // back for it; without room in the pool it is forgotten whole.
  void clear_region(const Eigen::AlignedBox3d& box_W) noexcept;
  // Once a frame, dt_s after the one before: every weight falls with decay_half_life_s, a
  // kDecayRound-th of the blocks a call. A voxel below a quarter observation becomes unknown.
  static constexpr int kDecayRound = WeightDecay::kRound;
  void decay(double dt_s) noexcept { decay_.step(dt_s); }

  // Sets the labels of a block; without any label > 0 it holds none afterwards. False: pool full.
  bool store_labels(std::int32_t block, std::span<const LabelVoxel> labels) noexcept {
    return store_.labels.store(block, labels);
  }
  // Every voxel of this label becomes unlabelled.
  void forget_label(std::uint8_t label) noexcept;

  // --- far from the camera: see Pager
  PageStats page(std::span<const Vec3> anchors_W, int block_budget) noexcept {
    return pager_.page(anchors_W, block_budget);
  }
  PageStats fetch_view(const Intrinsics& k, const Pose& X_WC, int block_budget) noexcept {
    return pager_.fetch_view(k, X_WC, block_budget);
  }
  [[nodiscard]] int far_block_count() const noexcept { return far_store().blocks(); }
  [[nodiscard]] int far_chunk_count() const noexcept { return far_store().size(); }
  [[nodiscard]] const FarStore& far_store() const noexcept { return pager_.far_store(); }

  // --- whole chunks as records, for map files: see pager/map_records.hpp. Not for the frame step.
  using Taken = RecordTaken;
  void write_records(rt::NonRealtime& nrt, const RecordFn& fn) const {
    perception::write_records(nrt, store_, far_store(), fn);
  }
  [[nodiscard]] Taken take_record(rt::NonRealtime& nrt, std::span<const std::uint8_t> record) {
    return perception::take_record(nrt, store_, pager_, record);
  }

  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held, whether in use or not
  // Of all stored words, colours, labels and free bits, in allocation order, and of what is put
  // away.
  [[nodiscard]] std::uint64_t checksum() const noexcept;

 private:
  MapStore store_;
  ViewedBlocks viewed_;
  Pager pager_;
  Integrator integrator_;
  LabelVoter voter_;
  WeightDecay decay_;
};

}  // namespace perception

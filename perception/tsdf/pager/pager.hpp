// Compresses chunks far from the camera without loss (block_codec.hpp) and restores them on
// approach. Readers see only what is in the pools. Nothing that the last image showed is
// compressed.
//
// Frames    W: anchors, boxes, cameras' poses X_WC. Distances in m, to a chunk's nearest point.
// Full      a full pool or store loses nothing that is in it: counted in PageStats.
// Thread    of the map's writer. No allocation after the constructor.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/blocks/viewed_blocks.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"
#include "perception/tsdf/pager/far_store.hpp"
#include "perception/tsdf/pager/page_stats.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

struct BlockImage;  // block_codec.hpp

class Pager {
 public:
  // store and viewed belong to the map and must outlive this object.
  Pager(rt::NonRealtime&, MapStore& store, ViewedBlocks& viewed);
  ~Pager();
  Pager(const Pager&) = delete;
  Pager& operator=(const Pager&) = delete;

  // Once a frame: compresses chunks that lie beyond far_m of every anchor (camera, hand) and out of
  // the last image, and restores chunks that an anchor has come near to. Each of the two stops
  // after about block_budget blocks, at most one chunk more.
  PageStats page(std::span<const Vec3> anchors_W, int block_budget) noexcept;
  // Restores the chunks that this camera can see. If the pool is full it compresses those that are
  // farthest from it and not in view. `waiting` or `refused` tell that something is still missing.
  PageStats fetch_view(const Intrinsics& k, const Pose& X_WC, int block_budget) noexcept;
  // Restores the chunks that these boxes see as far as the pool has room, and adds to the counts.
  // evict: as in fetch_view().
  void fetch_boxes(const CameraBoxes& boxes, const Vec3& centre_W, int budget, bool evict,
                   PageStats& stats) noexcept;
  enum class Held : std::uint8_t { kNo, kBack, kNoRoom };
  // The chunk, if it was put away, is brought back. kNo: it was not.
  Held bring(int cx, int cy, int cz, PageStats& stats) noexcept;
  // Restores the chunks that reach into the box, so that it can be cleared. Those wholly inside,
  // and those without room, are forgotten.
  void clear_region(const Eigen::AlignedBox3d& box_W) noexcept;
  // Compressed chunks forget this label when they are restored, even if its number belongs to
  // another object by then.
  void forget_label(std::uint8_t label) noexcept;
  void clear() noexcept { far_.clear(); }

  // Adds a chunk that is nowhere yet: to the pools, or beyond them to the far store. False: no room
  // for it, nothing changed. bytes: its record, checked; about: what it says of itself.
  [[nodiscard]] bool admit(const FarStore::Record& about,
                           std::span<const std::uint8_t> bytes) noexcept;
  [[nodiscard]] const FarStore& far_store() const noexcept { return far_; }
  [[nodiscard]] BlockImage& image() noexcept { return *unpacked_; }  // room for one block
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  [[nodiscard]] bool fits(const FarStore::Record& r) const noexcept {
    return store_.blocks.has_room(r.blocks);
  }
  [[nodiscard]] bool put_away(std::int32_t number) noexcept;
  // Of a record that fits.
  void bring_back(std::int32_t record, PageStats& stats) noexcept;
  // Compresses chunks that are farthest from `centre_W` and not in view, until the record fits.
  bool make_room(const FarStore::Record& r, const CameraBoxes& boxes, const Vec3& centre_W,
                 PageStats& stats) noexcept;
  [[nodiscard]] bool seen_from(const CameraBoxes& boxes, BlockCoord chunk) const noexcept;
  [[nodiscard]] double distance_to_chunk(const Vec3& p_W, int x, int y, int z) const noexcept;

  MapStore& store_;
  ViewedBlocks& viewed_;
  FarStore far_;
  std::unique_ptr<BlockImage> unpacked_;
};

}  // namespace perception

// The second phase of segmentation: votes of a label image in the map
// (perception/segmentation/label_vote.hpp).
//
// A block without labels gets room for them when the image shows a label in it. The votes that
// background would have cast in the images so far are then derived from the voxel's own
// observations.
// Thread: of the map's writer. No allocation.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "perception/geometry/image.hpp"
#include "perception/tsdf/blocks/map_store.hpp"
#include "perception/tsdf/blocks/viewed_blocks.hpp"
#include "perception/tsdf/image/camera_boxes.hpp"
#include "perception/tsdf/image/depth_pyramid.hpp"

namespace perception {

// Of one vote().
struct LabelStats {
  bool refused = false;  // no frame, or an image of another size: nothing voted
  std::int32_t blocks_voted = 0, blocks_new = 0;
  std::int32_t blocks_refused = 0;  // pool full: what they show stays unlabelled
};

class LabelVoter {
 public:
  // All of them belong to the map and must outlive this object; the pyramid holds the image of the
  // frame that is viewed.
  LabelVoter(MapStore& store, const ViewedBlocks& viewed, const DepthPyramid& pyramid) noexcept
      : store_(store), viewed_(viewed), pyramid_(pyramid) {}

  // See TsdfMap::vote_labels().
  LabelStats vote(ImageView<const std::uint8_t> labels, std::uint8_t fresh) noexcept;

 private:
  void mark_tiles(ImageView<const std::uint8_t> labels) noexcept;
  [[nodiscard]] bool shows_label(std::int32_t block, const CameraBoxes& boxes) const noexcept;

  static constexpr int kTile = 16;  // pixels
  static_assert(DepthPyramid::kMaxWidth <= 64 * kTile);

  MapStore& store_;
  const ViewedBlocks& viewed_;
  const DepthPyramid& pyramid_;
  // Bit u of word v: the tile shows an object.
  std::array<std::uint64_t, (DepthPyramid::kMaxHeight + kTile - 1) / kTile> tiles_{};
};

}  // namespace perception

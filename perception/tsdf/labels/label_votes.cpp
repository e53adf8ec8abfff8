#include "perception/tsdf/labels/label_votes.hpp"

#include <algorithm>
#include <cstring>

#include "perception/tsdf/blocks/update_camera.hpp"
#include "perception/tsdf/kernels/label_kernel.hpp"

namespace perception {

LabelStats LabelVoter::vote(ImageView<const std::uint8_t> labels, std::uint8_t fresh) noexcept {
  LabelStats stats;
  const Intrinsics& k = viewed_.camera();
  if (labels.data == nullptr || labels.width != k.width || labels.height != k.height ||
      viewed_.count() == 0 || fresh > kMostLabel) {
    stats.refused = true;
    return stats;
  }
  mark_tiles(labels);
  const CameraBoxes boxes(k, viewed_.X_CW());
  const UpdateCamera cam = update_camera(store_, pyramid_, k, viewed_.X_CW());
  const LabelImage image{labels.data, labels.stride, fresh, most_label_reach(store_.voxel)};
  std::array<LabelVoxel, MapLayout::kBlockVoxels> work;
  for (int n = 0; n < viewed_.count(); ++n) {
    const std::int32_t b = viewed_.at(n).block;
    const LabelVoxel* held = store_.labels.of(b);
    if (held == nullptr) {
      if (!shows_label(b, boxes)) continue;
      for (std::size_t i = 0; i < work.size(); ++i)
        work[i] = store_.implied_background(store_.blocks.words(b)[i]);
    } else {
      std::copy_n(held, work.size(), work.begin());
    }
    float p0[3];
    first_node_C(viewed_.X_CW(), store_.voxel, store_.blocks.coord(b), p0);
    ++stats.blocks_voted;
    const std::uint32_t bits = vote_block(cam, image, p0, work.data());
    if (held == nullptr && bits == 0) continue;
    if (!store_.labels.store(b, work))
      ++stats.blocks_refused;
    else if (held == nullptr)
      ++stats.blocks_new;
  }
  store_.labels.count_image();
  return stats;
}

// Which tiles of the image show an object.
void LabelVoter::mark_tiles(ImageView<const std::uint8_t> labels) noexcept {
  tiles_.fill(0);
  for (int v = 0; v < labels.height; ++v) {
    const std::uint8_t* row = labels.row(v);
    std::uint64_t tiles = 0;
    for (int u = 0; u < labels.width; u += kTile) {
      const int n = std::min(kTile, labels.width - u);
      bool any = false;
      if (n == kTile) {
        std::uint64_t w[2];
        std::memcpy(w, row + u, sizeof w);
        if ((w[0] | w[1]) == 0) continue;
      }
      for (int i = 0; i < n; ++i) any |= row[u + i] != 0 && row[u + i] <= kMostLabel;
      if (any) tiles |= 1ULL << (u / kTile);
    }
    tiles_[static_cast<std::size_t>(v / kTile)] |= tiles;
  }
}

bool LabelVoter::shows_label(std::int32_t block, const CameraBoxes& boxes) const noexcept {
  const BlockCoord at = store_.blocks.coord(block);
  const BoxView box =
      boxes.view((at.x * 8 + 3.5) * store_.voxel, (at.y * 8 + 3.5) * store_.voxel,
                 (at.z * 8 + 3.5) * store_.voxel, static_cast<float>(3.5 * store_.voxel));
  if (!box.visible) return false;
  const int first = box.u0 / kTile, last = box.u1 / kTile;
  const std::uint64_t row = (~0ULL >> (63 - (last - first))) << first;
  std::uint64_t shown = 0;
  for (int v = box.v0 / kTile; v <= box.v1 / kTile; ++v)
    shown |= tiles_[static_cast<std::size_t>(v)] & row;
  if (shown == 0) return false;
  // Nothing is voted on where all of the block lies in front of the band, or behind it.
  const auto band = static_cast<float>(kLabelBand_m * most_label_reach(store_.voxel)) + 1e-4F;
  const auto range = pyramid_.range(box.u0, box.v0, box.u1, box.v1);
  return static_cast<float>(range.greatest_mm) * 1e-3F + band >= box.z_near &&
         static_cast<float>(range.least_mm) * 1e-3F - band <= box.z_far;
}

}  // namespace perception

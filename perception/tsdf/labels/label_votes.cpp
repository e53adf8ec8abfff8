// The second phase of segmentation: label images into the map, and where the map keeps labels.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "perception/tsdf/image/frame_view.hpp"
#include "perception/tsdf/kernels/label_kernel.hpp"

namespace perception {

LabelStats TsdfMap::vote_labels(ImageView<const std::uint8_t> labels, std::uint8_t fresh) noexcept {
  LabelStats stats;
  const Intrinsics& k = last_camera_;
  if (labels.data == nullptr || labels.width != k.width || labels.height != k.height ||
      in_view_count_ == 0 || fresh > kMostLabel) {
    stats.refused = true;
    return stats;
  }
  mark_tiles(labels);
  const CameraBoxes boxes(k, X_CW_last_);
  const UpdateCamera cam = update_camera(k, X_CW_last_);
  const LabelImage image{labels.data, labels.stride, fresh, most_label_reach(voxel_)};
  std::array<LabelVoxel, kBlockVoxels> work;
  for (int n = 0; n < in_view_count_; ++n) {
    const std::int32_t b = in_view_[static_cast<std::size_t>(n)].block;
    const LabelVoxel* held = block_labels(b);
    if (held == nullptr) {
      if (!shows_label(b, boxes)) continue;
      for (std::size_t i = 0; i < work.size(); ++i) work[i] = implied_background(block_words(b)[i]);
    } else {
      std::copy_n(held, kBlockVoxels, work.begin());
    }
    const BlockCoord at = coords_[static_cast<std::size_t>(b)];
    const Vec3 first_C = X_CW_last_ * (voxel_ * Vec3(8.0 * at.x, 8.0 * at.y, 8.0 * at.z));
    const float p0[3] = {static_cast<float>(first_C.x()), static_cast<float>(first_C.y()),
                         static_cast<float>(first_C.z())};
    ++stats.blocks_voted;
    const std::uint32_t bits = vote_block(cam, image, p0, work.data());
    if (held == nullptr && bits == 0) continue;
    if (!store_labels(b, work))
      ++stats.blocks_refused;
    else if (held == nullptr)
      ++stats.blocks_new;
  }
  // Without an object nobody counts the images, and the next touch begins anew.
  label_images_ = label_blocks_ == 0 ? 0 : std::min<int>(label_images_ + 1, kLabelWeightCap);
  return stats;
}

// Which tiles of the image show an object.
void TsdfMap::mark_tiles(ImageView<const std::uint8_t> labels) noexcept {
  label_tiles_.fill(0);
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
    label_tiles_[static_cast<std::size_t>(v / kTile)] |= tiles;
  }
}

bool TsdfMap::shows_label(std::int32_t block, const CameraBoxes& boxes) const noexcept {
  const BlockCoord at = coords_[static_cast<std::size_t>(block)];
  const BoxView box = boxes.view((at.x * 8 + 3.5) * voxel_, (at.y * 8 + 3.5) * voxel_,
                                 (at.z * 8 + 3.5) * voxel_, static_cast<float>(3.5 * voxel_));
  if (!box.visible) return false;
  const int first = box.u0 / kTile, last = box.u1 / kTile;
  const std::uint64_t row = (~0ULL >> (63 - (last - first))) << first;
  std::uint64_t shown = 0;
  for (int v = box.v0 / kTile; v <= box.v1 / kTile; ++v)
    shown |= label_tiles_[static_cast<std::size_t>(v)] & row;
  if (shown == 0) return false;
  // Nothing is voted on where all of the block lies in front of the band, or behind it.
  const auto band = static_cast<float>(kLabelBand_m * most_label_reach(voxel_)) + 1e-4F;
  const auto range = pyramid_.range(box.u0, box.v0, box.u1, box.v1);
  return static_cast<float>(range.greatest_mm) * 1e-3F + band >= box.z_near &&
         static_cast<float>(range.least_mm) * 1e-3F - band <= box.z_far;
}

bool TsdfMap::store_labels(std::int32_t block, std::span<const LabelVoxel> labels) noexcept {
  if (labels.size() != static_cast<std::size_t>(kBlockVoxels)) return false;
  const std::uint32_t bits = labels_in(labels.data());
  if (bits == 0) {
    release_labels(block);
    return true;
  }
  std::int32_t& at = label_of_block_[static_cast<std::size_t>(block)];
  if (at < 0) {
    if (label_recycled_count_ > 0) {
      at = label_recycled_[static_cast<std::size_t>(--label_recycled_count_)];
    } else if (label_used_ < config_.max_label_blocks) {
      at = label_used_++;
    } else {
      return false;
    }
    block_of_label_[static_cast<std::size_t>(at)] = block;
    ++label_blocks_;
  }
  label_bits_[static_cast<std::size_t>(at)] = bits;
  LabelVoxel* out = label_pool_.data() + static_cast<std::size_t>(at) * kBlockVoxels;
  if (out != labels.data()) std::copy_n(labels.data(), kBlockVoxels, out);
  return true;
}

void TsdfMap::release_labels(std::int32_t block) noexcept {
  std::int32_t& at = label_of_block_[static_cast<std::size_t>(block)];
  if (at < 0) return;
  block_of_label_[static_cast<std::size_t>(at)] = kNoBlock;
  label_recycled_[static_cast<std::size_t>(label_recycled_count_++)] = at;
  --label_blocks_;
  at = kNoBlock;
}

void TsdfMap::forget_label(std::uint8_t label) noexcept {
  if (label == 0 || label > kMostLabel) return;
  // What is put away forgets it when it comes back, also when the number is another object's by then.
  for (std::int32_t r = 0; r < far_.slots(); ++r) far_.at(r).labels &= ~(1U << label);
  for (int n = 0; n < label_used_; ++n) {
    const auto i = static_cast<std::size_t>(n);
    if (block_of_label_[i] == kNoBlock || ((label_bits_[i] >> label) & 1U) == 0) continue;
    LabelVoxel* voxels = label_pool_.data() + i * kBlockVoxels;
    for (int v = 0; v < kBlockVoxels; ++v)
      if (voxels[v].label == label) voxels[v] = {};
    static_cast<void>(store_labels(block_of_label_[i], {voxels, kBlockVoxels}));
  }
}

}  // namespace perception

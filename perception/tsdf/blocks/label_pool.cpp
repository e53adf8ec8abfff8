#include "perception/tsdf/blocks/label_pool.hpp"

#include "perception/tsdf/blocks/held_bytes.hpp"
#include "perception/tsdf/kernels/label_kernel.hpp"

namespace perception {

LabelPool::LabelPool(rt::NonRealtime&, int max_blocks, int max_label_blocks) {
  const auto labelled = static_cast<std::size_t>(max_label_blocks);
  voxels_.assign(labelled * kBlockVoxels, {});
  bits_.assign(labelled, 0);
  block_of_label_.assign(labelled, kNoBlock);
  recycled_.assign(labelled, 0);
  label_of_block_.assign(static_cast<std::size_t>(max_blocks), kNoBlock);
}

std::size_t LabelPool::memory_bytes() const noexcept {
  return held_bytes(voxels_, bits_, label_of_block_, block_of_label_, recycled_);
}

void LabelPool::clear(int blocks) noexcept {
  std::fill_n(label_of_block_.begin(), blocks, kNoBlock);
  std::fill_n(block_of_label_.begin(), used_, kNoBlock);
  used_ = recycled_count_ = live_ = images_ = 0;
}

bool LabelPool::store(std::int32_t block, std::span<const LabelVoxel> labels) noexcept {
  if (labels.size() != static_cast<std::size_t>(kBlockVoxels)) return false;
  const std::uint32_t bits = labels_in(labels.data());
  if (bits == 0) {
    release(block);
    return true;
  }
  std::int32_t& at = label_of_block_[static_cast<std::size_t>(block)];
  if (at < 0) {
    if (recycled_count_ > 0) {
      at = recycled_[static_cast<std::size_t>(--recycled_count_)];
    } else if (static_cast<std::size_t>(used_) < bits_.size()) {
      at = used_++;
    } else {
      return false;
    }
    block_of_label_[static_cast<std::size_t>(at)] = block;
    ++live_;
  }
  bits_[static_cast<std::size_t>(at)] = bits;
  LabelVoxel* out = voxels_.data() + static_cast<std::size_t>(at) * kBlockVoxels;
  if (out != labels.data()) std::copy_n(labels.data(), kBlockVoxels, out);
  return true;
}

void LabelPool::release(std::int32_t block) noexcept {
  std::int32_t& at = label_of_block_[static_cast<std::size_t>(block)];
  if (at < 0) return;
  block_of_label_[static_cast<std::size_t>(at)] = kNoBlock;
  recycled_[static_cast<std::size_t>(recycled_count_++)] = at;
  --live_;
  at = kNoBlock;
}

void LabelPool::forget(std::uint8_t label) noexcept {
  for (int n = 0; n < used_; ++n) {
    const auto i = static_cast<std::size_t>(n);
    if (block_of_label_[i] == kNoBlock || ((bits_[i] >> label) & 1U) == 0) continue;
    LabelVoxel* voxels = voxels_.data() + i * kBlockVoxels;
    for (int v = 0; v < kBlockVoxels; ++v)
      if (voxels[v].label == label) voxels[v] = {};
    static_cast<void>(store(block_of_label_[i], {voxels, kBlockVoxels}));
  }
}

}  // namespace perception

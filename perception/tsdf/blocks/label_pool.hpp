// Where labels are kept: a pool of its own, since only blocks in which something is labelled have
// them.
//
// Label     label and label weight of a voxel (perception/segmentation/label_vote.hpp), 512 a block
//           in the order of its words.
// Memory    all allocated in the constructor. A full pool keeps what is stored; store() reports it.
// Order     by place in this pool, which is the order of the calls: same calls, same order.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "perception/segmentation/label_vote.hpp"
#include "perception/tsdf/blocks/map_layout.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

class LabelPool : public MapLayout {
 public:
  LabelPool(rt::NonRealtime&, int max_blocks, int max_label_blocks);

  // 512 of the block; nullptr where nothing is labelled.
  [[nodiscard]] const LabelVoxel* of(std::int32_t block) const noexcept {
    const std::int32_t at = label_of_block_[static_cast<std::size_t>(block)];
    return at < 0 ? nullptr : voxels_.data() + static_cast<std::size_t>(at) * kBlockVoxels;
  }
  // Callers that change them must store() them afterwards.
  [[nodiscard]] LabelVoxel* of(std::int32_t block) noexcept {
    const std::int32_t at = label_of_block_[static_cast<std::size_t>(block)];
    return at < 0 ? nullptr : voxels_.data() + static_cast<std::size_t>(at) * kBlockVoxels;
  }
  // Bit n: label n > 0 occurs in the block.
  [[nodiscard]] std::uint32_t present(std::int32_t block) const noexcept {
    const std::int32_t at = label_of_block_[static_cast<std::size_t>(block)];
    return at < 0 ? 0U : bits_[static_cast<std::size_t>(at)];
  }
  // Sets the labels of a block; without any label > 0 it holds none afterwards. False: pool full.
  bool store(std::int32_t block, std::span<const LabelVoxel> labels) noexcept;
  void release(std::int32_t block) noexcept;
  // Every voxel of this label, 1 .. kMostLabel, becomes unlabelled.
  void forget(std::uint8_t label) noexcept;
  void clear(int blocks) noexcept;  // indices of blocks that were ever used are below it

  [[nodiscard]] int block_count() const noexcept { return live_; }
  // fn(pool index of the block, bits of its labels), in order of this pool.
  template <class Fn>
  void for_each(Fn&& fn) const {
    for (int n = 0; n < used_; ++n)
      if (block_of_label_[static_cast<std::size_t>(n)] != kNoBlock)
        fn(block_of_label_[static_cast<std::size_t>(n)], bits_[static_cast<std::size_t>(n)]);
  }
  // Label images that voted since something was labelled, up to the cap of the weights.
  [[nodiscard]] int images() const noexcept { return images_; }
  // Counts one more image. Without an object no images are counted, and the next touch starts at 0.
  void count_image() noexcept {
    images_ = live_ == 0 ? 0 : std::min<int>(images_ + 1, kLabelWeightCap);
  }
  [[nodiscard]] std::size_t memory_bytes() const noexcept;  // held beside the object itself

 private:
  std::vector<LabelVoxel> voxels_;
  std::vector<std::uint32_t> bits_;
  std::vector<std::int32_t> label_of_block_, block_of_label_, recycled_;
  int used_ = 0, recycled_count_ = 0, live_ = 0;
  int images_ = 0;
};

}  // namespace perception

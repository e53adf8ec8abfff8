// The frame that was last integrated: which blocks it showed, and from which pose. Used by the
// label votes, and by the pager, which must not compress visible blocks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/geometry/pose.hpp"
#include "rt/memory/non_realtime.hpp"

namespace perception {

class ViewedBlocks {
 public:
  struct InView {
    std::int32_t block;  // pool index
    bool inside;         // every node falls into the image
  };

  ViewedBlocks(rt::NonRealtime&, int max_blocks)
      : blocks_(static_cast<std::size_t>(max_blocks), InView{}) {}

  // 0: there is none.
  [[nodiscard]] int count() const noexcept { return count_; }
  [[nodiscard]] InView at(int n) const noexcept { return blocks_[static_cast<std::size_t>(n)]; }
  // Forgets the blocks, whose indices may be invalid now. The camera stays.
  void forget() noexcept { count_ = 0; }

  // The next frame: set() 0, 1, ..., then tell().
  void set(int n, InView seen) noexcept { blocks_[static_cast<std::size_t>(n)] = seen; }
  void tell(int count, const Intrinsics& camera, const Pose& X_CW) noexcept {
    count_ = count;
    camera_ = camera;
    X_CW_ = X_CW;
  }
  [[nodiscard]] const Intrinsics& camera() const noexcept { return camera_; }
  [[nodiscard]] const Pose& X_CW() const noexcept { return X_CW_; }
  [[nodiscard]] std::size_t memory_bytes() const noexcept {  // held beside the object itself
    return blocks_.capacity() * sizeof(InView);
  }

 private:
  std::vector<InView> blocks_;
  int count_ = 0;
  Intrinsics camera_{};
  Pose X_CW_ = Pose::Identity();
};

}  // namespace perception

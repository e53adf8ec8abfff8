// Averages the outlines of objects over frames. A frame's mask is off by a pixel in places, to
// either side by chance, and voxels are coarser than pixels. So an image keeps the mean of the
// masks so far beside each outline, with exponential forgetting. It is carried into the next frame
// with the surface that it bounds. It moves the outline of a mask by at most one pixel. If mask and
// mean lie farther apart, the object has moved and the mask stays as it is.
//
// Depth of an outline, to carry it: that of the mask's readings next to it, away from depth edges,
// continued with their slope. Frames: W world, C camera (optical). SI.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "perception/tsdf/tsdf_map.hpp"

namespace perception {

class OutlineMemory {
 public:
  static constexpr int kIds = 32;  // 0 is none
  OutlineMemory(int max_width, int max_height);

  // Pixels, inclusive, that hold the mask; u1 < u0: none.
  struct Box {
    int u0, v0, u1, v1;
  };
  // Takes the mask of object `id`, the pixels of `labels` that have that id, and gives it the
  // outline of the mean. `edges` marks readings on depth edges. Does not allocate.
  void settle(const FrameView& frame, const Pose& X_WC, std::uint8_t id, const Box& box,
              const TsdfConfig& edges, ImageView<std::uint8_t> labels) noexcept;
  void forget(std::uint8_t id) noexcept;

 private:
  struct Known {
    int masks = 0;  // in the mean; 0: nothing is known
    Pose X_CW = Pose::Identity();
    Intrinsics k{};
    Box box{};
  };
  static constexpr int kMostBand = 1 << 16;  // pixels; what an outline has beyond stays as it is
  struct Pixel {
    std::int32_t u = 0, v = 0;
    float z_m = 0;     // 0: not known
    float belief = 0;  // 0 to 1
    bool in = false,
         beside = false;  // of the mask; next to a pixel on the other side of its outline
  };
  void find_band(ImageView<const std::uint8_t> labels, std::uint8_t id, const Box& box) noexcept;
  void find_depths(const FrameView& frame, const TsdfConfig& edges) noexcept;
  [[nodiscard]] float continued(const Pixel& p, bool sloped) const noexcept;
  [[nodiscard]] float carried(const Known& known, const Vec3& p_W, std::uint8_t id,
                              float otherwise) const noexcept;
  void believe(Known& known, const Pose& X_WC, std::uint8_t id) noexcept;
  void keep(ImageView<const std::uint8_t> labels, std::uint8_t id, const Box& box) noexcept;
  [[nodiscard]] float held(int u, int v, std::uint8_t id) const noexcept {
    const std::uint16_t h = held_.at(u, v);
    return h >> 8U == id ? static_cast<float>(h & 0xffU) : 0.0F;
  }

  std::array<Known, kIds> known_{};
  Image<std::uint16_t> held_;   // id << 8 | belief, of the frame that known_ says
  std::vector<Pixel> band_;     // both sides of the outline, count_ pixels
  std::vector<float> next_;     // of them
  Image<std::int32_t> number_;  // in band_, from 1; 0 outside of settle()
  int count_ = 0, rim_ = 0;     // rim: pixels of the mask that its outline runs along
};

}  // namespace perception

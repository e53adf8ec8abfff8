// CIELAB (CIE 1976, D65, L 0..100) of sRGB pixels, one plane a channel.
#pragma once

#include <array>
#include <vector>

#include "perception/geometry/image.hpp"
#include "perception/geometry/rgbd_frame.hpp"

namespace perception {

struct Lab {
  float L = 0, a = 0, b = 0;
};

// One colour, in fp64 by the formulas: the reference of the tables.
[[nodiscard]] Lab lab_of(Rgb colour) noexcept;

// The same by tables for `count` pixels in a row.
void lab_row(const Rgb* pixels, int count, float* L, float* a, float* b) noexcept;

class LabImage {
 public:
  LabImage(int max_width, int max_height);
  // Neither allocates; the image must not exceed the constructed size. What a pixel without colour
  // (no_colour.hpp) holds is void.
  void set(ImageView<const Rgb> rgb) noexcept;
  // Half the size, rounded down; each pixel is the mean of those of 2 x 2 that have colour.
  void set_half(ImageView<const Rgb> rgb) noexcept;

  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int height() const noexcept { return height_; }
  [[nodiscard]] const float* plane(int channel) const noexcept { return planes_[channel].data(); }
  [[nodiscard]] float* plane(int channel) noexcept { return planes_[channel].data(); }
  // 1 where there is colour, else 0; nullptr: every pixel has it.
  [[nodiscard]] const float* known() const noexcept { return complete_ ? nullptr : known_.data(); }
  [[nodiscard]] bool coloured(int i) const noexcept {
    return complete_ || known_[static_cast<std::size_t>(i)] != 0;
  }
  [[nodiscard]] Lab at(int i) const noexcept {
    const auto k = static_cast<std::size_t>(i);
    return {planes_[0][k], planes_[1][k], planes_[2][k]};
  }

 private:
  float* lacking(int row) noexcept;
  void half_row_lacking(const Rgb* above, const Rgb* below, int row) noexcept;
  int width_ = 0, height_ = 0;
  bool complete_ = true;
  std::vector<float> known_;
  std::array<std::vector<float>, 3> planes_;
};

}  // namespace perception

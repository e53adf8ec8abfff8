// Pixels on their way into a colour codec and out of it: holes filled, halved, grown, RGB to YCbCr
// 4:2:0 (BT.601, full range) and back. Integers only: the same on every machine.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/rgbd_frame.hpp"

namespace drivers {

// Full: pixels without colour get that of the last one before them that has some, so that none of
// their neighbours changes. Half: the mean of those of 2 x 2 that have colour.
// `out` has the image's size, or half of it rounded up.
void fill_colour(perception::ImageView<const perception::Rgb> image,
                 perception::ImageView<perception::Rgb> out) noexcept;
void halve_colour(perception::ImageView<const perception::Rgb> image,
                  perception::ImageView<perception::Rgb> out) noexcept;
// Bilinear by two: `out` has twice the size, or one row or column less.
void grow_colour(perception::ImageView<const perception::Rgb> in,
                 perception::ImageView<perception::Rgb> out) noexcept;

struct Yuv420 {
  // Rows of y have y_stride bytes, of cb and cr c_stride; width and height are even.
  std::uint8_t *y = nullptr, *cb = nullptr, *cr = nullptr;
  int y_stride = 0, c_stride = 0, width = 0, height = 0;
};
// The planes are the image's size, made even: a last odd row or column is repeated.
void to_yuv420(perception::ImageView<const perception::Rgb> image, const Yuv420& out) noexcept;
void from_yuv420(const Yuv420& in, perception::ImageView<perception::Rgb> image) noexcept;

}  // namespace drivers

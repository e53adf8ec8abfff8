// Method `paper`: a region grows from one seed over colour and place.
//
//   d(x) = |I(x) - I(S)| + (m / g) |P(x) - P(S)|
//
// I in CIELAB; P the point in the camera frame in mm (g in mm), or the pixel (g in pixels) where
// there is no depth; I(S), P(S) means over the region so far. 4-neighbours, the nearest first,
// added while d <= threshold. A waiting pixel's d is brought up to date when it comes first, and
// every one's before growing ends, so no pixel joins that the means of the moment refuse, and none
// next to the region is left out that they accept; equal d goes by pixel index. With depth, pixels
// without colour (no_colour.hpp) join by place alone, and I(S) is the mean of those that have one;
// without depth black is a colour like any other, for there is nothing else to go by. Same input,
// same bytes.
#pragma once

#include <cstdint>
#include <vector>

#include "perception/geometry/camera_model.hpp"
#include "perception/segmentation/lab.hpp"

namespace perception {

struct GrowConfig {
  float m = 10;               // weight of place against colour, 1..20
  float g_mm = 60;            // with depth
  float g_px = 20;            // without
  float threshold = 40;       // largest d that joins, with depth
  float threshold_flat = 40;  // without
};

// Points of a depth image in the camera frame, mm; z = 0 where there is no reading.
class PointImage {
 public:
  PointImage(int max_width, int max_height);
  // Depth in units of `mm_per_unit`; 0 and 65535 are no reading. Does not allocate.
  void set(ImageView<const std::uint16_t> depth, const Intrinsics& k, float mm_per_unit) noexcept;
  [[nodiscard]] const float* x_mm() const noexcept { return x_.data(); }
  [[nodiscard]] const float* y_mm() const noexcept { return y_.data(); }
  [[nodiscard]] const float* z_mm() const noexcept { return z_.data(); }

 private:
  std::vector<float> x_, y_, z_;
};

class RegionGrower {
 public:
  RegionGrower(int max_width, int max_height);

  // Grows from `seed` (pixel index). With `points` only pixels with a reading join, and a seed
  // without one takes the place of the nearest pixel that has it. Returns the number of pixels; 0
  // when there is no reading at all. Does not allocate.
  [[nodiscard]] int grow(const LabImage& lab, const PointImage* points, int seed,
                         const GrowConfig& config) noexcept;

  // Of the last grow(): members in the order they joined, and d at joining for each.
  [[nodiscard]] const std::vector<std::int32_t>& members() const noexcept { return members_; }
  [[nodiscard]] const std::vector<float>& distances() const noexcept { return distances_; }

 private:
  struct Waiting {
    float d;
    std::int32_t i;
    bool operator<(const Waiting& o) const noexcept {  // the heap's first is the nearest
      return d != o.d ? d > o.d : i > o.i;
    }
  };
  struct Mean {
    double L = 0, a = 0, b = 0, x = 0, y = 0, z = 0, n = 0, coloured = 0;
  };
  [[nodiscard]] bool coloured(int i) const noexcept {
    return points_ == nullptr || lab_->coloured(i);
  }
  void place(int i, double p[3]) const noexcept;
  [[nodiscard]] float distance(int i) const noexcept;
  void join(int i, float d) noexcept;
  void reach(int i) noexcept;
  void refresh() noexcept;
  void join_nearest(float threshold) noexcept;

  const LabImage* lab_ = nullptr;
  const PointImage* points_ = nullptr;
  int width_ = 0, size_ = 0, seed_ = 0, seed_place_ = 0;
  double beta_ = 0;
  Mean mean_;
  std::vector<Waiting> heap_;
  std::vector<std::uint8_t> seen_;
  std::vector<std::int32_t> members_;
  std::vector<float> distances_;
};

// Index of the pixel nearest to `i` with a reading; -1 when there is none.
[[nodiscard]] int nearest_reading(const float* z_mm, int width, int height, int i) noexcept;

}  // namespace perception

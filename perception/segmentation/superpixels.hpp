// Superpixels by the distance of the touch method: d = |I(x) - I(S)| + beta |P(x) - P(S)|, beta = m/g
// with g the spacing of the seeds, by k-means within windows of 2 g (after SLIC: Achanta et al.,
// PAMI 2012, whose distance is a root of squares instead). Fixed order: same image, same bytes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "perception/geometry/image.hpp"

namespace perception {

struct SuperpixelConfig {
  int spacing_px = 10;     // g
  float compactness = 10;  // m, in the unit of the planes
  int iterations = 5;
  int reach_divisor = 3;    // a seed is tried up to g + g / this away
  float min_share = 0.25F;  // of g^2: a smaller piece joins its neighbour
};

class Superpixels {
 public:
  Superpixels(int max_width, int max_height);

  // Planes of width x height (Lab, and any further one in its scale). Afterwards labels() are
  // 0..count()-1 in raster order of each one's first pixel, each one 4-connected. Does not
  // allocate. known: 0 where the first three planes say nothing, else 1; nullptr: they say
  // something everywhere.
  void run(std::span<const float* const> planes, int width, int height,
           const SuperpixelConfig& config, const float* known = nullptr) noexcept;

  [[nodiscard]] int count() const noexcept { return count_; }
  [[nodiscard]] const std::vector<std::int32_t>& labels() const noexcept { return labels_; }
  static constexpr int kMaxPlanes = 4;

 private:
  struct Seed {
    float plane[kMaxPlanes] = {0, 0, 0, 0};
    float u = 0, v = 0, known = 1;
  };
  void place_seeds(std::span<const float* const> planes, const SuperpixelConfig& config) noexcept;
  void assign(std::span<const float* const> planes, const SuperpixelConfig& config) noexcept;
  void move_seeds(std::span<const float* const> planes) noexcept;
  void connect(std::span<const float* const> planes, int min_pixels) noexcept;

  int width_ = 0, height_ = 0, count_ = 0, seeds_used_ = 0;
  const float* known_ = nullptr;  // during run()
  std::vector<Seed> seeds_;
  std::vector<double> sums_;
  std::vector<float> best_;
  std::vector<std::int32_t> nearest_, labels_, queue_;
};

}  // namespace perception

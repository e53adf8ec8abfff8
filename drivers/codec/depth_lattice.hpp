// The lattice on which depths are coded: its points lie one eighth of the sensor's noise sigma(z)
// apart, so that a step of so many points is the same share of the noise at every depth.
//
//   to_point(z)  = 1 + round(sum over mm below z of 8 / sigma(mm)), 0 for z = 0
//   to_mm(p)     the depth in mm that lies nearest to the point; 0 for p = 0
//
// Built once, in integers (sigma in 1/1024 mm, the sum in 1/2^20): the same on every machine.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "drivers/codec/depth_stream.hpp"
#include "rt/memory/non_realtime.hpp"

namespace drivers::codec {

// Points a sigma.
inline constexpr int kPointsPerSigma = 8;

// sigma in 1/1024 mm of the law at depth_mm.
[[nodiscard]] std::int64_t sigma_1024th_mm(DepthNoiseLaw law, int depth_mm) noexcept;

// Most that a value shown in quiet may lie off a reading of depth_mm: further, and it would fly
// between two surfaces.
[[nodiscard]] int most_quiet_mm(DepthNoiseLaw law, int depth_mm) noexcept;

class DepthLattice {
 public:
  // 0.2 MB: built at set-up, then read only.
  DepthLattice(rt::NonRealtime&, DepthNoiseLaw law);
  [[nodiscard]] std::uint16_t to_point(std::uint16_t depth_mm) const noexcept {
    return to_point_[depth_mm];
  }
  // point in [0, points()).
  [[nodiscard]] std::uint16_t to_mm(int point) const noexcept {
    return to_mm_[static_cast<std::size_t>(point)];
  }
  // Number of points, that of "no reading" included.
  [[nodiscard]] int points() const noexcept { return static_cast<int>(to_mm_.size()); }
  [[nodiscard]] const std::uint16_t* mm_table() const noexcept { return to_mm_.data(); }

 private:
  std::vector<std::uint16_t> to_point_;  // 65536
  std::vector<std::uint16_t> to_mm_;
};

}  // namespace drivers::codec

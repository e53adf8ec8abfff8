#include "drivers/codec/depth_lattice.hpp"

#include <algorithm>

namespace drivers::codec {

namespace {

constexpr int kDepths = 65536;
constexpr int kLatticeFraction = 20;  // bits of the running sum behind the point

}  // namespace

std::int64_t sigma_1024th_mm(DepthNoiseLaw law, int depth_mm) noexcept {
  const std::int64_t z = depth_mm;
  if (law == DepthNoiseLaw::kLenient) return 1536 + 2048 * z * z / 1'000'000;
  // 1.5 - 0.5 z + 0.3 z^2, z in m, never below 1.2 mm.
  const std::int64_t s = 1536 - 512 * z / 1000 + 3072 * z * z / 10'000'000;
  return std::max<std::int64_t>(s, 1229);
}

int most_quiet_mm(DepthNoiseLaw law, int depth_mm) noexcept {
  return static_cast<int>(
      std::max<std::int64_t>(kQuietBoundMm, 5 * sigma_1024th_mm(law, depth_mm) / 1024));
}

DepthLattice::DepthLattice(rt::NonRealtime&, DepthNoiseLaw law) {
  to_point_.resize(kDepths);
  std::int64_t sum = 0;  // points below the depth, in 1/2^kLatticeFraction
  for (int z = 1; z < kDepths; ++z) {
    sum += (std::int64_t{kPointsPerSigma * 1024} << kLatticeFraction) / sigma_1024th_mm(law, z);
    to_point_[static_cast<std::size_t>(z)] = static_cast<std::uint16_t>(
        1 + ((sum + (std::int64_t{1} << (kLatticeFraction - 1))) >> kLatticeFraction));
  }
  // A point that stands for depths takes the middle of them; one between, the nearest of its
  // neighbours.
  to_mm_.assign(static_cast<std::size_t>(to_point_.back()) + 1, 0);
  std::size_t before = 0;
  for (int first = 1; first < kDepths;) {
    const std::size_t point = to_point_[static_cast<std::size_t>(first)];
    int last = first;
    while (last + 1 < kDepths && to_point_[static_cast<std::size_t>(last + 1)] == point) ++last;
    to_mm_[point] = static_cast<std::uint16_t>((first + last) / 2);
    for (std::size_t p = before + 1; p < point; ++p) {
      to_mm_[p] = before > 0 && p - before <= point - p ? to_mm_[before] : to_mm_[point];
    }
    before = point;
    first = last + 1;
  }
}

}  // namespace drivers::codec

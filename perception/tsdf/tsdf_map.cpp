#include "perception/tsdf/tsdf_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "rt/hash.hpp"

namespace perception {

TsdfMap::TsdfMap(rt::NonRealtime& nrt, const TsdfConfig& config)
    : MapView(store_),  // only where it is
      store_(nrt, config),
      viewed_(nrt, config.max_blocks),
      pager_(nrt, store_, viewed_),
      integrator_(nrt, store_, pager_, viewed_),
      voter_(store_, viewed_, integrator_.pyramid()),
      decay_(store_, viewed_) {}

std::size_t TsdfMap::memory_bytes() const noexcept {
  return sizeof *this + store_.memory_bytes() + viewed_.memory_bytes() + pager_.memory_bytes() +
         integrator_.memory_bytes();
}

void TsdfMap::clear() noexcept {
  store_.clear();
  pager_.clear();
  decay_.clear();
  integrator_.clear();
  viewed_.forget();
}

void TsdfMap::clear_region(const Eigen::AlignedBox3d& box_W) noexcept {
  store_.blocks.next_revision();
  viewed_.forget();  // blocks may go
  if (box_W.isEmpty() || !box_W.min().allFinite() || !box_W.max().allFinite()) return;
  std::array<int, 3> lo{}, hi{};  // first and last node inside
  for (std::size_t a = 0; a < 3; ++a) {
    const auto i = static_cast<Eigen::Index>(a);
    constexpr double kLimit = 8.0 * kMaxBlockCoord;
    lo[a] = static_cast<int>(std::ceil(std::clamp(box_W.min()(i) / store_.voxel, -kLimit, kLimit)));
    hi[a] =
        static_cast<int>(std::floor(std::clamp(box_W.max()(i) / store_.voxel, -kLimit, kLimit)));
    if (lo[a] > hi[a]) return;
  }
  pager_.clear_region(box_W);
  store_.clear_nodes(lo, hi);
}

void TsdfMap::forget_label(std::uint8_t label) noexcept {
  if (label == 0 || label > kMostLabel) return;
  pager_.forget_label(label);
  store_.labels.forget(label);
}

std::uint64_t TsdfMap::checksum() const noexcept {
  rt::Hash64 h;
  store_.add_to(h);
  far_store().add_to(h);
  return h.digest();
}

}  // namespace perception

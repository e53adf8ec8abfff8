#include "perception/motion/place_memory.hpp"

#include <algorithm>
#include <cmath>

#include "perception/motion/agree_kernel.hpp"

namespace perception::motion {

namespace {

// chosen on: not recorded; judged on: moving 606, moving 707
constexpr std::uint32_t kRestGap = 5;  // frames that a cell may go unseen
constexpr std::uint32_t kProbes = 4;   // of the table of places

}  // namespace

PlaceMemory::PlaceMemory(double cell_m)
    : cell_m_(cell_m), places_(kPlaceSlots), taken_(kPlaceSlots / 32) {}

void PlaceMemory::forget() noexcept {
  std::fill(places_.begin(), places_.end(), Place{});
  std::fill(taken_.begin(), taken_.end(), 0U);
}

PlaceMemory::Place* PlaceMemory::find(const Vec3f& p_W, bool make, bool seen) noexcept {
  const auto inv = static_cast<float>(1 / cell_m_);
  const auto x = static_cast<std::int32_t>(std::floor(p_W.x() * inv)),
             y = static_cast<std::int32_t>(std::floor(p_W.y() * inv)),
             z = static_cast<std::int32_t>(std::floor(p_W.z() * inv));
  const std::uint32_t home = place_slot(x, y, z);
  Place* empty = nullptr;
  bool any = false;  // of those that may be of this home
  for (std::uint32_t n = 0; n < kProbes; ++n) {
    Place& r = places_[(home + n) % kPlaceSlots];
    const bool kept = r.last != 0 && r.last + kRestGap >= now_;
    if (kept && r.x == x && r.y == y && r.z == z) {
      if (seen) r.last = now_;
      return &r;
    }
    any = any || kept;
    if (!kept && empty == nullptr) empty = &r;
  }
  std::uint32_t& taken = taken_[home / 32];
  if (!any) taken &= ~(1U << home % 32);
  if (empty == nullptr || !make) return nullptr;
  taken |= 1U << home % 32;
  *empty = {x, y, z, now_, now_};
  return empty;
}

bool PlaceMemory::rested_beside(const Vec3f& p_W, int frames) noexcept {
  const auto half = static_cast<float>(cell_m_ / 2);
  for (int k = 0; k < 6; ++k) {
    Vec3f q_W = p_W;
    q_W[k / 2] += k % 2 == 0 ? half : -half;
    const Place* place = find(q_W, false, false);
    if (place != nullptr && place->age() >= frames) return true;
  }
  return false;
}

}  // namespace perception::motion

#include "perception/body/held_object.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace perception {

bool HeldObject::plausible() const noexcept {
  return X_GO.matrix().allFinite() && half.allFinite() && half.minCoeff() >= 0 &&
         half.maxCoeff() > 0 && half.maxCoeff() <= 1;
}

int capsules_of(const HeldObject& o, std::span<Capsule, kCapsulesOfHeld> out) noexcept {
  if (o.kind == HeldObject::Kind::kCapsule) {
    out[0] = {o.X_GO * Vec3(0, 0, -o.half.z()), o.X_GO * Vec3(0, 0, o.half.z()), o.half.x()};
    return 1;
  }
  std::array<int, 3> axis{0, 1, 2};  // longest first
  std::sort(axis.begin(), axis.end(), [&o](int a, int b) { return o.half(a) > o.half(b); });
  const double longest = o.half(axis[0]), wide = o.half(axis[1]), thick = o.half(axis[2]);
  const int n =
      std::clamp(static_cast<int>(std::ceil(wide / std::max(thick, 1e-4))), 1, kCapsulesOfHeld);
  for (int i = 0; i < n; ++i) {
    Vec3 centre = Vec3::Zero(), along = Vec3::Zero();
    centre(axis[1]) = wide * (2.0 * i + 1 - n) / n;
    along(axis[0]) = longest;
    out[static_cast<std::size_t>(i)] = {o.X_GO * Vec3(centre - along),
                                        o.X_GO * Vec3(centre + along), std::hypot(wide / n, thick)};
  }
  return n;
}

}  // namespace perception

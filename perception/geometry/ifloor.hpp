#pragma once

namespace perception {

// floor() for values within int range; std::floor is a library call on baseline x86-64.
[[nodiscard]] inline int ifloor(double x) noexcept {
  const int i = static_cast<int>(x);
  return i - static_cast<int>(static_cast<double>(i) > x);
}

}  // namespace perception

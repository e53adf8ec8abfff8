#pragma once

#include <cstddef>
#include <vector>

namespace perception {

// What vectors hold beside themselves, in use or not.
template <class... T>
[[nodiscard]] std::size_t held_bytes(const std::vector<T>&... v) noexcept {
  // Of the elements, which may be pointers. NOLINTNEXTLINE(bugprone-sizeof-expression)
  return (... + (v.capacity() * sizeof(T)));
}

}  // namespace perception

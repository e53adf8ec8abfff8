// Four floats or integers at once, by the compiler's vector types (SSE2 on x86-64, NEON on
// AArch64). Each lane is an ordinary IEEE operation, so results do not depend on the instruction
// set.
#pragma once

#include <cstdint>

namespace perception {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

[[nodiscard]] inline Float4 splat(float x) noexcept { return Float4{x, x, x, x}; }

// floor of values within int range.
[[nodiscard]] inline Int4 floor4(Float4 x) noexcept {
  const Int4 i = __builtin_convertvector(x, Int4);
  return i + (__builtin_convertvector(i, Float4) > x);
}

[[nodiscard]] inline Float4 to_float(Int4 i) noexcept { return __builtin_convertvector(i, Float4); }

[[nodiscard]] inline bool all_equal(Int4 a, Int4 b) noexcept {
  using Wide = std::uint64_t __attribute__((vector_size(16)));
  const Wide d = reinterpret_cast<Wide>(a ^ b);
  return (d[0] | d[1]) == 0;
}

}  // namespace perception

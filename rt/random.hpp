// Counter-based random numbers: a value is a function of (seed, stream, index) and of nothing else,
// so a run, a fault plan or a planner's sample sequence repeats whatever the timing was.
// Mixing function: SplitMix64 finaliser (Steele, Lea, Flood 2014).
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

namespace rt {

[[nodiscard]] constexpr std::uint64_t mix64(std::uint64_t x) noexcept {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31U);
}

[[nodiscard]] constexpr std::uint64_t mix64(std::uint64_t a, std::uint64_t b) noexcept {
  return mix64(mix64(a) ^ (b + 0x2545f4914f6cdd1dULL));
}

// Satisfies UniformRandomBitGenerator; reproducible on every platform (no std distributions).
class Random {
 public:
  using result_type = std::uint64_t;
  explicit constexpr Random(std::uint64_t seed, std::uint64_t stream = 0) noexcept
      : key_(mix64(seed, stream)) {}

  static constexpr result_type min() noexcept { return 0; }
  static constexpr result_type max() noexcept { return std::numeric_limits<result_type>::max(); }
  constexpr result_type operator()() noexcept { return mix64(key_ + 0x9e3779b97f4a7c15ULL * ++n_); }

  // [0, 1) with 53 bits.
  constexpr double uniform() noexcept { return static_cast<double>((*this)() >> 11U) * 0x1.0p-53; }
  constexpr double uniform(double lo, double hi) noexcept { return lo + (hi - lo) * uniform(); }
  // [lo, hi], both included; bias below 2^-32 for ranges below 2^32.
  constexpr std::int64_t integer(std::int64_t lo, std::int64_t hi) noexcept {
    return lo + static_cast<std::int64_t>((*this)() % (static_cast<std::uint64_t>(hi - lo) + 1));
  }
  // Standard normal by Box-Muller, one value a call.
  double normal() noexcept {
    const double u = 1.0 - uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t key_;
  std::uint64_t n_ = 0;
};

}  // namespace rt

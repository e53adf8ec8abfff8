// A 64-bit running hash for logs and outputs. FNV-1a over 8-byte words with a final mix: stable
// across machines of one byte order, not a defence against an adversary.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "rt/random.hpp"

namespace rt {

class Hash64 {
 public:
  void bytes(const void* data, std::size_t size) noexcept {
    const auto* p = static_cast<const unsigned char*>(data);
    while (size >= 8) {
      std::uint64_t w;
      std::memcpy(&w, p, 8);
      word(w);
      p += 8;
      size -= 8;
    }
    if (size > 0) {
      std::uint64_t w = 0;
      std::memcpy(&w, p, size);
      word(w ^ (static_cast<std::uint64_t>(size) << 56U));
    }
  }
  void word(std::uint64_t w) noexcept {
    state_ = (state_ ^ w) * 0x100000001b3ULL;
    state_ ^= state_ >> 29U;
  }
  // Only types without padding: every byte counts.
  template <class T>
  requires std::has_unique_object_representations_v<T>
  void value(const T& v) noexcept { bytes(&v, sizeof v); }
  void value(double v) noexcept { bytes(&v, sizeof v); }
  void value(float v) noexcept { bytes(&v, sizeof v); }
  [[nodiscard]] std::uint64_t digest() const noexcept { return mix64(state_); }

 private:
  std::uint64_t state_ = 0xcbf29ce484222325ULL;
};

}  // namespace rt

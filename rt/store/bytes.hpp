// Numbers in and out of a byte string, little-endian. The reader never reads past the end: from the
// first wrong length on everything is 0 and good() is false.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace rt {

class ByteWriter {
 public:
  void u64(std::uint64_t v) {
    for (int i = 0; i < 8; ++i) bytes_.push_back(static_cast<std::uint8_t>(v >> (8 * i)));
  }
  void u32(std::uint32_t v) {
    for (int i = 0; i < 4; ++i) bytes_.push_back(static_cast<std::uint8_t>(v >> (8 * i)));
  }
  void i64(std::int64_t v) { u64(static_cast<std::uint64_t>(v)); }
  // Seven bits a byte, low ones first.
  void packed(std::uint64_t v) {
    for (; v >= 0x80; v >>= 7U) bytes_.push_back(static_cast<std::uint8_t>(v | 0x80U));
    bytes_.push_back(static_cast<std::uint8_t>(v));
  }
  void raw(const void* data, std::size_t size) {
    const auto* p = static_cast<const std::uint8_t*>(data);
    bytes_.insert(bytes_.end(), p, p + size);
  }
  [[nodiscard]] std::vector<std::uint8_t>& bytes() noexcept { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) : rest_(bytes) {}
  [[nodiscard]] bool good() const noexcept { return good_; }
  [[nodiscard]] std::size_t left() const noexcept { return rest_.size(); }
  void fail() noexcept {
    good_ = false;
    rest_ = {};
  }
  std::uint64_t u64() noexcept { return number(8); }
  std::uint32_t u32() noexcept { return static_cast<std::uint32_t>(number(4)); }
  std::int64_t i64() noexcept { return static_cast<std::int64_t>(number(8)); }
  std::uint64_t packed() noexcept {
    std::uint64_t v = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      const std::uint64_t byte = number(1);
      if (shift == 63 && byte > 1) break;
      v |= (byte & 0x7fU) << shift;
      if (byte < 0x80) return v;
    }
    fail();
    return 0;
  }
  // A count of things that take at least `each` bytes: more than fit is an error.
  std::size_t count(std::size_t each) noexcept {
    const std::uint64_t n = packed();
    if (n > rest_.size() / each) fail();
    return good_ ? static_cast<std::size_t>(n) : 0;
  }
  bool raw(void* data, std::size_t size) noexcept {
    if (size > rest_.size()) fail();
    if (!good_) return false;
    std::memcpy(data, rest_.data(), size);
    rest_ = rest_.subspan(size);
    return true;
  }
  void skip(std::size_t size) noexcept {
    if (size > rest_.size()) return fail();
    rest_ = rest_.subspan(size);
  }
  std::string text(std::size_t size) {
    std::string s(size <= rest_.size() ? size : 0, '\0');
    if (size > rest_.size()) fail();
    (void)raw(s.data(), s.size());
    return s;
  }

 private:
  std::uint64_t number(std::size_t size) noexcept {
    if (size > rest_.size()) fail();
    if (!good_) return 0;
    std::uint64_t v = 0;
    for (std::size_t i = 0; i < size; ++i) v |= std::uint64_t{rest_[i]} << (8 * i);
    rest_ = rest_.subspan(size);
    return v;
  }
  std::span<const std::uint8_t> rest_;
  bool good_ = true;
};

}  // namespace rt

// A view as it crosses the wire: head and body in one piece, shared by all who wait for it.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "tools/console/console_views.hpp"

namespace teletact {

using ViewBytes = std::shared_ptr<const std::vector<std::uint8_t>>;

// Little-endian, one behind the other.
class ByteWriter {
 public:
  explicit ByteWriter(std::vector<std::uint8_t>& out) : out_(out) {}
  void u8(std::uint8_t v) { out_.push_back(v); }
  void u16(std::uint16_t v) { put(v, 2); }
  void u32(std::uint32_t v) { put(v, 4); }
  void i32(std::int32_t v) { put(static_cast<std::uint32_t>(v), 4); }
  void f32(float v);
  void f64(double v);
  void bytes(std::span<const std::uint8_t> b) { out_.insert(out_.end(), b.begin(), b.end()); }

 private:
  void put(std::uint64_t v, int n) {
    for (int i = 0; i < n; ++i) out_.push_back(static_cast<std::uint8_t>(v >> (8 * i)));
  }
  std::vector<std::uint8_t>& out_;
};

void write_view_head(ViewKind kind, std::uint32_t sequence, const ViewStamp& stamp,
                     std::vector<std::uint8_t>& out);
[[nodiscard]] ViewBytes make_view(ViewKind kind, std::uint32_t sequence, const ViewStamp& stamp,
                                  std::span<const std::uint8_t> body);
[[nodiscard]] inline ViewKind kind_of(const std::vector<std::uint8_t>& view) noexcept {
  return static_cast<ViewKind>(view.front());
}

}  // namespace teletact

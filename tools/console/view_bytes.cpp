#include "tools/console/view_bytes.hpp"

#include <bit>

namespace teletact {

namespace {
constexpr std::uint8_t kViewVersion = 1;
}

void ByteWriter::f32(float v) { put(std::bit_cast<std::uint32_t>(v), 4); }
void ByteWriter::f64(double v) { put(std::bit_cast<std::uint64_t>(v), 8); }

void write_view_head(ViewKind kind, std::uint32_t sequence, const ViewStamp& stamp,
                     std::vector<std::uint8_t>& out) {
  ByteWriter w(out);
  w.u8(static_cast<std::uint8_t>(kind));
  w.u8(kViewVersion);
  w.u16(stamp.flags);
  w.u32(sequence);
  w.f64(stamp.time_s);
  w.f64(stamp.data_s);
}

ViewBytes make_view(ViewKind kind, std::uint32_t sequence, const ViewStamp& stamp,
                    std::span<const std::uint8_t> body) {
  auto bytes = std::make_shared<std::vector<std::uint8_t>>();
  bytes->reserve(kViewHeadBytes + body.size());
  write_view_head(kind, sequence, stamp, *bytes);
  bytes->insert(bytes->end(), body.begin(), body.end());
  return bytes;
}

}  // namespace teletact

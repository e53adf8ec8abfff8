#include "drivers/link/wire.hpp"

#include <array>
#include <concepts>
#include <cstring>
#include <string>

#include "drivers/link/wire_body.hpp"
#include "rt/hash.hpp"

namespace drivers {

namespace {

constexpr std::uint32_t kWireMagic = 0x31544C54;  // "TLT1"

// Table k: what a byte does to the checksum once k more bytes have followed it. An image is summed
// at both ends, so eight bytes go in at once (Kounavis and Berry 2005): one at a time this was a
// fifth of the link's CPU.
constexpr std::size_t kCrcStride = 8;
constexpr std::array<std::array<std::uint32_t, 256>, kCrcStride> make_crc_tables() {
  std::array<std::array<std::uint32_t, 256>, kCrcStride> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t c = i;
    for (int bit = 0; bit < 8; ++bit) c = (c & 1U) != 0 ? 0x82F63B78U ^ (c >> 1U) : c >> 1U;
    tables[0][i] = c;
  }
  for (std::size_t k = 1; k < kCrcStride; ++k) {
    for (std::size_t i = 0; i < 256; ++i) {
      const std::uint32_t c = tables[k - 1][i];
      tables[k][i] = tables[0][c & 0xFFU] ^ (c >> 8U);
    }
  }
  return tables;
}
constexpr auto kCrcTables = make_crc_tables();

template <class M>
std::string schema_of(std::string_view name) {
  std::string text = std::string(name) + ":", between;
  M m;
  rt::for_each_field(m, [&]<class T>(const T&, const auto& list_row) {
    text += between + std::string(list_row.name);
    if constexpr (!std::floating_point<T>) text += std::to_string(sizeof(T));
    between = ",";
  });
  return text + ";";
}

}  // namespace

// Names, sizes (of what is no double) and order of the fields: old and new refuse each other when
// one changes.
std::uint64_t schema_hash(std::string_view pictures) noexcept {
  std::string text = "header:magic4,version2,id2,length4,crc4,seq8,stamp8,schema8;hello:;" +
                     schema_of<ClockRequest>("clock_request") +
                     schema_of<ClockReply>("clock_reply") + "frame:encoded_frame_v3;";
  std::apply(
      [&text]<class... M>(const SchemaRow<M>&... row) { ((text += schema_of<M>(row.name)), ...); },
      kSchema);
  text += "bye:;alive:";
  if (!pictures.empty())
    text += ";" + schema_of<FrameReport>("frame_report") + "pictures:" + std::string(pictures);
  rt::Hash64 h;
  h.bytes(text.data(), text.size());
  return h.digest();
}

const char* to_text(WireStatus s) noexcept {
  switch (s) {
    case WireStatus::kOk:
      return "ok";
    case WireStatus::kIncomplete:
      return "incomplete";
    case WireStatus::kBadMagic:
      return "bad magic";
    case WireStatus::kBadVersion:
      return "other schema version";
    case WireStatus::kBadId:
      return "unknown message id";
    case WireStatus::kTooLong:
      return "body too long";
    case WireStatus::kBadCrc:
      return "bad checksum";
  }
  return "?";
}

std::uint32_t crc32c(std::span<const std::uint8_t> data) noexcept {
  std::uint32_t c = 0xFFFFFFFFU;
  const std::uint8_t *at = data.data(), *const end = at + data.size();
  for (; end - at >= static_cast<std::ptrdiff_t>(kCrcStride); at += kCrcStride) {
    std::uint32_t next = 0;
    for (unsigned i = 0; i < 4; ++i) {
      const std::uint8_t head = static_cast<std::uint8_t>(at[i] ^ (c >> (8 * i)));
      next ^= kCrcTables[kCrcStride - 1 - i][head] ^ kCrcTables[3 - i][at[4 + i]];
    }
    c = next;
  }
  for (; at != end; ++at) c = kCrcTables[0][(c ^ *at) & 0xFFU] ^ (c >> 8U);
  return c ^ 0xFFFFFFFFU;
}

void write_header(const Header& h, std::span<std::uint8_t, kHeaderSize> out) noexcept {
  wire::Writer w{out};
  w.put(kWireMagic);
  w.put(h.version);
  w.put(static_cast<std::uint16_t>(h.id));
  w.put(h.length);
  w.put(h.crc);
  w.put(h.seq);
  w.put(h.stamp_ns);
  w.put(h.schema);
}

WireStatus read_header(std::span<const std::uint8_t> in, Header& out) noexcept {
  if (in.size() < kHeaderSize) return WireStatus::kIncomplete;
  wire::Reader r{in.first(kHeaderSize)};
  std::uint32_t magic = 0;
  std::uint16_t id = 0;
  r.get(magic);
  r.get(out.version);
  r.get(id);
  r.get(out.length);
  r.get(out.crc);
  r.get(out.seq);
  r.get(out.stamp_ns);
  r.get(out.schema);
  if (magic != kWireMagic) return WireStatus::kBadMagic;
  if (id < 1 || id > kMessageIds) return WireStatus::kBadId;
  out.id = static_cast<MessageId>(id);
  // A Hello of another version is still read: the refusal must be able to name both.
  if (out.version != kSchemaVersion && out.id != MessageId::kHello) return WireStatus::kBadVersion;
  if (out.length > (out.id == MessageId::kFrame ? kMaxBody : kMaxControlBody))
    return WireStatus::kTooLong;
  return WireStatus::kOk;
}

std::size_t write_message(Header h, std::span<const std::uint8_t> body,
                          std::span<std::uint8_t> out) noexcept {
  if (out.size() < kHeaderSize + body.size()) return 0;
  h.length = static_cast<std::uint32_t>(body.size());
  h.crc = crc32c(body);
  write_header(h, out.first<kHeaderSize>());
  if (!body.empty()) std::memmove(out.data() + kHeaderSize, body.data(), body.size());
  return kHeaderSize + body.size();
}

std::size_t encode(const RobotState& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
std::size_t encode(const RobotGoal& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
std::size_t encode(const ClockRequest& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
std::size_t encode(const ClockReply& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
std::size_t encode(const FrameReport& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
std::size_t encode(const CommandReport& m, std::span<std::uint8_t> out) noexcept {
  return wire::put_all(m, out);
}
bool decode(std::span<const std::uint8_t> in, RobotState& m) noexcept {
  return wire::get_all(in, m);
}
bool decode(std::span<const std::uint8_t> in, RobotGoal& m) noexcept {
  return wire::get_all(in, m);
}
bool decode(std::span<const std::uint8_t> in, ClockRequest& m) noexcept {
  return wire::get_all(in, m);
}
bool decode(std::span<const std::uint8_t> in, ClockReply& m) noexcept {
  return wire::get_all(in, m) && m.t2_ns >= m.t1_ns;
}
bool decode(std::span<const std::uint8_t> in, FrameReport& m) noexcept {
  return wire::get_all(in, m);
}
bool decode(std::span<const std::uint8_t> in, CommandReport& m) noexcept {
  return wire::get_all(in, m);
}

}  // namespace drivers

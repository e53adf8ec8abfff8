#include "drivers/link/wire.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstring>
#include <string>

#include "rt/hash.hpp"

namespace drivers {

namespace {

constexpr std::uint32_t kWireMagic = 0x31544C54;  // "TLT1"

// Table k: what a byte does to the checksum once k more bytes have followed it. An image is summed at both ends, so
// eight bytes go in at once (Kounavis and Berry 2005): one at a time this was a fifth of the link's CPU.
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

// Appends fields in order; `ok` turns false when the room is used up.
struct Writer {
  std::span<std::uint8_t> out;
  std::size_t at = 0;
  bool ok = true;
  template <class T>
  void put(T v) noexcept {
    if (at + sizeof v > out.size()) {
      ok = false;
      return;
    }
    std::array<std::uint8_t, sizeof v> b;
    std::memcpy(b.data(), &v, sizeof v);
    if constexpr (std::endian::native == std::endian::big) std::reverse(b.begin(), b.end());
    std::memcpy(out.data() + at, b.data(), sizeof v);
    at += sizeof v;
  }
  void field(rt::Time t) noexcept { put(rt::ns_of(t)); }
  template <class T>
  void field(T v) noexcept {
    put(v);
  }
  [[nodiscard]] std::size_t size() const noexcept { return ok ? at : 0; }
};

struct Reader {
  std::span<const std::uint8_t> in;
  std::size_t at = 0;
  bool ok = true;
  template <class T>
  void get(T& v) noexcept {
    if (at + sizeof v > in.size()) {
      ok = false;
      return;
    }
    std::array<std::uint8_t, sizeof v> b;
    std::memcpy(b.data(), in.data() + at, sizeof v);
    if constexpr (std::endian::native == std::endian::big) std::reverse(b.begin(), b.end());
    std::memcpy(&v, b.data(), sizeof v);
    at += sizeof v;
  }
  // A number of the physical world: finite and below anything a robot can mean.
  void field(double& v, const auto&) noexcept {
    get(v);
    if (!std::isfinite(v) || std::abs(v) > 1e6) ok = false;
  }
  void field(std::int64_t& ns, const auto&) noexcept {
    get(ns);
    if (!plausible_instant(ns)) ok = false;
  }
  void field(rt::Time& t, const auto& list_row) noexcept {
    std::int64_t ns = 0;
    field(ns, list_row);
    t = rt::time_from_ns(ns);
  }
  template <std::unsigned_integral T>
  void field(T& v, const auto& list_row) noexcept {
    get(v);
    if (list_row.most != 0 && v > list_row.most) ok = false;
  }
  [[nodiscard]] bool done() const noexcept { return ok && at == in.size(); }
};

template <class M>
std::size_t put_all(const M& m, std::span<std::uint8_t> out) noexcept {
  Writer w{out};
  rt::for_each_field(m, [&](const auto& v, const auto&) { w.field(v); });
  return w.size();
}

template <class M>
bool get_all(std::span<const std::uint8_t> in, M& m) noexcept {
  Reader r{in};
  rt::for_each_field(m, [&](auto& v, const auto& list_row) { r.field(v, list_row); });
  return r.done();
}

template <class M>
std::string schema_of(const char* name) {
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

// Names, sizes (of what is no double) and order of the fields: old and new refuse each other when one changes.
std::uint64_t schema_hash(std::string_view pictures) noexcept {
  std::string text = "header:magic4,version2,id2,length4,crc4,seq8,stamp8,schema8;hello:;" +
                     schema_of<ClockRequest>("clock_request") +
                     schema_of<ClockReply>("clock_reply") + "frame:encoded_frame_v3;" +
                     schema_of<RobotState>("robot_state") + schema_of<RobotGoal>("robot_goal") +
                     schema_of<CommandReport>("command_report") + "bye:;alive:";
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
  Writer w{out};
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
  Reader r{in.first(kHeaderSize)};
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
  return put_all(m, out);
}
std::size_t encode(const RobotGoal& m, std::span<std::uint8_t> out) noexcept {
  return put_all(m, out);
}
std::size_t encode(const ClockRequest& m, std::span<std::uint8_t> out) noexcept {
  return put_all(m, out);
}
std::size_t encode(const ClockReply& m, std::span<std::uint8_t> out) noexcept {
  return put_all(m, out);
}
std::size_t encode(const FrameReport& m, std::span<std::uint8_t> out) noexcept {
  return put_all(m, out);
}
std::size_t encode(const CommandReport& m, std::span<std::uint8_t> out) noexcept {
  return put_all(m, out);
}
bool decode(std::span<const std::uint8_t> in, RobotState& m) noexcept { return get_all(in, m); }
bool decode(std::span<const std::uint8_t> in, RobotGoal& m) noexcept { return get_all(in, m); }
bool decode(std::span<const std::uint8_t> in, ClockRequest& m) noexcept { return get_all(in, m); }
bool decode(std::span<const std::uint8_t> in, ClockReply& m) noexcept {
  return get_all(in, m) && m.t2_ns >= m.t1_ns;
}
bool decode(std::span<const std::uint8_t> in, FrameReport& m) noexcept { return get_all(in, m); }
bool decode(std::span<const std::uint8_t> in, CommandReport& m) noexcept { return get_all(in, m); }

}  // namespace drivers

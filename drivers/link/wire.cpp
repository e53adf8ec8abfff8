#include "drivers/link/wire.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <string_view>

#include "rt/hash.hpp"

namespace drivers {

namespace {

constexpr std::uint32_t kMagic = 0x31544C54;  // "TLT1"

// One line a message: a change of any field changes the hash, and old and new refuse each other.
constexpr std::string_view kSchema =
    "header:magic4,version2,id2,length4,crc4,seq8,stamp8,schema8;"
    "hello:;clock_request:t0i8;clock_reply:t0i8,t1i8,t2i8;frame:encoded_frame_v2;"
    "robot_state:seq8,taken8,x,y,yaw,vx,vy,wz,cmd_vx,cmd_vy,cmd_wz,goal_seq8,mode1,moving1,fault2;"
    "robot_goal:seq8,made8,valid_until8,x,y,yaw,vx,vy,wz,speed_limit,engaged1,operator_engaged1,"
    "operator_clear1,path_seq8;"
    "bye:;alive:";

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
  void finite(double& v) noexcept {
    get(v);
    if (!std::isfinite(v) || std::abs(v) > 1e6) ok = false;
  }
  void instant(std::int64_t& ns) noexcept {
    get(ns);
    if (!plausible_instant(ns)) ok = false;
  }
  void time(rt::Time& t) noexcept {
    std::int64_t ns = 0;
    instant(ns);
    t = rt::time_from_ns(ns);
  }
  [[nodiscard]] bool done() const noexcept { return ok && at == in.size(); }
};

}  // namespace

std::uint64_t schema_hash() noexcept {
  rt::Hash64 h;
  h.bytes(kSchema.data(), kSchema.size());
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
  w.put(kMagic);
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
  if (magic != kMagic) return WireStatus::kBadMagic;
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
  Writer w{out};
  w.put(m.seq);
  w.put(rt::ns_of(m.taken));
  for (const double v : {m.x_m, m.y_m, m.yaw_rad, m.vx, m.vy, m.wz, m.cmd_vx, m.cmd_vy, m.cmd_wz})
    w.put(v);
  w.put(m.goal_seq);
  w.put(m.mode);
  w.put(m.moving);
  w.put(m.fault);
  return w.size();
}

bool decode(std::span<const std::uint8_t> in, RobotState& m) noexcept {
  Reader r{in};
  r.get(m.seq);
  r.time(m.taken);
  for (double* v :
       {&m.x_m, &m.y_m, &m.yaw_rad, &m.vx, &m.vy, &m.wz, &m.cmd_vx, &m.cmd_vy, &m.cmd_wz})
    r.finite(*v);
  r.get(m.goal_seq);
  r.get(m.mode);
  r.get(m.moving);
  r.get(m.fault);
  return r.done() && m.mode <= 4 && m.moving <= 1;
}

std::size_t encode(const RobotGoal& m, std::span<std::uint8_t> out) noexcept {
  Writer w{out};
  w.put(m.seq);
  w.put(rt::ns_of(m.made));
  w.put(rt::ns_of(m.valid_until));
  for (const double v : {m.x_m, m.y_m, m.yaw_rad, m.vx, m.vy, m.wz, m.speed_limit_m_per_s})
    w.put(v);
  w.put(m.engaged);
  w.put(m.operator_engaged);
  w.put(m.operator_clear);
  w.put(m.path_seq);
  return w.size();
}

bool decode(std::span<const std::uint8_t> in, RobotGoal& m) noexcept {
  Reader r{in};
  r.get(m.seq);
  r.time(m.made);
  r.time(m.valid_until);
  for (double* v : {&m.x_m, &m.y_m, &m.yaw_rad, &m.vx, &m.vy, &m.wz, &m.speed_limit_m_per_s})
    r.finite(*v);
  r.get(m.engaged);
  r.get(m.operator_engaged);
  r.get(m.operator_clear);
  r.get(m.path_seq);
  return r.done() && m.engaged <= 1 && m.operator_engaged <= 1 && m.operator_clear <= 1;
}

std::size_t encode(const ClockRequest& m, std::span<std::uint8_t> out) noexcept {
  Writer w{out};
  w.put(m.t0_ns);
  return w.size();
}
bool decode(std::span<const std::uint8_t> in, ClockRequest& m) noexcept {
  Reader r{in};
  r.instant(m.t0_ns);
  return r.done();
}

std::size_t encode(const ClockReply& m, std::span<std::uint8_t> out) noexcept {
  Writer w{out};
  w.put(m.t0_ns);
  w.put(m.t1_ns);
  w.put(m.t2_ns);
  return w.size();
}
bool decode(std::span<const std::uint8_t> in, ClockReply& m) noexcept {
  Reader r{in};
  r.instant(m.t0_ns);
  r.instant(m.t1_ns);
  r.instant(m.t2_ns);
  return r.done() && m.t2_ns >= m.t1_ns;
}

}  // namespace drivers

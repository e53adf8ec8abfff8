// The link's wire format: a fixed 40-byte header, then the body. Little-endian whatever the host.
//
//   u32 magic "TLT1"   u16 schema version   u16 message id   u32 body length   u32 CRC32C of the body
//   u64 sequence (per message id)   i64 stamp (ns of the sender's box clock)   u64 schema hash (Hello
//   only, else 0)
//
// Every reader checks magic, version, id, length cap of the id and CRC before it looks at the body;
// every field of a body is range-checked (finite, flags known) before it is handed on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/link/encoded_frame.hpp"
#include "drivers/link/messages.hpp"
#include "rt/time.hpp"

namespace drivers {

inline constexpr std::uint16_t kSchemaVersion = 1;
inline constexpr std::size_t kHeaderSize = 40;
inline constexpr std::size_t kMaxBody = kMaxWire;
inline constexpr std::size_t kMaxControlBody = 512;

// Instants of a box's clock lie within 31 years of its zero: differences and sums of a few of them
// then never overflow, whatever a damaged or hostile message says.
[[nodiscard]] constexpr bool plausible_instant(std::int64_t ns) noexcept {
  return ns >= -1'000'000'000'000'000'000 && ns <= 1'000'000'000'000'000'000;
}

// What was made later than it arrived, beyond the clocks' doubt and this, is refused: a clock that
// drifts is measured with an error, and the sender's own tick adds to it.
inline constexpr rt::Nanos kAhead = std::chrono::milliseconds{50};

// Hash over the field lists of all messages: two programs talk only when it is equal. `pictures`:
// how frames are coded, where they are coded on demand (PictureConfig::dialect()); then the report
// of frames is among the messages, and both ends must have the same codecs.
[[nodiscard]] std::uint64_t schema_hash(std::string_view pictures = {}) noexcept;

struct Header {
  MessageId id = MessageId::kHello;
  std::uint32_t length = 0;  // of the body
  std::uint32_t crc = 0;
  std::uint64_t seq = 0;
  std::int64_t stamp_ns = 0;  // sender's box clock
  std::uint64_t schema = 0;
  std::uint16_t version = kSchemaVersion;
};

enum class WireStatus : std::uint8_t {
  kOk,
  kIncomplete,
  kBadMagic,
  kBadVersion,
  kBadId,
  kTooLong,
  kBadCrc
};
[[nodiscard]] const char* to_text(WireStatus s) noexcept;

[[nodiscard]] std::uint32_t crc32c(std::span<const std::uint8_t> data) noexcept;
void write_header(const Header& h, std::span<std::uint8_t, kHeaderSize> out) noexcept;
// kIncomplete when fewer than kHeaderSize bytes are there.
[[nodiscard]] WireStatus read_header(std::span<const std::uint8_t> in, Header& out) noexcept;
// Header and body; the CRC is filled in. Returns bytes written, 0 when `out` is too short.
std::size_t write_message(Header h, std::span<const std::uint8_t> body,
                          std::span<std::uint8_t> out) noexcept;

// Bodies. encode() returns the size; decode() is false for a wrong size or a value out of range.
// Times inside a body are in the *sender's* clock; the endpoint converts them.
std::size_t encode(const RobotState& m, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const RobotGoal& m, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const ClockRequest& m, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const ClockReply& m, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const FrameReport& m, std::span<std::uint8_t> out) noexcept;
std::size_t encode(const CommandReport& m, std::span<std::uint8_t> out) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, RobotState& m) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, RobotGoal& m) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, ClockRequest& m) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, ClockReply& m) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, FrameReport& m) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t> in, CommandReport& m) noexcept;

}  // namespace drivers

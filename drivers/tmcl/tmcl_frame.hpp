// TMCL requests and replies as bytes (Trinamic TMCL reference manual, "Binary command format" and
// "Reply format"; TMCM-1630 firmware manual 2.1 and 2.2).
//
//   serial form, 9 bytes                         mailbox form, 8 bytes
//   0 module address    0 reply address          the same without the checksum: from byte 0 on
//   1 command           1 module address         of the EtherCAT mailbox, no mailbox header
//   2 type              2 status                 before it (youBot boards)
//   3 motor or bank     3 command
//   4..7 value, most significant byte first      4..7 value, most significant byte first
//   8 checksum: sum of bytes 0..7, modulo 256
//
// Command 136 type 0 (firmware version) answers with eight bytes of text instead: decode with
// firmware_of().
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

namespace drivers::tmcl {

inline constexpr std::size_t kMailboxBytes = 8, kSerialBytes = 9;
using MailboxFrame = std::array<std::uint8_t, kMailboxBytes>;
using SerialFrame = std::array<std::uint8_t, kSerialBytes>;

enum class Command : std::uint8_t {
  kRotateRight = 1,           // ROR
  kRotateLeft = 2,            // ROL
  kMotorStop = 3,             // MST
  kMoveToPosition = 4,        // MVP
  kSetAxisParameter = 5,      // SAP
  kGetAxisParameter = 6,      // GAP
  kStoreAxisParameter = 7,    // STAP
  kRestoreAxisParameter = 8,  // RSAP
  kSetGlobal = 9,             // SGP
  kGetGlobal = 10,            // GGP
  kStoreGlobal = 11,          // STGP
  kRestoreGlobal = 12,        // RSGP
  kFirmwareVersion = 136
};

struct Request {
  std::uint8_t module = 0;  // 0 the drive, 1 the gripper behind arm joint 5
  std::uint8_t command = 0;
  std::uint8_t type = 0;   // number of the parameter, or the command's own
  std::uint8_t motor = 0;  // or bank
  std::int32_t value = 0;
  friend bool operator==(const Request&, const Request&) = default;
};

struct Reply {
  std::uint8_t host = 0;  // reply address
  std::uint8_t module = 0;
  std::uint8_t status = 0;  // status_text()
  std::uint8_t command = 0;
  std::int32_t value = 0;
  friend bool operator==(const Reply&, const Reply&) = default;
};

[[nodiscard]] std::uint8_t checksum(std::span<const std::uint8_t, kMailboxBytes>) noexcept;

[[nodiscard]] MailboxFrame encode(const Request&) noexcept;
[[nodiscard]] MailboxFrame encode(const Reply&) noexcept;
[[nodiscard]] SerialFrame to_serial(const MailboxFrame&) noexcept;

// False: fewer than eight bytes; `out` is then untouched. More are the rest of a mailbox: not read.
[[nodiscard]] bool decode(std::span<const std::uint8_t>, Request& out) noexcept;
[[nodiscard]] bool decode(std::span<const std::uint8_t>, Reply& out) noexcept;
// False: not nine bytes, or the checksum is wrong.
[[nodiscard]] bool from_serial(std::span<const std::uint8_t>, MailboxFrame& out) noexcept;

// Does the reply answer the request? A set must come back with its value, as the youBot's own
// driver asks; a get with status 100 and its command.
[[nodiscard]] bool answers(const Reply&, const Request&) noexcept;

struct Firmware {
  int controller = 0;  // 174, 1632: base; 841, 1610: arm; 842: gripper
  int version = 0;     // 148 is 1.48
  friend bool operator==(const Firmware&, const Firmware&) = default;
};
// Of the reply's text, "1632V200" or "841V1.48": digits, 'V', digits with dots that do not count.
// The rest is blank or zero bytes. nullopt: anything else.
[[nodiscard]] std::optional<Firmware> firmware_of(std::span<const std::uint8_t>) noexcept;

}  // namespace drivers::tmcl

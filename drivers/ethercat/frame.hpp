// EtherCAT frames as bytes: Ethernet II, EtherType 0x88A4, one EtherCAT header, datagrams.
// Source: ETG.1000.4 (data link layer), 5.2 frame structure, 5.3 and 5.4 PDUs; Beckhoff ESC data
// sheet section I, 2.2 and 2.4.
//
//   Ethernet   destination 6, source 6, EtherType 0x88A4 (most significant byte first)
//   EtherCAT   2 bytes: bits 0-10 length of all datagrams, 11 reserved, 12-15 type (1: datagrams)
//   datagram   command 1, index 1, address 4, length word 2 (bits 0-10 length, 14 circulating, 15
//              another datagram follows), irq 2, data, working counter 2
//
// An Ethernet frame has at least 60 bytes without its check sequence; a network card pads shorter
// ones, a virtual pair does not. Both are read: the EtherCAT length ends the data.
// Nothing here allocates.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "drivers/ethercat/bytes.hpp"

namespace drivers::ethercat {

inline constexpr std::uint16_t kEtherType = 0x88A4;
inline constexpr std::size_t kEthernetHead = 14, kEtherCatHead = 2, kDatagramHead = 10,
                             kDatagramTail = 2, kDatagramOverhead = kDatagramHead + kDatagramTail;
inline constexpr std::size_t kMinFrame = 60, kMaxFrame = 1514;  // without the check sequence
// Of a frame's datagrams, heads and counters included; and of a datagram alone.
inline constexpr std::size_t kMaxDatagrams = kMaxFrame - kEthernetHead - kEtherCatHead;
inline constexpr std::size_t kMaxData = kMaxDatagrams - kDatagramOverhead;
inline constexpr std::size_t kMostDatagrams = kMaxDatagrams / kDatagramOverhead;  // of a frame: 124

enum class Command : std::uint8_t {  // ETG.1000.4, table "command"
  kNop = 0,
  kAprd = 1,  // AP: the slave whose position counter is 0 on arrival
  kApwr = 2,
  kAprw = 3,
  kFprd = 4,  // FP: by station address
  kFpwr = 5,
  kFprw = 6,
  kBrd = 7,  // B: every slave, reads are ORed
  kBwr = 8,
  kBrw = 9,
  kLrd = 10,  // L: by logical address, through FMMUs
  kLwr = 11,
  kLrw = 12,
  kArmw = 13,  // one slave reads, all others write
  kFrmw = 14
};
inline constexpr std::uint8_t kLastCommand = 14;

[[nodiscard]] const char* to_text(Command) noexcept;
[[nodiscard]] constexpr bool reads(Command c) noexcept {
  return c == Command::kAprd || c == Command::kAprw || c == Command::kFprd || c == Command::kFprw ||
         c == Command::kBrd || c == Command::kBrw || c == Command::kLrd || c == Command::kLrw ||
         c == Command::kArmw || c == Command::kFrmw;
}
[[nodiscard]] constexpr bool writes(Command c) noexcept {
  return c == Command::kApwr || c == Command::kAprw || c == Command::kFpwr || c == Command::kFprw ||
         c == Command::kBwr || c == Command::kBrw || c == Command::kLwr || c == Command::kLrw ||
         c == Command::kArmw || c == Command::kFrmw;
}
[[nodiscard]] constexpr bool by_position(Command c) noexcept {
  return c == Command::kAprd || c == Command::kApwr || c == Command::kAprw || c == Command::kArmw;
}
[[nodiscard]] constexpr bool by_station(Command c) noexcept {
  return c == Command::kFprd || c == Command::kFpwr || c == Command::kFprw || c == Command::kFrmw;
}
[[nodiscard]] constexpr bool by_broadcast(Command c) noexcept {
  return c == Command::kBrd || c == Command::kBwr || c == Command::kBrw;
}
[[nodiscard]] constexpr bool by_logical(Command c) noexcept {
  return c == Command::kLrd || c == Command::kLwr || c == Command::kLrw;
}

// The 32-bit address field. `position` counts from 0: every slave adds one on the way.
[[nodiscard]] constexpr std::uint32_t position_address(int position, std::uint16_t reg) noexcept {
  return static_cast<std::uint16_t>(-position) | static_cast<std::uint32_t>(reg) << 16U;
}
[[nodiscard]] constexpr std::uint32_t station_address(std::uint16_t station,
                                                      std::uint16_t reg) noexcept {
  return station | static_cast<std::uint32_t>(reg) << 16U;
}
[[nodiscard]] constexpr std::uint32_t broadcast_address(std::uint16_t reg) noexcept {
  return static_cast<std::uint32_t>(reg) << 16U;
}

using MacAddress = std::array<std::uint8_t, 6>;
inline constexpr MacAddress kBroadcastMac{0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF};
// Bit 1 of the first byte is 0: the first slave sets it, so a frame that passed one is told from
// one that did not. (Addresses of virtual cards have it set already.)
inline constexpr MacAddress kMasterMac{0x10, 0x10, 0x10, 0x10, 0x10, 0x10};

struct DatagramView {
  Command command = Command::kNop;
  std::uint8_t index = 0;
  std::uint32_t address = 0;
  bool circulating = false, more = false;
  std::uint16_t irq = 0;
  std::size_t at = 0;  // of the data, from the frame's first byte
  std::span<const std::uint8_t> data;
  std::uint16_t counter = 0;  // working counter
};

enum class FrameFault : std::uint8_t {
  kNone,
  kTooShort,       // not even the heads
  kTooLong,        // more than an Ethernet frame holds
  kOtherProtocol,  // EtherType is not 0x88A4
  kWrongType,      // EtherCAT type is not 1
  kLengthOverrun,  // EtherCAT length reaches behind the frame
  kEmpty,          // no datagram
  kCutDatagram,    // a datagram reaches behind the EtherCAT length
  kMoreMissing,    // bytes left behind a datagram that says it is the last
  kMoreTooMany,    // a datagram says that another follows, and none does
  kUnknownCommand  // reserved: slaves take it for NOP; every datagram was read all the same
};
[[nodiscard]] const char* to_text(FrameFault) noexcept;

struct FrameView {
  FrameFault fault = FrameFault::kTooShort;
  MacAddress source{};
  std::size_t bytes = 0;  // behind the last datagram; the rest is padding
  // Datagrams that were read; with a fault: those before it. Of kUnknownCommand: all of them.
  std::size_t count = 0;
  std::array<DatagramView, kMostDatagrams> datagram{};
  [[nodiscard]] bool good() const noexcept { return fault == FrameFault::kNone; }
};

// Reads any bytes. The views point into `frame`. A fault of the frame's structure is named before
// an unknown command: behind the first nothing can be read, behind the second all.
void parse_frame(std::span<const std::uint8_t> frame, FrameView& out) noexcept;

// Writes a frame, datagram by datagram, into its own memory.
class FrameWriter {
 public:
  explicit FrameWriter(const MacAddress& source = kMasterMac) noexcept;
  void clear() noexcept;
  // A datagram of `length` bytes; `data` is copied to its start, the rest is 0. False: it does not
  // fit, and nothing changes.
  [[nodiscard]] bool add(Command command, std::uint8_t index, std::uint32_t address,
                         std::size_t length, std::span<const std::uint8_t> data = {}) noexcept;
  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  [[nodiscard]] std::size_t room() const noexcept { return kMaxFrame - end_; }
  // The whole frame, padded to 60 bytes. Valid until the next clear() or add().
  [[nodiscard]] std::span<const std::uint8_t> finish() noexcept;

 private:
  std::array<std::uint8_t, kMaxFrame> bytes_{};
  std::size_t end_ = kEthernetHead + kEtherCatHead;
  std::size_t last_ = 0;  // head of the last datagram
  std::size_t count_ = 0;
};

}  // namespace drivers::ethercat

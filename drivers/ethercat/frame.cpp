#include "drivers/ethercat/frame.hpp"

#include <algorithm>

namespace drivers::ethercat {

namespace {

constexpr unsigned kLengthMask = 0x07FF, kCirculating = 1U << 14U, kMore = 1U << 15U;

// The datagram at `at`, whose head is there; it ends at `end` at the latest.
FrameFault read_datagram(std::span<const std::uint8_t> frame, std::size_t at, std::size_t end,
                         DatagramView& out) noexcept {
  const unsigned word = load_u16(frame, at + 6);
  const std::size_t length = word & kLengthMask;
  if (end - at < kDatagramOverhead + length) return FrameFault::kCutDatagram;
  out.command = static_cast<Command>(frame[at]);
  out.index = frame[at + 1];
  out.address = load_u32(frame, at + 2);
  out.circulating = (word & kCirculating) != 0;
  out.more = (word & kMore) != 0;
  out.irq = load_u16(frame, at + 8);
  out.at = at + kDatagramHead;
  out.data = frame.subspan(out.at, length);
  out.counter = load_u16(frame, out.at + length);
  return FrameFault::kNone;
}

FrameFault read_heads(std::span<const std::uint8_t> frame, FrameView& out) noexcept {
  if (frame.size() < kEthernetHead + kEtherCatHead) return FrameFault::kTooShort;
  if (frame.size() > kMaxFrame) return FrameFault::kTooLong;
  std::copy_n(frame.begin() + 6, 6, out.source.begin());
  if ((frame[12] << 8U | frame[13]) != kEtherType) return FrameFault::kOtherProtocol;
  const unsigned head = load_u16(frame, kEthernetHead);
  if (head >> 12U != 1) return FrameFault::kWrongType;
  out.bytes = kEthernetHead + kEtherCatHead + (head & kLengthMask);
  if (out.bytes > frame.size()) return FrameFault::kLengthOverrun;
  return (head & kLengthMask) == 0 ? FrameFault::kEmpty : FrameFault::kNone;
}

}  // namespace

const char* to_text(Command c) noexcept {
  static constexpr std::array<const char*, kLastCommand + 1> kNames{
      "NOP", "APRD", "APWR", "APRW", "FPRD", "FPWR", "FPRW", "BRD",
      "BWR", "BRW",  "LRD",  "LWR",  "LRW",  "ARMW", "FRMW"};
  const auto i = static_cast<std::size_t>(c);
  return i < kNames.size() ? kNames[i] : "?";
}

const char* to_text(FrameFault f) noexcept {
  static constexpr std::array kNames{"no fault",
                                     "shorter than its heads",
                                     "longer than an Ethernet frame",
                                     "EtherType is not 0x88A4",
                                     "EtherCAT type is not 1",
                                     "EtherCAT length reaches behind the frame",
                                     "no datagram",
                                     "a datagram reaches behind the EtherCAT length",
                                     "bytes behind the last datagram",
                                     "more datagrams announced than there are",
                                     "unknown command"};
  const auto i = static_cast<std::size_t>(f);
  return i < kNames.size() ? kNames[i] : "?";
}

void parse_frame(std::span<const std::uint8_t> frame, FrameView& out) noexcept {
  out.count = 0;
  out.bytes = 0;
  out.fault = read_heads(frame, out);
  std::size_t at = kEthernetHead + kEtherCatHead;
  bool more = true, unknown = false;
  while (out.good() && more) {
    if (at == out.bytes) {
      out.fault = FrameFault::kMoreTooMany;
    } else if (out.bytes - at < kDatagramOverhead) {
      out.fault = FrameFault::kCutDatagram;
    } else {  // as many as fit into a frame fit into `out`
      DatagramView& d = out.datagram[out.count];
      out.fault = read_datagram(frame, at, out.bytes, d);
      if (!out.good()) return;
      ++out.count;
      unknown = unknown || static_cast<std::uint8_t>(d.command) > kLastCommand;
      more = d.more;
      at += kDatagramOverhead + d.data.size();
    }
  }
  if (out.good() && at != out.bytes) out.fault = FrameFault::kMoreMissing;
  if (out.good() && unknown) out.fault = FrameFault::kUnknownCommand;
}

FrameWriter::FrameWriter(const MacAddress& source) noexcept {
  std::copy(kBroadcastMac.begin(), kBroadcastMac.end(), bytes_.begin());
  std::copy(source.begin(), source.end(), bytes_.begin() + 6);
  bytes_[12] = kEtherType >> 8U;
  bytes_[13] = kEtherType & 0xFFU;
}

void FrameWriter::clear() noexcept {
  end_ = kEthernetHead + kEtherCatHead;
  count_ = 0;
}

bool FrameWriter::add(Command command, std::uint8_t index, std::uint32_t address,
                      std::size_t length, std::span<const std::uint8_t> data) noexcept {
  if (length > kMaxData || data.size() > length) return false;
  if (kDatagramOverhead + length > room()) return false;
  if (count_ > 0) store_u16(bytes_, last_ + 6, load_u16(bytes_, last_ + 6) | kMore);
  last_ = end_;
  bytes_[end_] = static_cast<std::uint8_t>(command);
  bytes_[end_ + 1] = index;
  store_u32(bytes_, end_ + 2, address);
  store_u16(bytes_, end_ + 6, static_cast<unsigned>(length));
  store_u16(bytes_, end_ + 8, 0);
  const auto at = bytes_.begin() + static_cast<std::ptrdiff_t>(end_ + kDatagramHead);
  std::fill(std::copy(data.begin(), data.end(), at), at + static_cast<std::ptrdiff_t>(length + 2),
            std::uint8_t{0});
  end_ += kDatagramOverhead + length;
  ++count_;
  return true;
}

std::span<const std::uint8_t> FrameWriter::finish() noexcept {
  const std::size_t length = end_ - kEthernetHead - kEtherCatHead;
  store_u16(bytes_, kEthernetHead, 0x1000U | static_cast<unsigned>(length));
  if (end_ < kMinFrame)
    std::fill(bytes_.begin() + static_cast<std::ptrdiff_t>(end_), bytes_.begin() + kMinFrame,
              std::uint8_t{0});
  return std::span(bytes_).first(std::max(end_, kMinFrame));
}

}  // namespace drivers::ethercat

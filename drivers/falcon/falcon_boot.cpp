#include "drivers/falcon/falcon_boot.hpp"

#include <algorithm>
#include <array>

namespace drivers {
namespace {

constexpr int kTimeout_ms = 1000;
// Of a 64-byte packet two bytes are status; a piece's echo then fits one packet.
constexpr std::size_t kPiece = 62;

// Reads until `wanted` bytes came, or the packets stay empty.
bool read_all(FalconTransport& t, std::span<std::uint8_t> wanted) {
  std::size_t have = 0;
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  for (int empty = 0; have < wanted.size() && empty < 60;) {
    const int n = t.read_wait(packet, kTimeout_ms);
    if (n < 0) return false;
    empty = n == 0 ? empty + 1 : 0;
    const std::size_t take = std::min(static_cast<std::size_t>(n), wanted.size() - have);
    std::copy_n(packet.begin(), take, wanted.begin() + static_cast<std::ptrdiff_t>(have));
    have += take;
  }
  return have == wanted.size();
}

bool greet(FalconTransport& t) {
  constexpr std::array<std::uint8_t, 3> kHello{0x0A, 0x43, 0x0D};
  constexpr std::array<std::uint8_t, 4> kAnswer{0x0A, 0x44, 0x2C, 0x0D};
  for (int attempt = 0; attempt < 20; ++attempt) {
    if (!t.write_wait(kHello, kTimeout_ms)) return false;
    // Some hosts see a zero byte before the answer: look for it anywhere in what comes.
    std::array<std::uint8_t, 2 * ftdi::kPacket> seen{};
    std::size_t have = 0;
    for (int packets = 0; packets < 8 && have + ftdi::kPacket <= seen.size(); ++packets) {
      const int n = t.read_wait(std::span(seen).subspan(have, ftdi::kPacket), kTimeout_ms);
      if (n < 0) return false;
      have += static_cast<std::size_t>(n);
      const auto end = seen.begin() + static_cast<std::ptrdiff_t>(have);
      if (std::search(seen.begin(), end, kAnswer.begin(), kAnswer.end()) != end) return true;
    }
  }
  return false;
}

}  // namespace

bool falcon_normal_mode(FalconTransport& t) {
  return t.control(ftdi::kLatency, 1) && t.control(ftdi::kBaud, ftdi::k1500k) &&
         t.control(ftdi::kReset, ftdi::kPurgeReceived) &&
         t.control(ftdi::kReset, ftdi::kPurgeToSend);
}

bool falcon_answers(FalconTransport& t) {
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  FalconFramer framer;
  const FalconFrame zero = encode(FalconCommand{});
  for (int attempt = 0; attempt < 5; ++attempt) {
    if (!t.write_wait(zero, kTimeout_ms)) return false;
    for (int packets = 0; packets < 10; ++packets) {
      const int n = t.read_wait(packet, 50);
      if (n < 0) break;
      for (int i = 0; i < n; ++i) {
        FalconReport report;
        if (framer.push(packet[static_cast<std::size_t>(i)]) && decode(framer.frame(), report)) {
          return true;
        }
      }
    }
  }
  return false;
}

std::string falcon_load_firmware(FalconTransport& t, const std::vector<std::uint8_t>& firmware) {
  using namespace ftdi;
  const bool ready = t.control(kReset, kPurgeReceived) && t.control(kReset, kPurgeToSend) &&
                     t.control(kLatency, 16) && t.control(kBaud, k9600) && t.control(kLine, k8N1) &&
                     t.control(kFlow, kNoFlow) && t.control(kModem, kRtsLow) &&
                     t.control(kModem, kDtrLow) && t.control(kModem, kDtrHigh);
  if (!ready) return "the FTDI chip refuses a setting";
  if (!greet(t)) {
    return "the boot monitor does not answer: switch the Falcon off and on, or use another port";
  }
  if (!t.control(kModem, kDtrLow) || !t.control(kBaud, k140k)) {
    return "the FTDI chip refuses a setting";
  }
  constexpr std::array<std::uint8_t, 1> kUpload{0x41};
  std::array<std::uint8_t, 1> agreed{};
  if (!t.write_wait(kUpload, kTimeout_ms) || !read_all(t, agreed) || agreed != kUpload) {
    return "the boot monitor refuses the firmware upload";
  }
  std::array<std::uint8_t, kPiece> echo{};
  for (std::size_t at = 0; at < firmware.size(); at += kPiece) {
    const auto piece = std::span(firmware).subspan(at, std::min(kPiece, firmware.size() - at));
    const auto back = std::span(echo).first(piece.size());
    if (!t.write_wait(piece, kTimeout_ms) || !read_all(t, back)) {
      return "the firmware upload stopped at byte " + std::to_string(at);
    }
    if (!std::equal(piece.begin(), piece.end(), back.begin())) {
      return "the firmware came back changed at byte " + std::to_string(at);
    }
  }
  if (!falcon_normal_mode(t)) return "the FTDI chip refuses a setting";
  if (!falcon_answers(t))
    return "the firmware is loaded and does not answer: is it the right file?";
  return {};
}

}  // namespace drivers

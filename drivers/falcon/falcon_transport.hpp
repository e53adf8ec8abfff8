// The Falcon's FTDI chip as bytes: control requests, blocking transfers for the start, then packets
// in and frames out without a wait. One implementation on libusb, one on the twin.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "drivers/falcon/falcon_frame.hpp"

namespace drivers {

// Vendor requests of the FTDI chip (bRequest) and their values.
namespace ftdi {
enum Request : std::uint8_t {
  kReset = 0,  // 0 the chip, 1 purge what was received, 2 purge what is to be sent
  kModem = 1,
  kFlow = 2,
  kBaud = 3,
  kLine = 4,
  kLatency = 9  // ms until a packet goes that is not full
};
inline constexpr std::uint16_t kPurgeReceived = 1, kPurgeToSend = 2;
inline constexpr std::uint16_t kDtrLow = 0x0100, kDtrHigh = 0x0101, kRtsLow = 0x0200;
inline constexpr std::uint16_t kNoFlow = 0, k8N1 = 0x0008;
// Divisors of 3 MHz: 312.5, 21, 2.
inline constexpr std::uint16_t k9600 = 0x4138, k140k = 0x0015, k1500k = 0x0002;
inline constexpr std::size_t kPacket = 64;  // bytes of a USB packet, the first two are status
inline constexpr std::size_t kStatus = 2;
}  // namespace ftdi

class FalconTransport {
 public:
  // Called on the transport's own event thread, after start().
  class Listener {
   public:
    // One USB packet, status bytes included. `t_ns` is the transport's monotonic time.
    virtual void on_packet(std::span<const std::uint8_t> packet, std::int64_t t_ns) noexcept = 0;
    // At least every 2 ms while started.
    virtual void on_time(std::int64_t t_ns) noexcept = 0;
    // The device is gone; nothing more will come.
    virtual void on_lost() noexcept = 0;

   protected:
    ~Listener() = default;
  };

  virtual ~FalconTransport() = default;

  // Set-up, blocking, at most `timeout_ms`; false or -1: failed or timed out.
  [[nodiscard]] virtual bool control(std::uint8_t request, std::uint16_t value) = 0;
  [[nodiscard]] virtual bool write_wait(std::span<const std::uint8_t> bytes, int timeout_ms) = 0;
  // One packet's payload behind its status bytes; the number of bytes, 0: an empty packet.
  [[nodiscard]] virtual int read_wait(std::span<std::uint8_t> bytes, int timeout_ms) = 0;

  // From here on packets come to the listener until stop() or on_lost().
  [[nodiscard]] virtual bool start(Listener& listener) = 0;
  // Listener's callbacks only. False: the frame before is still on its way, or the device is gone.
  [[nodiscard]] virtual bool send(const FalconFrame& frame) noexcept = 0;
  // Returns when no callback runs or will run. Not from a callback.
  virtual void stop() noexcept = 0;
};

}  // namespace drivers

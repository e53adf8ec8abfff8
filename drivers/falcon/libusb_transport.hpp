// The Falcon's transport on libusb-1.0: blocking calls for the start, then three transfers in
// flight on the way in and one on the way out, all allocated at start(), resubmitted on one event
// thread.
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <thread>

#include "drivers/falcon/falcon_transport.hpp"
#include "drivers/usb/usb_scan.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

struct libusb_context;
struct libusb_device_handle;
struct libusb_transfer;

namespace drivers {

class LibusbFalconTransport final : public FalconTransport {
 public:
  static constexpr std::array<UsbId, 1> kUsbIds{{{0x0403, 0xcb48, "Novint Falcon"}}};
  static constexpr const char* kUdevRule = "config/system/udev/70-teletact-haptic.rules";

  // The first Falcon of the host. `priority` SCHED_FIFO of the event thread, 0: ordinary. The error
  // is one line: not plugged in, no permission, busy, or what libusb says.
  [[nodiscard]] static rt::Result<std::unique_ptr<FalconTransport>> open(int priority);
  ~LibusbFalconTransport() override;

  [[nodiscard]] bool control(std::uint8_t request, std::uint16_t value) override;
  [[nodiscard]] bool write_wait(std::span<const std::uint8_t> bytes, int timeout_ms) override;
  [[nodiscard]] int read_wait(std::span<std::uint8_t> bytes, int timeout_ms) override;
  [[nodiscard]] bool start(Listener& listener) override;
  [[nodiscard]] bool send(const FalconFrame& frame) noexcept override;
  void stop() noexcept override;

 private:
  static constexpr std::size_t kReads = 3;
  struct Transfer {
    LibusbFalconTransport* owner = nullptr;
    libusb_transfer* transfer = nullptr;
    std::array<std::uint8_t, ftdi::kPacket> buffer{};
    bool out = false;
    std::atomic<bool> flying{false};
  };
  explicit LibusbFalconTransport(int priority) : priority_(priority) {}
  static void completed(libusb_transfer* transfer) noexcept;
  void received(Transfer& t) noexcept;
  [[nodiscard]] bool submit(Transfer& t) noexcept;
  [[nodiscard]] int flying() const noexcept;
  void lose() noexcept;
  void events() noexcept;

  int priority_ = 0;
  libusb_context* context_ = nullptr;
  libusb_device_handle* handle_ = nullptr;
  std::array<Transfer, kReads> in_;
  Transfer out_;
  Listener* listener_ = nullptr;
  std::atomic<bool> running_{false};
  bool lost_ = false;         // the event thread's
  std::uint32_t errors_ = 0;  // in a row, the event thread's
  std::thread thread_;
};

}  // namespace drivers

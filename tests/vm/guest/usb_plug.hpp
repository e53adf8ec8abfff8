// A USB device of the guest: the kernel's vhci_hcd as the host controller, and this thread behind
// it, which answers its transfers over the USB/IP protocol (Documentation/usb/usbip_protocol.rst in
// the kernel's source). Plugging in and out is as the kernel sees it.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace vm {

// What answers on the device's endpoints; called by the plug's thread, one call at a time.
class UsbFunction {
 public:
  virtual ~UsbFunction() = default;
  // A vendor's request without data; false: a stall.
  [[nodiscard]] virtual bool vendor(std::uint8_t /*request*/, std::uint16_t /*value*/) {
    return false;
  }
  virtual void out(std::span<const std::uint8_t>) {}
  // One packet if there is one by now; its length, 0: none.
  [[nodiscard]] virtual std::size_t in(std::span<std::uint8_t>) { return 0; }
};

struct UsbIdentity {
  std::uint16_t vendor = 0, product = 0;
};

class UsbPlug {
 public:
  // One interface with bulk endpoints 0x02 out and 0x81 in, full speed, as an FTDI chip has.
  UsbPlug(int port, UsbIdentity id, UsbFunction& function)
      : port_(port), id_(id), function_(function) {}
  ~UsbPlug() { pull(); }
  UsbPlug(const UsbPlug&) = delete;
  UsbPlug& operator=(const UsbPlug&) = delete;

  // False: the controller took no device.
  [[nodiscard]] bool push();
  void pull();
  [[nodiscard]] std::uint64_t transfers() const noexcept { return transfers_.load(); }

 private:
  struct Header;
  struct Waiting {
    std::uint32_t seq = 0;
    std::size_t room = 0;
  };
  void serve();
  [[nodiscard]] bool take();
  void submit(const Header&);
  void unlink(const Header&);
  void control(const Header&, std::span<const std::uint8_t>);
  [[nodiscard]] std::vector<std::uint8_t> descriptor(std::uint16_t which) const;
  void answer(const Header&, std::int32_t status, std::span<const std::uint8_t> data,
              std::size_t taken = 0);
  void answer_in();

  int port_;
  UsbIdentity id_;
  UsbFunction& function_;
  int socket_ = -1;
  std::deque<Waiting> waiting_;  // reads that nothing has come for yet
  std::atomic<std::uint64_t> transfers_{0};
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

}  // namespace vm

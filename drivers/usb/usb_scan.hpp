// What is plugged in, and may this user use it? Says in one line why a device can not be opened:
// not plugged in, no permission (udev rule missing), or USB itself is not there. Opens nothing for
// longer than the question takes; set-up code only.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace drivers {

struct UsbId {
  std::uint16_t vendor = 0, product = 0;
  const char* name = "";
};

struct UsbSeen {
  std::uint16_t vendor = 0, product = 0;
  int bus = 0, address = 0;
  // Could it be opened: 0, or libusb's error code (-3 access, -4 no device, -6 busy).
  int open_error = 0;
};

struct UsbScan {
  std::string failure;  // USB can not be read at all; empty: it can
  std::vector<UsbSeen> devices;
};

// Every device of the host with one of these ids; each is opened and closed once.
[[nodiscard]] UsbScan scan_usb(std::span<const UsbId> wanted);
using UsbScanner = std::function<UsbScan(std::span<const UsbId>)>;

enum class UsbPresence : std::uint8_t { kUsable, kNoPermission, kBusy, kAbsent, kNoUsb };

struct UsbVerdict {
  UsbPresence presence = UsbPresence::kAbsent;
  std::string text;  // "1451:0402 (omega.x) on bus 1 device 4: no permission: ..."
};

// The best of what was seen decides: a usable one, else one without permission, else a busy one.
// `rule` is the udev rule file that gives the permission.
[[nodiscard]] UsbVerdict judge(const UsbScan& scan, std::span<const UsbId> wanted,
                               const std::string& rule);

}  // namespace drivers

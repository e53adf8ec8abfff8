#include "drivers/usb/usb_scan.hpp"

#include <libusb.h>

#include <array>
#include <cstdio>

namespace drivers {
namespace {

constexpr int kAccess = LIBUSB_ERROR_ACCESS;
constexpr int kBusy = LIBUSB_ERROR_BUSY;

const UsbId* match(std::span<const UsbId> wanted, std::uint16_t vendor, std::uint16_t product) {
  for (const UsbId& id : wanted) {
    if (id.vendor == vendor && id.product == product) return &id;
  }
  return nullptr;
}

std::string id_text(std::uint16_t vendor, std::uint16_t product) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%04x:%04x", vendor, product);
  return text.data();
}

std::string wanted_text(std::span<const UsbId> wanted) {
  std::string text;
  for (const UsbId& id : wanted) {
    if (!text.empty()) text += " or ";
    text += id_text(id.vendor, id.product);
  }
  return text;
}

}  // namespace

UsbScan scan_usb(std::span<const UsbId> wanted) {
  UsbScan out;
  libusb_context* context = nullptr;
  if (const int error = libusb_init(&context); error != 0) {
    out.failure = libusb_strerror(error);
    return out;
  }
  libusb_device** list = nullptr;
  const auto count = libusb_get_device_list(context, &list);
  if (count < 0) {
    out.failure = libusb_strerror(static_cast<int>(count));
  }
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    libusb_device_descriptor d{};
    if (libusb_get_device_descriptor(list[i], &d) != 0) continue;
    if (match(wanted, d.idVendor, d.idProduct) == nullptr) continue;
    UsbSeen seen{d.idVendor, d.idProduct, libusb_get_bus_number(list[i]),
                 libusb_get_device_address(list[i]), 0};
    libusb_device_handle* handle = nullptr;
    seen.open_error = libusb_open(list[i], &handle);
    if (seen.open_error == 0) libusb_close(handle);
    out.devices.push_back(seen);
  }
  if (count >= 0) libusb_free_device_list(list, 1);
  libusb_exit(context);
  return out;
}

UsbVerdict judge(const UsbScan& scan, std::span<const UsbId> wanted, const std::string& rule) {
  if (!scan.failure.empty()) {
    return {UsbPresence::kNoUsb, "USB can not be read on this machine: " + scan.failure};
  }
  UsbVerdict best{UsbPresence::kAbsent,
                  "not plugged in: no USB device " + wanted_text(wanted) + " is there"};
  for (const UsbSeen& d : scan.devices) {
    const UsbId* id = match(wanted, d.vendor, d.product);
    if (id == nullptr) continue;
    const std::string where = id_text(d.vendor, d.product) + " (" + id->name + ") on bus " +
                              std::to_string(d.bus) + " device " + std::to_string(d.address);
    UsbVerdict v;
    if (d.open_error == 0) {
      v = {UsbPresence::kUsable, where};
    } else if (d.open_error == kAccess) {
      v = {UsbPresence::kNoPermission,
           where + ": no permission: udev rule missing; copy " + rule +
               " to /etc/udev/rules.d/, run udevadm control --reload and udevadm trigger, plug in "
               "again"};
    } else if (d.open_error == kBusy) {
      v = {UsbPresence::kBusy, where + ": busy: another program holds it"};
    } else {
      continue;  // went away between the list and the question
    }
    if (v.presence < best.presence) best = v;
  }
  return best;
}

}  // namespace drivers

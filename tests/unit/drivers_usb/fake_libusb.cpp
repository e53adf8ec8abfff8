#include "tests/unit/drivers_usb/fake_libusb.hpp"

#include <libusb.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <deque>
#include <mutex>
#include <thread>

#include "rt/clock/box_time.hpp"

struct libusb_context {
  int unused = 0;
};
struct libusb_device {
  fake_libusb::Device device;
};
struct libusb_device_handle {
  fake_libusb::Device device;
  bool claimed = false;
};

namespace {

using fake_libusb::Bus;

struct Flight {
  libusb_transfer* transfer;
  bool cancelled = false;
};

std::mutex& mutex() {
  static std::mutex m;
  return m;
}
Bus& bus() {
  static Bus b;
  return b;
}
std::deque<Flight>& flights() {
  static std::deque<Flight> f;
  return f;
}
using Lock = std::lock_guard<std::mutex>;

void offence(const std::string& text) { bus().offences.push_back(text); }

bool gone(const libusb_device_handle* h) {
  return std::none_of(bus().devices.begin(), bus().devices.end(), [&](const auto& d) {
    return d.vendor == h->device.vendor && d.product == h->device.product;
  });
}

// The status of a flight that ends now, or -1 while it stays up. Data goes to and from the twin.
int ending(Flight& f) {
  libusb_transfer* t = f.transfer;
  if (f.cancelled) return LIBUSB_TRANSFER_CANCELLED;
  if (gone(t->dev_handle) || bus().twin == nullptr) return LIBUSB_TRANSFER_NO_DEVICE;
  t->actual_length = 0;
  if ((t->endpoint & LIBUSB_ENDPOINT_IN) != 0) {
    const int n =
        bus().twin->read({t->buffer, static_cast<std::size_t>(t->length)}, rt::monotonic_ns());
    if (n < 0) return LIBUSB_TRANSFER_NO_DEVICE;
    if (n == 0) return -1;
    t->actual_length = n;
  } else {
    if (!bus().twin->write({t->buffer, static_cast<std::size_t>(t->length)}, rt::monotonic_ns())) {
      return LIBUSB_TRANSFER_NO_DEVICE;
    }
    t->actual_length = t->length;
  }
  if (!bus().next_statuses.empty()) {
    const int status = bus().next_statuses.front();
    bus().next_statuses.erase(bus().next_statuses.begin());
    return status;
  }
  return LIBUSB_TRANSFER_COMPLETED;
}

// One that has ended, taken off the list; null: none has.
libusb_transfer* next_ended() {
  const Lock lock(mutex());
  auto& list = flights();
  for (auto f = list.begin(); f != list.end(); ++f) {
    const int status = ending(*f);
    if (status < 0) continue;
    libusb_transfer* t = f->transfer;
    t->status = static_cast<libusb_transfer_status>(status);
    list.erase(f);
    ++bus().completed;
    return t;
  }
  return nullptr;
}

}  // namespace

namespace fake_libusb {

void with(void (*change)(Bus&, void*), void* context) {
  const Lock lock(mutex());
  change(bus(), context);
}

void reset() {
  const Lock lock(mutex());
  bus() = Bus{};
  flights().clear();
}

}  // namespace fake_libusb

extern "C" {

int libusb_init(libusb_context** context) {
  const Lock lock(mutex());
  if (bus().init_error != 0) return bus().init_error;
  *context = new libusb_context;
  ++bus().contexts;
  return 0;
}
void libusb_exit(libusb_context* context) {
  const Lock lock(mutex());
  --bus().contexts;
  delete context;
}
const char* libusb_strerror(int error) {
  return error == LIBUSB_ERROR_NOT_FOUND ? "Entity not found" : "Other error";
}
ssize_t libusb_get_device_list(libusb_context*, libusb_device*** list) {
  const Lock lock(mutex());
  if (bus().list_error != 0) return bus().list_error;
  const auto n = bus().devices.size();
  *list = new libusb_device*[n + 1];
  for (std::size_t i = 0; i < n; ++i) (*list)[i] = new libusb_device{bus().devices[i]};
  (*list)[n] = nullptr;
  ++bus().lists;
  return static_cast<ssize_t>(n);
}
void libusb_free_device_list(libusb_device** list, int) {
  const Lock lock(mutex());
  --bus().lists;
  for (libusb_device** d = list; *d != nullptr; ++d) delete *d;
  delete[] list;
}
int libusb_get_device_descriptor(libusb_device* d, libusb_device_descriptor* out) {
  *out = {};
  out->idVendor = d->device.vendor;
  out->idProduct = d->device.product;
  return 0;
}
uint8_t libusb_get_bus_number(libusb_device* d) { return d->device.bus; }
uint8_t libusb_get_device_address(libusb_device* d) { return d->device.address; }
int libusb_open(libusb_device* d, libusb_device_handle** out) {
  const Lock lock(mutex());
  if (d->device.open_error != 0) return d->device.open_error;
  *out = new libusb_device_handle{d->device, false};
  ++bus().handles;
  return 0;
}
libusb_device_handle* libusb_open_device_with_vid_pid(libusb_context*, uint16_t v, uint16_t p) {
  const Lock lock(mutex());
  for (const auto& d : bus().devices) {
    if (d.vendor != v || d.product != p) continue;
    if (d.open_error != 0) return nullptr;
    ++bus().handles;
    return new libusb_device_handle{d, false};
  }
  return nullptr;
}
void libusb_close(libusb_device_handle* h) {
  const Lock lock(mutex());
  for (const auto& f : flights()) {
    if (f.transfer->dev_handle == h) offence("closed with a transfer in flight");
  }
  if (h->claimed) offence("closed without releasing the interface");
  --bus().handles;
  delete h;
}
int libusb_set_auto_detach_kernel_driver(libusb_device_handle*, int) { return 0; }
int libusb_claim_interface(libusb_device_handle* h, int) {
  const Lock lock(mutex());
  if (h->device.claim_error != 0) return h->device.claim_error;
  h->claimed = true;
  ++bus().claimed;
  return 0;
}
int libusb_release_interface(libusb_device_handle* h, int) {
  const Lock lock(mutex());
  if (h->claimed) --bus().claimed;
  h->claimed = false;
  return 0;
}
int libusb_control_transfer(libusb_device_handle* h, uint8_t type, uint8_t request, uint16_t value,
                            uint16_t, unsigned char*, uint16_t, unsigned) {
  const Lock lock(mutex());
  if (gone(h) || bus().twin == nullptr) return LIBUSB_ERROR_NO_DEVICE;
  if (type != 0x40) return LIBUSB_ERROR_PIPE;
  return bus().twin->control(request, value, rt::monotonic_ns()) ? 0 : LIBUSB_ERROR_PIPE;
}
int libusb_bulk_transfer(libusb_device_handle* h, unsigned char endpoint, unsigned char* data,
                         int length, int* done, unsigned timeout_ms) {
  const std::int64_t end = rt::monotonic_ns() + std::int64_t{timeout_ms} * 1000000;
  while (true) {
    {
      const Lock lock(mutex());
      *done = 0;
      if (!h->claimed) offence("transfer on an interface that is not claimed");
      if (gone(h) || bus().twin == nullptr) return LIBUSB_ERROR_NO_DEVICE;
      const auto size = static_cast<std::size_t>(length);
      if ((endpoint & LIBUSB_ENDPOINT_IN) == 0) {
        if (!bus().twin->write({data, size}, rt::monotonic_ns())) return LIBUSB_ERROR_NO_DEVICE;
        *done = length;
        return 0;
      }
      const int n = bus().twin->read({data, size}, rt::monotonic_ns());
      if (n < 0) return LIBUSB_ERROR_NO_DEVICE;
      if (n > 0) {
        *done = n;
        return 0;
      }
    }
    if (rt::monotonic_ns() > end) return LIBUSB_ERROR_TIMEOUT;
    std::this_thread::sleep_for(std::chrono::microseconds{100});
  }
}
libusb_transfer* libusb_alloc_transfer(int) {
  const Lock lock(mutex());
  ++bus().transfers;
  ++bus().allocated;
  return new libusb_transfer{};
}
void libusb_free_transfer(libusb_transfer* t) {
  const Lock lock(mutex());
  for (const auto& f : flights()) {
    if (f.transfer == t) offence("freed a transfer in flight");
  }
  --bus().transfers;
  delete t;
}
int libusb_submit_transfer(libusb_transfer* t) {
  const Lock lock(mutex());
  if (gone(t->dev_handle)) return LIBUSB_ERROR_NO_DEVICE;
  if (bus().submit_error != 0) return bus().submit_error;
  for (const auto& f : flights()) {
    if (f.transfer == t) offence("submitted a transfer that is in flight");
  }
  if (!t->dev_handle->claimed) offence("transfer on an interface that is not claimed");
  flights().push_back({t, false});
  ++bus().submitted;
  bus().most_in_flight = std::max(bus().most_in_flight, static_cast<int>(flights().size()));
  return 0;
}
int libusb_cancel_transfer(libusb_transfer* t) {
  const Lock lock(mutex());
  for (auto& f : flights()) {
    if (f.transfer == t) {
      f.cancelled = true;
      return 0;
    }
  }
  return LIBUSB_ERROR_NOT_FOUND;
}
int libusb_handle_events_timeout_completed(libusb_context*, timeval* wait, int*) {
  const std::int64_t end =
      rt::monotonic_ns() + std::int64_t{wait->tv_sec} * 1000000000 + wait->tv_usec * 1000;
  bool any = false;
  while (true) {
    libusb_transfer* t = next_ended();
    if (t != nullptr) {
      any = true;
      t->callback(t);  // without the lock, as libusb does
      continue;
    }
    if (any || rt::monotonic_ns() >= end) return 0;
    std::this_thread::sleep_for(std::chrono::microseconds{100});
  }
}
void libusb_interrupt_event_handler(libusb_context*) {}

}  // extern "C"

// A libusb without a bus: the functions that the drivers call, on devices that a test describes;
// behind a Falcon its twin. It keeps libusb's rules and notes who breaks them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/falcon/falcon_twin.hpp"

namespace fake_libusb {

struct Device {
  std::uint16_t vendor = 0, product = 0;
  std::uint8_t bus = 1, address = 1;
  int open_error = 0;  // a libusb error
  int claim_error = 0;
};

struct Bus {
  int init_error = 0;
  int list_error = 0;
  std::vector<Device> devices;
  drivers::FalconTwin* twin = nullptr;  // behind 0403:cb48
  // The next transfers that complete do so with these statuses instead.
  std::vector<int> next_statuses;
  int submit_error = 0;

  // What was seen.
  int contexts = 0, handles = 0, transfers = 0, claimed = 0, lists = 0;
  std::uint64_t submitted = 0, completed = 0, allocated = 0;
  int most_in_flight = 0;
  std::vector<std::string> offences;
};

// Everything below is one bus; the lock is held by each function and by with().
void with(void (*change)(Bus&, void*), void* context);
template <class F>
void with(F change) {
  with([](Bus& bus, void* f) { (*static_cast<F*>(f))(bus); }, &change);
}
void reset();

}  // namespace fake_libusb

#include "drivers/can/can_frame.hpp"

#include <algorithm>

namespace drivers::can {

bool fill(CanFrame& f, std::uint32_t id, std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.size() > 8) return false;
  f = {};
  f.id = id;
  f.length = static_cast<std::uint8_t>(bytes.size());
  std::copy(bytes.begin(), bytes.end(), f.data.begin());
  return true;
}

const char* to_text(BusState s) noexcept {
  switch (s) {
    case BusState::kActive:
      return "error active";
    case BusState::kWarning:
      return "error warning";
    case BusState::kPassive:
      return "error passive";
    case BusState::kBusOff:
      break;
  }
  return "bus-off";
}

// The classes and bits are those of linux/can/error.h; their names there in the comments.
ErrorReport read_error(std::uint32_t id, std::span<const std::uint8_t, 8> data) noexcept {
  ErrorReport r;
  const auto state = [&r](BusState s) {
    r.state_known = true;
    r.state = std::max(r.state, s);
  };
  if ((id & 0x004U) != 0) {  // CAN_ERR_CRTL
    const unsigned c = data[1];
    r.overflow = (c & 0x03U) != 0;                    // RX_OVERFLOW, TX_OVERFLOW
    if ((c & 0x40U) != 0) state(BusState::kActive);   // ACTIVE
    if ((c & 0x0CU) != 0) state(BusState::kWarning);  // RX_WARNING, TX_WARNING
    if ((c & 0x30U) != 0) state(BusState::kPassive);  // RX_PASSIVE, TX_PASSIVE
  }
  r.protocol = (id & 0x088U) != 0;  // CAN_ERR_PROT, CAN_ERR_BUSERROR
  r.no_ack = (id & 0x020U) != 0;    // CAN_ERR_ACK
  if ((id & 0x100U) != 0) {         // CAN_ERR_RESTARTED
    r.restarted = true;
    state(BusState::kActive);
  }
  if ((id & 0x040U) != 0) state(BusState::kBusOff);  // CAN_ERR_BUSOFF
  if ((id & 0x200U) != 0) {                          // CAN_ERR_CNT
    r.tx_errors = data[6];
    r.rx_errors = data[7];
  }
  return r;
}

}  // namespace drivers::can

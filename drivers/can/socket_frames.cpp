#include "drivers/can/socket_frames.hpp"

#include <linux/errqueue.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace drivers::can {

const char* to_text(PortState s) noexcept {
  switch (s) {
    case PortState::kUp:
      return "up";
    case PortState::kQueueFull:
      return "send queue full";
    case PortState::kBusOff:
      return "bus-off";
    case PortState::kDown:
      return "interface down";
    case PortState::kGone:
      break;
  }
  return "interface gone";
}

can_frame to_kernel(const CanFrame& f) noexcept {
  can_frame out{};
  out.can_id = f.extended ? ((f.id & CAN_EFF_MASK) | CAN_EFF_FLAG) : (f.id & CAN_SFF_MASK);
  if (f.remote) out.can_id |= CAN_RTR_FLAG;
  out.can_dlc = std::min<std::uint8_t>(f.length, CAN_MAX_DLEN);
  std::copy_n(f.data.begin(), out.can_dlc, out.data);
  return out;
}

FrameKind from_kernel(const can_frame& in, std::size_t bytes, CanFrame& out) noexcept {
  if (bytes != CAN_MTU) return FrameKind::kOther;
  if ((in.can_id & CAN_ERR_FLAG) != 0) return FrameKind::kError;
  if (in.can_dlc > CAN_MAX_DLEN) return FrameKind::kOther;
  out = {};
  out.extended = (in.can_id & CAN_EFF_FLAG) != 0;
  out.remote = (in.can_id & CAN_RTR_FLAG) != 0;
  out.id = in.can_id & (out.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  out.length = in.can_dlc;
  std::copy_n(in.data, in.can_dlc, out.data.begin());
  return FrameKind::kData;
}

void BusWatch::take_error(std::uint32_t id, std::span<const std::uint8_t, 8> data) noexcept {
  const ErrorReport r = read_error(id, data);
  ++counters.error_frames;
  counters.no_acks += r.no_ack ? 1 : 0;
  counters.overflows += r.overflow ? 1 : 0;
  counters.protocol_errors += r.protocol ? 1 : 0;
  counters.restarts += r.restarted ? 1 : 0;
  if (r.state_known) {
    counters.bus_offs += r.state == BusState::kBusOff && bus != BusState::kBusOff ? 1 : 0;
    bus = r.state;
  }
  if (bus == BusState::kBusOff) {
    port = PortState::kBusOff;
  } else if (port == PortState::kBusOff) {
    port = PortState::kUp;
  }
}

void BusWatch::take_life() noexcept {
  port = PortState::kUp;
  if (bus == BusState::kBusOff) bus = BusState::kActive;
}

void BusWatch::take_room() noexcept {
  if (port != PortState::kBusOff) port = PortState::kUp;
}

void BusWatch::take_errno(int error) noexcept {
  switch (error) {
    case ENOBUFS:
    case EAGAIN:
      if (port != PortState::kBusOff) port = PortState::kQueueFull;
      break;
    case ENETDOWN:
      port = PortState::kDown;
      break;
    case ENODEV:
    case ENXIO:
      port = PortState::kGone;
      break;
    default:
      break;  // counted as refused by the caller
  }
}

bool read_control(const msghdr& head, std::int64_t& realtime_ns,
                  std::uint32_t& dropped_so_far) noexcept {
  bool stamped = false;
  for (const cmsghdr* c = CMSG_FIRSTHDR(&head); c != nullptr;
       c = CMSG_NXTHDR(const_cast<msghdr*>(&head), const_cast<cmsghdr*>(c))) {
    if (c->cmsg_level != SOL_SOCKET) continue;
    if (c->cmsg_type == SO_TIMESTAMPING && c->cmsg_len >= CMSG_LEN(sizeof(scm_timestamping))) {
      scm_timestamping stamps{};
      std::memcpy(&stamps, CMSG_DATA(c), sizeof stamps);
      realtime_ns = stamps.ts[0].tv_sec * 1'000'000'000LL + stamps.ts[0].tv_nsec;
      stamped = realtime_ns != 0;
    }
    if (c->cmsg_type == SO_RXQ_OVFL && c->cmsg_len >= CMSG_LEN(sizeof dropped_so_far))
      std::memcpy(&dropped_so_far, CMSG_DATA(c), sizeof dropped_so_far);
  }
  return stamped;
}

}  // namespace drivers::can

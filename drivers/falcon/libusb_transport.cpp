#include "drivers/falcon/libusb_transport.hpp"

#include <libusb.h>
#include <pthread.h>

#include <algorithm>

#include "rt/clock/box_time.hpp"

namespace drivers {
namespace {

constexpr std::uint8_t kOut = 0x02, kIn = 0x81;
constexpr std::uint8_t kVendorRequest = 0x40;
constexpr unsigned kControlTimeout_ms = 1000;
constexpr std::uint32_t kErrorsUntilLost = 20;

}  // namespace

rt::Result<std::unique_ptr<FalconTransport>> LibusbFalconTransport::open(int priority) {
  std::unique_ptr<LibusbFalconTransport> t(new LibusbFalconTransport(priority));
  if (const int error = libusb_init(&t->context_); error != 0) {
    t->context_ = nullptr;
    return rt::Error{"USB can not be read on this machine: " + std::string(libusb_strerror(error))};
  }
  t->handle_ = libusb_open_device_with_vid_pid(t->context_, kUsbIds[0].vendor, kUsbIds[0].product);
  if (t->handle_ == nullptr) {
    const UsbVerdict why = judge(scan_usb(kUsbIds), kUsbIds, kUdevRule);
    return rt::Error{why.presence == UsbPresence::kUsable ? why.text + ": can not be opened"
                                                          : why.text};
  }
  // The kernel's serial driver may sit on the chip.
  (void)libusb_set_auto_detach_kernel_driver(t->handle_, 1);
  if (const int error = libusb_claim_interface(t->handle_, 0); error != 0) {
    libusb_close(t->handle_);
    t->handle_ = nullptr;
    return rt::Error{"0403:cb48 (Novint Falcon): the interface can not be claimed: " +
                     std::string(libusb_strerror(error))};
  }
  return std::unique_ptr<FalconTransport>(std::move(t));
}

LibusbFalconTransport::~LibusbFalconTransport() {
  stop();
  if (handle_ != nullptr) {
    (void)libusb_release_interface(handle_, 0);
    libusb_close(handle_);
  }
  if (context_ != nullptr) libusb_exit(context_);
}

bool LibusbFalconTransport::control(std::uint8_t request, std::uint16_t value) {
  return libusb_control_transfer(handle_, kVendorRequest, request, value, 0, nullptr, 0,
                                 kControlTimeout_ms) == 0;
}

bool LibusbFalconTransport::write_wait(std::span<const std::uint8_t> bytes, int timeout_ms) {
  std::array<std::uint8_t, ftdi::kPacket> buffer{};
  if (bytes.size() > buffer.size()) return false;
  std::copy(bytes.begin(), bytes.end(), buffer.begin());
  int done = 0;
  const int error =
      libusb_bulk_transfer(handle_, kOut, buffer.data(), static_cast<int>(bytes.size()), &done,
                           static_cast<unsigned>(timeout_ms));
  return error == 0 && done == static_cast<int>(bytes.size());
}

int LibusbFalconTransport::read_wait(std::span<std::uint8_t> bytes, int timeout_ms) {
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  int done = 0;
  const int error =
      libusb_bulk_transfer(handle_, kIn, packet.data(), static_cast<int>(packet.size()), &done,
                           static_cast<unsigned>(timeout_ms));
  if (error != 0) return -1;
  if (done <= static_cast<int>(ftdi::kStatus)) return 0;
  const auto got = std::min(static_cast<std::size_t>(done) - ftdi::kStatus, bytes.size());
  std::copy_n(packet.begin() + ftdi::kStatus, got, bytes.begin());
  return static_cast<int>(got);
}

bool LibusbFalconTransport::submit(Transfer& t) noexcept {
  t.flying.store(true, std::memory_order_relaxed);
  if (libusb_submit_transfer(t.transfer) == 0) return true;
  t.flying.store(false, std::memory_order_relaxed);
  return false;
}

bool LibusbFalconTransport::start(Listener& listener) {
  listener_ = &listener;
  lost_ = false;
  errors_ = 0;
  const auto prepare = [&](Transfer& t, std::uint8_t endpoint, int size) {
    t.owner = this;
    t.out = endpoint == kOut;
    if (t.transfer == nullptr) t.transfer = libusb_alloc_transfer(0);
    if (t.transfer == nullptr) return false;
    // No time-out: silence is judged by our own deadline.
    libusb_fill_bulk_transfer(t.transfer, handle_, endpoint, t.buffer.data(), size,
                              &LibusbFalconTransport::completed, &t, 0);
    return true;
  };
  if (!prepare(out_, kOut, static_cast<int>(kFalconFrameSize))) return false;
  for (Transfer& t : in_) {
    if (!prepare(t, kIn, static_cast<int>(t.buffer.size()))) return false;
  }
  running_.store(true, std::memory_order_release);
  bool good = true;
  for (Transfer& t : in_) good = good && submit(t);
  // The thread runs in any case: what was submitted has to come home before anything is freed.
  thread_ = std::thread([this] { events(); });
  if (priority_ > 0) {
    sched_param p{};
    p.sched_priority = priority_;
    (void)pthread_setschedparam(thread_.native_handle(), SCHED_FIFO, &p);  // without the right: not
  }
  if (!good) stop();
  return good;
}

bool LibusbFalconTransport::send(const FalconFrame& frame) noexcept {
  if (lost_ || !running_.load(std::memory_order_acquire)) return false;
  if (out_.flying.load(std::memory_order_relaxed)) return false;
  std::copy(frame.begin(), frame.end(), out_.buffer.begin());
  if (submit(out_)) return true;
  lose();
  return false;
}

int LibusbFalconTransport::flying() const noexcept {
  int n = out_.flying.load(std::memory_order_relaxed) ? 1 : 0;
  for (const Transfer& t : in_) n += t.flying.load(std::memory_order_relaxed) ? 1 : 0;
  return n;
}

void LibusbFalconTransport::completed(libusb_transfer* transfer) noexcept {
  auto& t = *static_cast<Transfer*>(transfer->user_data);
  t.flying.store(false, std::memory_order_relaxed);
  t.owner->received(t);
}

// On the event thread. Short packets are normal; NO_DEVICE and a stalled pipe end the session,
// since neither can be mended from inside a callback.
void LibusbFalconTransport::received(Transfer& t) noexcept {
  if (!running_.load(std::memory_order_acquire) || lost_) return;
  switch (t.transfer->status) {
    case LIBUSB_TRANSFER_COMPLETED:
      errors_ = 0;
      if (!t.out) {
        listener_->on_packet(
            std::span(t.buffer).first(static_cast<std::size_t>(t.transfer->actual_length)),
            rt::monotonic_ns());
      }
      break;
    case LIBUSB_TRANSFER_NO_DEVICE:
    case LIBUSB_TRANSFER_STALL:
      lose();
      return;
    case LIBUSB_TRANSFER_CANCELLED:
      return;
    case LIBUSB_TRANSFER_ERROR:
    case LIBUSB_TRANSFER_TIMED_OUT:
    case LIBUSB_TRANSFER_OVERFLOW:
      if (++errors_ >= kErrorsUntilLost) {
        lose();
        return;
      }
      break;
  }
  if (!t.out && !lost_ && !submit(t)) lose();
}

void LibusbFalconTransport::lose() noexcept {
  if (lost_) return;
  lost_ = true;
  for (Transfer& t : in_) {
    if (t.flying.load(std::memory_order_relaxed)) (void)libusb_cancel_transfer(t.transfer);
  }
  if (out_.flying.load(std::memory_order_relaxed)) (void)libusb_cancel_transfer(out_.transfer);
  listener_->on_lost();
}

void LibusbFalconTransport::events() noexcept {
  while (running_.load(std::memory_order_acquire) && !lost_) {
    timeval wait{0, 1000};
    (void)libusb_handle_events_timeout_completed(context_, &wait, nullptr);
    if (!lost_ && running_.load(std::memory_order_acquire)) listener_->on_time(rt::monotonic_ns());
  }
  // Nothing may be freed while a transfer is out: cancelled ones still come home.
  for (Transfer& t : in_) {
    if (t.flying.load(std::memory_order_relaxed)) (void)libusb_cancel_transfer(t.transfer);
  }
  if (out_.flying.load(std::memory_order_relaxed)) (void)libusb_cancel_transfer(out_.transfer);
  while (flying() > 0) {
    timeval wait{0, 1000};
    if (libusb_handle_events_timeout_completed(context_, &wait, nullptr) != 0) break;
  }
}

void LibusbFalconTransport::stop() noexcept {
  running_.store(false, std::memory_order_release);
  if (thread_.joinable()) {
    libusb_interrupt_event_handler(context_);
    thread_.join();
  }
  for (Transfer& t : in_) {
    if (t.transfer != nullptr && !t.flying.load()) libusb_free_transfer(t.transfer);
    t.transfer = nullptr;
  }
  if (out_.transfer != nullptr && !out_.flying.load()) libusb_free_transfer(out_.transfer);
  out_.transfer = nullptr;
}

}  // namespace drivers

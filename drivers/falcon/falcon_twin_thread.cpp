#include "drivers/falcon/falcon_twin_thread.hpp"

#include <algorithm>
#include <array>
#include <chrono>

#include "rt/clock/box_time.hpp"

namespace drivers {

// The blocking calls come before start() and after stop(): never beside the thread.
bool FalconTwinThread::control(std::uint8_t request, std::uint16_t value) {
  return twin_.control(request, value, rt::monotonic_ns());
}

bool FalconTwinThread::write_wait(std::span<const std::uint8_t> bytes, int) {
  return twin_.write(bytes, rt::monotonic_ns());
}

int FalconTwinThread::read_wait(std::span<std::uint8_t> bytes, int timeout_ms) {
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  const std::int64_t end = rt::monotonic_ns() + std::int64_t{timeout_ms} * 1'000'000;
  while (true) {
    const int n = twin_.read(packet, rt::monotonic_ns());
    if (n < 0) return -1;
    if (n > 0) {
      const std::size_t take = std::min(static_cast<std::size_t>(n) - ftdi::kStatus, bytes.size());
      std::copy_n(packet.begin() + ftdi::kStatus, take, bytes.begin());
      return static_cast<int>(take);
    }
    if (rt::monotonic_ns() > end) return -1;
    std::this_thread::sleep_for(std::chrono::microseconds{250});
  }
}

bool FalconTwinThread::start(Listener& listener) {
  listener_ = &listener;
  running_.store(true, std::memory_order_release);
  thread_ = std::thread([this] { events(); });
  return true;
}

bool FalconTwinThread::send(const FalconFrame& frame) noexcept {
  return twin_.write(frame, rt::monotonic_ns());
}

void FalconTwinThread::events() noexcept {
  std::array<std::uint8_t, ftdi::kPacket> packet{};
  while (running_.load(std::memory_order_acquire)) {
    listener_->on_time(rt::monotonic_ns());
    int n = 0;
    while ((n = twin_.read(packet, rt::monotonic_ns())) > 0) {
      listener_->on_packet(std::span(packet).first(static_cast<std::size_t>(n)),
                           rt::monotonic_ns());
    }
    if (n < 0) {
      listener_->on_lost();
      return;
    }
    cpu_ns_.store(rt::thread_cpu_ns());
    std::this_thread::sleep_for(std::chrono::microseconds{250});
  }
}

void FalconTwinThread::stop() noexcept {
  running_.store(false, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

}  // namespace drivers

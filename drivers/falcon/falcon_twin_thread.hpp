// The Falcon's twin as a transport in real time: an ordinary thread is the USB event thread, four
// times a millisecond. For runs without hardware; tests move the time themselves
// (FalconTwinTransport).
#pragma once

#include <atomic>
#include <thread>

#include "drivers/falcon/falcon_twin.hpp"

namespace drivers {

class FalconTwinThread final : public FalconTransport {
 public:
  // `twin` outlives this.
  explicit FalconTwinThread(FalconTwin& twin) : twin_(twin) {}
  ~FalconTwinThread() override { stop(); }

  [[nodiscard]] bool control(std::uint8_t request, std::uint16_t value) override;
  [[nodiscard]] bool write_wait(std::span<const std::uint8_t> bytes, int timeout_ms) override;
  [[nodiscard]] int read_wait(std::span<std::uint8_t> bytes, int timeout_ms) override;
  [[nodiscard]] bool start(Listener& listener) override;
  [[nodiscard]] bool send(const FalconFrame& frame) noexcept override;
  void stop() noexcept override;
  // CPU time of the thread so far.
  [[nodiscard]] std::int64_t cpu_ns() const noexcept { return cpu_ns_.load(); }

 private:
  void events() noexcept;

  FalconTwin& twin_;
  Listener* listener_ = nullptr;
  std::atomic<bool> running_{false};
  std::atomic<std::int64_t> cpu_ns_{0};
  std::thread thread_;
};

}  // namespace drivers

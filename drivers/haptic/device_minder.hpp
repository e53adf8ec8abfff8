// An ordinary thread beside a device: what may block and must not be done in the owner's tick (stop
// the motors while the owner hangs, close and open again after the plug was pulled).
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <semaphore>
#include <thread>

namespace drivers {

class DeviceMinder {
 public:
  DeviceMinder() = default;
  DeviceMinder(const DeviceMinder&) = delete;
  DeviceMinder& operator=(const DeviceMinder&) = delete;
  ~DeviceMinder() { stop(); }

  // `work` runs after every poke(), and again every `retry` as long as it returns true.
  void start(std::function<bool()> work, std::chrono::milliseconds retry) {
    work_ = std::move(work);
    retry_ = retry;
    thread_ = std::thread([this] { loop(); });
  }
  void stop() {
    if (!thread_.joinable()) return;
    ending_.store(true, std::memory_order_release);
    wake_.release();
    thread_.join();
  }
  // Any thread; a system call only when the minder sleeps.
  void poke() noexcept {
    if (!poked_.exchange(true, std::memory_order_acq_rel)) wake_.release();
  }

 private:
  void loop() {
    bool again = false;
    while (true) {
      if (again) {
        (void)wake_.try_acquire_for(retry_);
      } else {
        wake_.acquire();
      }
      if (ending_.load(std::memory_order_acquire)) return;
      poked_.store(false, std::memory_order_release);
      again = work_();
    }
  }

  std::function<bool()> work_;
  std::chrono::milliseconds retry_{500};
  std::counting_semaphore<> wake_{0};
  std::atomic<bool> ending_{false}, poked_{false};
  std::thread thread_;
};

}  // namespace drivers

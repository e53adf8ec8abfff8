// A SyntheticCamera whose rendering runs on an ordinary thread of its own, for runs on the real
// clock: poll() only copies the newest finished frame, so the capture task pays what it would pay
// for a camera on a bus.
//
// A frame is available when it is rendered, i.e. later than the nominal completion by the time the
// twin needs (late_max()). A frame whose successor is already due is skipped, as a real camera's
// would be lost.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

#include "drivers/camera/newest_frame.hpp"
#include "drivers/camera/synthetic_camera.hpp"

namespace drivers {

class ThreadedCamera : public Camera {
 public:
  // `now` is the box's clock; it is called from the camera's thread. The thread starts at once.
  ThreadedCamera(rt::NonRealtime&, std::unique_ptr<SyntheticCamera> camera,
                 std::function<rt::Time()> now);
  ~ThreadedCamera() override;
  ThreadedCamera(const ThreadedCamera&) = delete;
  ThreadedCamera& operator=(const ThreadedCamera&) = delete;

  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override {
    return camera_->intrinsics();
  }
  [[nodiscard]] double rate_hz() const noexcept override { return camera_->rate_hz(); }
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override;
  [[nodiscard]] FrameArrivals* arrivals() noexcept override { return &frames_.arrivals(); }

  // Ends the thread; poll() then only hands out what is finished. The destructor calls it.
  void stop();

  [[nodiscard]] std::int64_t twin_cpu_ns() const noexcept { return twin_cpu_ns_.load(); }
  [[nodiscard]] std::uint64_t rendered() const noexcept { return rendered_.load(); }
  // Longest time between the nominal completion of a frame and its being available.
  [[nodiscard]] rt::Nanos late_max() const noexcept { return rt::Nanos{late_max_ns_.load()}; }

 private:
  void run();
  [[nodiscard]] bool wait_until_reached(rt::Time t);  // false: told to stop

  std::unique_ptr<SyntheticCamera> camera_;
  std::function<rt::Time()> now_;
  NewestFrame frames_;
  std::atomic<std::int64_t> twin_cpu_ns_{0}, late_max_ns_{0};
  std::atomic<std::uint64_t> rendered_{0};
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace drivers

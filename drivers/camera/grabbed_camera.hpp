// A camera whose library blocks. An ordinary thread waits for frames; poll() copies the newest one.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "drivers/camera/newest_frame.hpp"

namespace drivers {

// The interface to a vendor's library. All calls but the constructor come from one thread.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  [[nodiscard]] virtual perception::Intrinsics intrinsics() const noexcept = 0;
  [[nodiscard]] virtual double rate_hz() const noexcept = 0;
  // Description of the opened device for people: name, serial number, its own lens data.
  [[nodiscard]] virtual std::string description() const = 0;
  // Waits at most so long. Fills everything but `exposure`. kNoFrame: none came; kEnd: a recording
  // is over; kFault: the device is lost.
  [[nodiscard]] virtual CameraStatus wait_frame(int timeout_ms, perception::RgbdFrame& out) = 0;
};

class GrabbedCamera final : public Camera {
 public:
  // `now` is the box's clock; it is called from the thread. `delay`: from the middle of an exposure
  // to the frame's arrival here. The thread starts at once.
  GrabbedCamera(rt::NonRealtime&, std::unique_ptr<FrameSource> source,
                std::function<rt::Time()> now, rt::Nanos delay);
  ~GrabbedCamera() override;
  GrabbedCamera(const GrabbedCamera&) = delete;
  GrabbedCamera& operator=(const GrabbedCamera&) = delete;

  [[nodiscard]] perception::Intrinsics intrinsics() const noexcept override { return intrinsics_; }
  [[nodiscard]] double rate_hz() const noexcept override { return rate_hz_; }
  [[nodiscard]] CameraStatus poll(rt::Time now, perception::RgbdFrame& out) noexcept override;
  [[nodiscard]] FrameArrivals* arrivals() noexcept override { return &frames_.arrivals(); }

 private:
  void run();
  std::unique_ptr<FrameSource> source_;
  perception::Intrinsics intrinsics_;
  double rate_hz_;
  std::function<rt::Time()> now_;
  rt::Nanos delay_;
  NewestFrame frames_;
  std::atomic<std::uint64_t> grabbed_{0};
  std::atomic<CameraStatus> ended_{CameraStatus::kNoFrame};  // kEnd or kFault: no more will come
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace drivers

#include "drivers/camera/threaded_camera.hpp"

#include <algorithm>

namespace drivers {

ThreadedCamera::ThreadedCamera(rt::NonRealtime& nrt, std::unique_ptr<SyntheticCamera> camera,
                               std::function<rt::Time()> now)
    : camera_(std::move(camera)), now_(std::move(now)), frames_(nrt) {
  thread_ = std::thread([this] { run(); });
}

ThreadedCamera::~ThreadedCamera() { stop(); }

void ThreadedCamera::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool ThreadedCamera::wait_until_reached(rt::Time t) {
  std::unique_lock lock(mutex_);
  // The box's clock may run at another speed than this machine's: look again after each sleep.
  for (rt::Time now = now_(); !stop_ && now < t; now = now_()) wake_.wait_for(lock, t - now);
  return !stop_;
}

void ThreadedCamera::run() {
  for (std::uint64_t f = 0;; ++f) {
    const rt::Time now = now_();
    while (camera_->mid_exposure(f + 1) <= now) ++f;  // too late for it: lost
    // The whole exposure is time to render in: a real camera's frame is there when its shutter has
    // closed, or soon after. Half an exposure ahead the pose is known to some micrometres.
    if (!wait_until_reached(camera_->shutter_opens(f))) return;
    camera_->expose(f, frames_.begin_write());
    // Nobody may see a frame before its shutter has closed.
    if (!wait_until_reached(camera_->complete(f))) return;
    const rt::Time whole = now_();
    frames_.publish(whole);
    rendered_.store(camera_->rendered());
    twin_cpu_ns_.store(camera_->twin_cpu_ns());
    late_max_ns_.store(std::max(late_max_ns_.load(), (whole - camera_->complete(f)).count()));
  }
}

CameraStatus ThreadedCamera::poll(rt::Time, perception::RgbdFrame& out) noexcept {
  return frames_.take(out) ? CameraStatus::kFrame : CameraStatus::kNoFrame;
}

}  // namespace drivers

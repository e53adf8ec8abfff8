#include "drivers/camera/grabbed_camera.hpp"

namespace drivers {

namespace {
constexpr int kWait_ms = 100;  // so long the thread may take to notice that it is to end
}

GrabbedCamera::GrabbedCamera(rt::NonRealtime& nrt, std::unique_ptr<FrameSource> source,
                             std::function<rt::Time()> now, rt::Nanos delay)
    : source_(std::move(source)),
      intrinsics_(source_->intrinsics()),
      rate_hz_(source_->rate_hz()),
      now_(std::move(now)),
      delay_(delay),
      frames_(nrt) {
  thread_ = std::thread([this] { run(); });
}

GrabbedCamera::~GrabbedCamera() {
  stop_.store(true);
  thread_.join();
}

void GrabbedCamera::run() {
  while (!stop_.load()) {
    perception::RgbdFrame& slot = frames_.begin_write();
    const CameraStatus status = source_->wait_frame(kWait_ms, slot);
    if (status == CameraStatus::kNoFrame) continue;
    if (status != CameraStatus::kFrame) {
      ended_.store(status);
      return;
    }
    const rt::Time whole = now_();
    slot.exposure = whole - delay_;
    slot.seq = grabbed_.fetch_add(1);
    frames_.publish(whole);
  }
}

CameraStatus GrabbedCamera::poll(rt::Time, perception::RgbdFrame& out) noexcept {
  const CameraStatus ended =
      ended_.load();  // before looking: what came before the end is handed out
  return frames_.take(out) ? CameraStatus::kFrame : ended;
}

}  // namespace drivers

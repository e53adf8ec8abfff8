#include "drivers/camera/grabbed_camera.hpp"

#include "drivers/camera/frame_copy.hpp"

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
      frames_(nrt, {1}) {
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
    slot.exposure = now_() - delay_;
    slot.seq = grabbed_.fetch_add(1);
    frames_.publish();
  }
}

CameraStatus GrabbedCamera::poll(rt::Time, perception::RgbdFrame& out) noexcept {
  const CameraStatus ended =
      ended_.load();  // before looking: what came before the end is handed out
  if (frames_.fresh(0)) {
    const auto view = frames_.acquire(0);
    if (view && view.seq != handed_out_) {
      handed_out_ = view.seq;
      copy_frame(*view, out);
      return CameraStatus::kFrame;
    }
  }
  return ended;
}

}  // namespace drivers

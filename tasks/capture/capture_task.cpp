#include "tasks/capture/capture_task.hpp"

namespace tasks {

void CaptureConfig::describe(config::Section& s) {
  colour.describe(s.section("colour", "JPEG pictures on the link"));
}

CaptureTask::CaptureTask(rt::NonRealtime& nrt, const CaptureConfig& config, rt::Box box)
    : scratch_(nrt, config.colour), box_(box) {}

rt::Health CaptureTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out.written = false;
  if (!in.fresh || in.frame == nullptr || out.slot == nullptr) {
    ++stats_.idle;
    return rt::Health::ok();
  }
  // By the frame's own number: which frames have colour does not depend on which were lost.
  const bool with_colour = tick.level == 0 || in.frame->seq % kColourEvery == 0;
  const auto status = drivers::encode(*in.frame, box_, with_colour, scratch_, *out.slot);
  if (status == drivers::FrameStatus::kBadHeader) {
    ++stats_.bad_frames;
    return rt::Health::of(rt::Severity::kCounted, kFaultCaptureBadFrame);
  }
  out.written = true;
  ++stats_.frames;
  stats_.depth_bytes += out.slot->depth_size;
  stats_.colour_bytes += out.slot->colour_size;
  if (with_colour && in.frame->has_colour) ++stats_.colour_coded;
  if (status == drivers::FrameStatus::kWithoutColour) {
    ++stats_.colour_failed;
    return rt::Health::of(rt::Severity::kCounted, kFaultCaptureNoColour);
  }
  return rt::Health::ok();
}

}  // namespace tasks

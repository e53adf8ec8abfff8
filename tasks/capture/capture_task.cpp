#include "tasks/capture/capture_task.hpp"

namespace tasks {

void CaptureConfig::describe(config::Section& s) {
  colour.describe(s.section("colour", "JPEG pictures on the link"));
}

CaptureTask::CaptureTask(rt::NonRealtime& nrt, const CaptureConfig& config, rt::Box box,
                         const perception::Intrinsics& camera)
    : scratch_(nrt, config.colour, config.pictures, camera, drivers::CodecEnd::kEncodes),
      box_(box),
      on_demand_(config.pictures.on_demand()) {}

rt::Health CaptureTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out.written = false;
  if (in.fresh && on_demand_) {
    if (waiting_) ++stats_.unasked;
    waiting_ = true;
  }
  const bool wanted =
      on_demand_ ? waiting_ && in.demand != nullptr && in.demand->seq > in.answered : in.fresh;
  if (!wanted || in.frame == nullptr || out.slot == nullptr) {
    ++stats_.idle;
    return rt::Health::ok();
  }
  waiting_ = false;
  // By the frame's own number: which frames have colour does not depend on which were lost.
  const bool with_colour = tick.level == 0 || in.frame->seq % kColourEvery == 0;
  const auto status = drivers::encode(*in.frame, box_, with_colour, scratch_, *out.slot,
                                      on_demand_ ? *in.demand : drivers::FrameDemand{});
  if (status == drivers::FrameStatus::kBadHeader) {
    ++stats_.bad_frames;
    return rt::Health::of(rt::Severity::kCounted, kFaultCaptureBadFrame);
  }
  out.written = true;
  ++stats_.frames;
  stats_.depth_bytes += out.slot->depth_size;
  stats_.colour_bytes += out.slot->colour_size;
  if (out.slot->has_colour || status == drivers::FrameStatus::kWithoutColour) ++stats_.colour_coded;
  if (status == drivers::FrameStatus::kWithoutColour) {
    ++stats_.colour_failed;
    return rt::Health::of(rt::Severity::kCounted, kFaultCaptureNoColour);
  }
  return rt::Health::ok();
}

void CaptureTask::lost() noexcept { scratch_.restart(); }

}  // namespace tasks

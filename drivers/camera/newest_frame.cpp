#include "drivers/camera/newest_frame.hpp"

#include "drivers/camera/frame_copy.hpp"

namespace drivers {

void NewestFrame::publish(rt::Time now) noexcept {
  frames_.publish();
  arrivals_.try_push(now);
}

bool NewestFrame::take(perception::RgbdFrame& out) noexcept {
  if (!frames_.fresh(0)) return false;
  const auto view = frames_.acquire(0);
  if (!view || view.seq == handed_out_) return false;
  handed_out_ = view.seq;
  copy_frame(*view, out);
  return true;
}

}  // namespace drivers

#include "drivers/camera/newest_frame.hpp"

#include "drivers/camera/frame_copy.hpp"

namespace drivers {

bool NewestFrame::poll(rt::Time now, perception::RgbdFrame& out) noexcept {
  CameraPoll found{.at = now};
  if (frames_.fresh(0)) {
    const auto view = frames_.acquire(0);
    if (view && view.seq != handed_out_) {
      found.fresh = true;
      found.whole = view.at;
      found.exposure = view->exposure;
      found.passed_over = view.seq - handed_out_ - 1;
      handed_out_ = view.seq;
      copy_frame(*view, out);
    }
  }
  polls_.try_push(found);
  return found.fresh;
}

}  // namespace drivers

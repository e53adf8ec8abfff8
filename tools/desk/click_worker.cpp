#include "tools/desk/click_worker.hpp"

#include <algorithm>

namespace teletact {

using perception::Click;
using perception::ClickAnswer;

ClickAnswered ClickWorker::answer(const ClickRequest& request) {
  ClickAnswered out;
  out.session = request.session;
  out.id = request.id;
  out.round = request.round;
  out.why = segment(request);
  if (out.why.empty()) out.proposal = propose();
  return out;
}

// Empty: done; else why not, and the click does not count.
std::string ClickWorker::segment(const ClickRequest& r) {
  if (r.frame) {
    frame_ = r.frame;
    X_WC_ = r.X_WC;
    claimed_ = r.claimed;
    clicks_.clear();
    const auto& k = frame_->intrinsics;
    if (!segmenter_ || k.width != width_ || k.height != height_) {
      width_ = k.width, height_ = k.height;
      segmenter_ = std::make_unique<perception::ClickSegmenter>(width_, height_);
    }
    segmenter_->set_frame(frame_->rgb(), frame_->depth(), k, 1.0F);
  }
  if (!frame_ || (clicks_.empty() && !r.frame)) return "the first click of an object chooses it";
  const auto pixel = [](double share, int size) {
    return std::clamp(static_cast<int>(share * size), 0, size - 1);
  };
  clicks_.push_back({pixel(r.u, width_), pixel(r.v, height_), r.add});
  const ClickAnswer said = segmenter_->segment(clicks_);
  std::string why = said == ClickAnswer::kDone ? std::string() : perception::reason(said);
  if (why.empty() && segmenter_->named_support()) why = "this is what things stand on";
  if (!why.empty()) clicks_.pop_back();
  return why;
}

std::shared_ptr<const Proposal> ClickWorker::propose() {
  const auto mask = segmenter_->mask();
  auto out = std::make_shared<Proposal>();
  out->number = ++number_;
  out->exposure = frame_->exposure;
  out->width = mask.width;
  out->height = mask.height;
  out->claimed = claimed_;
  out->clicks = static_cast<int>(clicks_.size());
  out->mask.reserve(static_cast<std::size_t>(mask.width) * static_cast<std::size_t>(mask.height));
  for (int v = 0; v < mask.height; ++v)
    for (int u = 0; u < mask.width; ++u) out->mask.push_back(mask.at(u, v) != 0 ? 1 : 0);
  out->pixels = static_cast<int>(std::count(out->mask.begin(), out->mask.end(), 1));
  out->object =
      perception::boxes_of(perception::FrameView::of(*frame_), mask, X_WC_, clicks_.front());
  return out;
}

}  // namespace teletact

#include "tasks/haptic/touch_events.hpp"

namespace tasks {

void TouchEvents::emit(TouchEvent::Kind kind, const Tick& t, const ProxyState& proxy,
                       List out) noexcept {
  if (out.count >= static_cast<std::int32_t>(out.events.size())) return;
  TouchEvent& e = out.events[static_cast<std::size_t>(out.count++)];
  e = TouchEvent{};
  e.seq = ++event_seq_;
  e.stamp = t.release;
  e.kind = kind;
  e.p_W = proxy.p_WP();
  e.normal_W = proxy.normal_W();
  e.force_N = t.f_D.norm();
}

void TouchEvents::tell(const Tick& t, const ProxyState& proxy, List out) noexcept {
  using Kind = TouchEvent::Kind;
  if (t.contact && !was_contact_) emit(Kind::kContactBegin, t, proxy, out);
  if (t.surface_left) emit(Kind::kSurfaceLeft, t, proxy, out);
  if (marking_ && (!t.contact || !t.button)) {
    emit(Kind::kMarkEnd, t, proxy, out);
    marking_ = false;
  }
  if (t.contact && t.button && !was_button_ && !marking_) {
    emit(Kind::kMarkBegin, t, proxy, out);
    marking_ = true;
    mark_p_W_ = mark_begin_W_ = proxy.p_WP();
    mark_seq_ = event_seq_;
    mark_time_ = t.release;
  } else if (marking_ && ((proxy.p_WP() - mark_p_W_).norm() >= mark_spacing_m_ ||
                          rt::seconds(t.release - mark_time_) >= 1.0 / mark_rate_hz_)) {
    emit(Kind::kMarkPoint, t, proxy, out);
    mark_p_W_ = proxy.p_WP();
    mark_time_ = t.release;
  }
  if (!t.contact && was_contact_) emit(Kind::kContactEnd, t, proxy, out);
  was_contact_ = t.contact;
  was_button_ = t.button;
}

}  // namespace tasks

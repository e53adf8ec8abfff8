// What is told of a touch: contact and its end, marks of the button, a surface that left the hand.
// Nothing here allocates, locks or throws.
#pragma once

#include <array>
#include <cstdint>

#include "perception/geometry/pose.hpp"
#include "rt/clock/tick.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/haptic/proxy.hpp"

namespace tasks {

class TouchEvents {
 public:
  // At most four a tick: a contact begins and its mark with it, or the reverse.
  struct List {
    std::array<TouchEvent, 4>& events;
    std::int32_t& count;
  };
  struct Tick {
    rt::Time release{};
    bool contact = false, button = false, surface_left = false;
    const perception::Vec3& f_D;  // on the hand
  };

  TouchEvents() = default;
  TouchEvents(double mark_spacing_m, double mark_rate_hz)
      : mark_spacing_m_(mark_spacing_m), mark_rate_hz_(mark_rate_hz) {}

  // Of the last tick.
  [[nodiscard]] bool contact() const noexcept { return was_contact_; }
  [[nodiscard]] bool button() const noexcept { return was_button_; }
  // The event with which the last mark began, and where; 0: none yet.
  [[nodiscard]] std::uint64_t mark_seq() const noexcept { return mark_seq_; }
  [[nodiscard]] const perception::Vec3& mark_begin_W() const noexcept { return mark_begin_W_; }

  void tell(const Tick& t, const ProxyState& proxy, List out) noexcept;

 private:
  void emit(TouchEvent::Kind kind, const Tick& t, const ProxyState& proxy, List out) noexcept;

  double mark_spacing_m_ = 0, mark_rate_hz_ = 1;
  bool was_contact_ = false, was_button_ = false, marking_ = false;
  perception::Vec3 mark_p_W_ = perception::Vec3::Zero(), mark_begin_W_ = perception::Vec3::Zero();
  rt::Time mark_time_{};
  std::uint64_t event_seq_ = 0, mark_seq_ = 0;
};

}  // namespace tasks

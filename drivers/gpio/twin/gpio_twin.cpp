#include "drivers/gpio/twin/gpio_twin.hpp"

#include <algorithm>

namespace drivers::gpio {

void TwinEvent::describe(config::Section& s) {
  s.number("at_s", at_s, 0, 86400, "when, from the start of the run");
  s.text("what", what,
         {"press", "release", "hold", "let_go", "break_wire", "mend_wire", "weld_second",
          "unreadable", "readable", "unwritable", "writable", "lose_edges"},
         "what a person or a fault does to the lines");
}

GpioTwin::GpioTwin(rt::NonRealtime&, const GpioConfig::Lines& lines) : lines_(lines) {
  for (const int i : {lines_.estop, lines_.estop_2, lines_.enable})
    if (i >= 0) level_[static_cast<std::size_t>(i)] = true;
}

void GpioTwin::follow(rt::NonRealtime&, const std::vector<TwinEvent>& script, rt::Time epoch) {
  script_ = script;
  std::stable_sort(script_.begin(), script_.end(),
                   [](const TwinEvent& a, const TwinEvent& b) { return a.at_s < b.at_s; });
  next_ = 0;
  epoch_ = epoch;
}

void GpioTwin::advance(rt::Time now) noexcept {
  for (; next_ < script_.size(); ++next_) {
    const rt::Time at = epoch_ + rt::nanos_from_seconds(script_[next_].at_s);
    if (at > now) break;
    act_on(script_[next_], at);
  }
  std::size_t done = 0;
  while (done < moves_ && move_[done].at <= now) take_place(move_[done++]);
  std::copy(move_.begin() + static_cast<std::ptrdiff_t>(done),
            move_.begin() + static_cast<std::ptrdiff_t>(moves_), move_.begin());
  moves_ -= done;
}

void GpioTwin::act_on(const TwinEvent& e, rt::Time at) noexcept {
  if (e.what == "press") press(at);
  if (e.what == "release") release(at);
  if (e.what == "hold") hold(at);
  if (e.what == "let_go") let_go(at);
  if (e.what == "break_wire") break_wire(at);
  if (e.what == "mend_wire") mend_wire(at);
  if (e.what == "weld_second") weld_second(true);
  if (e.what == "unreadable" || e.what == "readable") unreadable(e.what == "unreadable");
  if (e.what == "unwritable" || e.what == "writable") unwritable(e.what == "unwritable");
  if (e.what == "lose_edges") lose_edges(true);
}

void GpioTwin::move(int input, bool active, rt::Time at) noexcept {
  if (input < 0 || moves_ == move_.size()) return;
  std::size_t i = moves_++;
  for (; i > 0 && move_[i - 1].at > at; --i) move_[i] = move_[i - 1];
  move_[i] = {input, active, at};
}

void GpioTwin::take_place(const Move& m) noexcept {
  bool& level = level_[static_cast<std::size_t>(m.input)];
  if (level == m.active) return;
  level = m.active;
  if (lose_ || queued_ == queue_.size()) {
    overflow_ = overflow_ || !lose_;
    ++lost_;
    return;
  }
  queue_[queued_++] = {m.input, m.active, m.at};
}

void GpioTwin::move_estop(bool closed, rt::Time at) noexcept {
  move(lines_.estop, closed && !broken_, at);
  if (!welded_) move(lines_.estop_2, closed, at);
}

void GpioTwin::press(rt::Time at) noexcept {
  pressed_ = true;
  move_estop(false, at);
}
void GpioTwin::release(rt::Time at) noexcept {
  pressed_ = false;
  move_estop(true, at);
}
void GpioTwin::hold(rt::Time at) noexcept { move(lines_.enable, true, at); }
void GpioTwin::let_go(rt::Time at) noexcept { move(lines_.enable, false, at); }
void GpioTwin::break_wire(rt::Time at) noexcept {
  broken_ = true;
  move_estop(!pressed_, at);
}
void GpioTwin::mend_wire(rt::Time at) noexcept {
  broken_ = false;
  move_estop(!pressed_, at);
}
void GpioTwin::bounce(rt::Time at, int edges, rt::Nanos gap) noexcept {
  for (int i = 0; i < edges; ++i) move_estop(i % 2 != 0, at + i * gap);
}

Drained GpioTwin::drain(rt::Time now, std::span<LineEdge> out) noexcept {
  advance(now);
  Drained d;
  d.lost = overflow_;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < queued_; ++i) {
    const bool fits = static_cast<std::size_t>(d.count) < out.size();
    if (queue_[i].at <= now && fits && !unreadable_) {
      out[static_cast<std::size_t>(d.count++)] = queue_[i];
    } else {
      queue_[kept++] = queue_[i];
    }
  }
  queued_ = kept;
  overflow_ = false;
  return d;
}

bool GpioTwin::levels(rt::Time now, std::uint32_t& active) noexcept {
  advance(now);
  if (unreadable_) return false;
  active = 0;
  for (std::size_t i = 0; i < lines_.inputs.size(); ++i) active |= level_[i] ? 1U << i : 0U;
  return true;
}

bool GpioTwin::set(rt::Time now, int output, bool active) noexcept {
  advance(now);
  if (unwritable_ || output < 0 || output >= kMostLines) return false;
  if (output == lines_.heartbeat && output_[static_cast<std::size_t>(output)] != active) {
    ++beats_;
    last_beat_ = now;
  }
  output_[static_cast<std::size_t>(output)] = active;
  return true;
}

}  // namespace drivers::gpio

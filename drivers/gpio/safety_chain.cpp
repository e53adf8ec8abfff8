#include "drivers/gpio/safety_chain.hpp"

#include <algorithm>

namespace drivers::gpio {

namespace {

// More edges than this in one job are a line that chatters: the rest waits for the next job.
constexpr std::size_t kEdgesAJob = 64;

rt::Nanos from_ms(double ms) { return rt::nanos_from_seconds(ms * 1e-3); }

bool lamp_level(Lamp lamp, rt::Time now) noexcept {
  const std::int64_t ms = rt::ns_of(now) / 1'000'000;
  switch (lamp) {
    case Lamp::kOff:
      return false;
    case Lamp::kSlow:
      return ms % 1000 < 500;
    case Lamp::kFast:
      return ms % 250 < 125;
    case Lamp::kOn:
      break;
  }
  return true;
}

}  // namespace

SafetyChain::SafetyChain(rt::NonRealtime&, const GpioConfig& config, GpioLines& lines)
    : lines_(lines),
      places_(config.lines()),
      debounce_(from_ms(config.debounce_ms)),
      disagree_(from_ms(config.disagree_ms)),
      half_wave_(from_ms(config.heartbeat_ms)) {
  estop_.input = places_.estop;
  estop_2_.input = places_.estop_2;
  enable_.input = places_.enable;
}

void SafetyChain::sense(rt::Time now, SafetyInputs& out) noexcept {
  out = {};
  out.fitted = true;
  out.enable_fitted = enable_.input >= 0;
  out.outputs_failed = failed_;
  std::array<LineEdge, kEdgesAJob> edges{};
  const Drained drained = lines_.drain(now, edges);
  out.edges_lost = drained.lost;
  for (int i = 0; i < drained.count; ++i) {
    const LineEdge& e = edges[static_cast<std::size_t>(i)];
    for (Contact* c : {&estop_, &estop_2_, &enable_}) {
      if (c->input != e.input) continue;
      c->changed = std::max(c->changed, e.at);
      if (e.active) continue;
      c->closed = false;
      if (c != &enable_) opened_ = std::max(opened_, e.at);
    }
  }
  std::uint32_t levels = 0;
  out.readable = lines_.levels(now, levels);
  if (!out.readable) levels = 0;
  for (Contact* c : {&estop_, &estop_2_, &enable_}) take_level(*c, now, levels);
  out.estop_open = !estop_.closed || (estop_2_.input >= 0 && !estop_2_.closed);
  out.enable_held = enable_.closed;
  watch_disagreement(now, out);
  out.estop_opened = opened_;
}

void SafetyChain::take_level(Contact& c, rt::Time now, std::uint32_t levels) const noexcept {
  if (c.input < 0) return;
  const bool level = (levels >> static_cast<unsigned>(c.input) & 1U) != 0;
  if (level != c.level || !c.seen) c.changed = std::max(c.changed, c.seen ? now : now - debounce_);
  c.seen = true;
  c.level = level;
  if (!level) {
    c.closed = false;
  } else if (now - c.changed >= debounce_) {
    c.closed = true;
  }
}

// Of the levels, not of the debounced contacts: both close after the same quiet time.
void SafetyChain::watch_disagreement(rt::Time now, SafetyInputs& out) noexcept {
  if (estop_2_.input < 0) return;
  const bool differ = out.readable && estop_.level != estop_2_.level;
  if (differ && !differ_) differ_since_ = now;
  differ_ = differ;
  out.estop_disagrees = differ && now - differ_since_ > disagree_;
}

void SafetyChain::act(rt::Time now, const SafetyOutputs& out) noexcept {
  failed_ = false;
  const bool alive = out.alive && !safe_.load(std::memory_order_acquire);
  // A quarter of a period early is in time: a job's start is not exactly a period after the last.
  const bool due = !begun_ || now - beat_at_ >= half_wave_ - half_wave_ / 4;
  if (places_.heartbeat >= 0 && alive && due) {
    begun_ = true;
    beat_at_ = now;
    put(places_.heartbeat, !beat_, now, beat_);
  }
  const bool lamp = lamp_level(out.lamp, now);
  if (places_.lamp >= 0 && lamp != lamp_) put(places_.lamp, lamp, now, lamp_);
}

void SafetyChain::put(int output, bool active, rt::Time now, bool& last) noexcept {
  if (lines_.set(now, output, active)) {
    last = active;
  } else {
    failed_ = true;
  }
}

}  // namespace drivers::gpio

#include "drivers/haptic/hand_script.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace drivers {
namespace {

using perception::Vec3;

Vec3 vec(const std::array<double, 3>& a) noexcept { return {a[0], a[1], a[2]}; }

struct Blend {
  double s = 0, ds = 0;  // share of the way and its rate per unit time fraction
};

// Minimum jerk: the way a hand reaches (Flash and Hogan 1985).
Blend minimum_jerk(double f) noexcept {
  const double g = f * f;
  return {f * g * (10.0 - 15.0 * f + 6.0 * g), 30.0 * g * (1.0 - 2.0 * f + g)};
}

// Constant speed with a tenth of the time to start and to stop.
Blend soft_ends(double f) noexcept {
  constexpr double r = 0.1, v = 1.0 / (1.0 - r);
  if (f < r) return {0.5 * v * f * f / r, v * f / r};
  if (f > 1.0 - r) return {1.0 - 0.5 * v * (1.0 - f) * (1.0 - f) / r, v * (1.0 - f) / r};
  return {v * (f - 0.5 * r), v};
}

[[noreturn]] void refuse(std::size_t i, const std::string& what) {
  throw std::invalid_argument("hand.segment[" + std::to_string(i) + "]: " + what);
}

}  // namespace

HandScript::HandScript(rt::NonRealtime&, const HandScriptConfig& config, const WorkspaceMap& map)
    : config_(config), map_(map), count_(config.segments.size()) {
  slots_ = std::make_unique<Slot[]>(count_ + 1);
  rt::Nanos at = rt::nanos_from_seconds(config.start_after_s);
  for (std::size_t i = 0; i < count_; ++i) {
    HandSegmentConfig& c = config_.segments[i];
    Kind kind = Kind::kHold;
    if (c.kind == "move")
      kind = Kind::kMove;
    else if (c.kind == "press")
      kind = Kind::kPress;
    else if (c.kind == "slide")
      kind = Kind::kSlide;
    else if (c.kind == "button_down")
      kind = Kind::kButtonDown;
    else if (c.kind == "button_up")
      kind = Kind::kButtonUp;
    else if (c.kind == "clutch_down")
      kind = Kind::kClutchDown;
    else if (c.kind == "clutch_up")
      kind = Kind::kClutchUp;
    else if (c.kind != "hold")
      refuse(i, "kind = \"" + c.kind + "\" is not known");
    const bool moves = kind == Kind::kMove || kind == Kind::kPress || kind == Kind::kSlide;
    if (moves && c.time_s < 0.001) refuse(i, "time_s of a motion must be at least 0.001");
    const double length = vec(c.normal).norm();
    if (moves && c.source == "point" && !(length > 1e-6)) refuse(i, "normal has no length");
    if (moves && c.source == "point") {
      slots_[i].p_W = vec(c.point_m);
      slots_[i].normal_W = vec(c.normal) / length;
      slots_[i].ready.store(true, std::memory_order_release);
    }
    kinds_.push_back(kind);
    starts_.push_back(at);
    at += rt::nanos_from_seconds(c.time_s);
  }
  starts_.push_back(at);
  from_ = to_ = anchor_ = map_.to_world(Vec3::Zero()) + vec(config_.start_m);
}

bool HandScript::set_point(std::size_t i, const Vec3& p_W, const Vec3& normal_W) noexcept {
  if (i >= count_) return false;
  const std::string& source = config_.segments[i].source;
  if (source != "pixel" && source != "chosen") return false;
  const double length = normal_W.norm();
  if (!p_W.allFinite() || !std::isfinite(length) || !(length > 1e-6)) return false;
  if (slots_[i].ready.load(std::memory_order_relaxed)) return false;
  slots_[i].p_W = p_W;
  slots_[i].normal_W = normal_W / length;
  slots_[i].ready.store(true, std::memory_order_release);
  return true;
}

HandTarget HandScript::target(rt::Nanos since_start) noexcept {
  while (current_ < static_cast<int>(count_) &&
         since_start >= starts_[static_cast<std::size_t>(current_ + 1)]) {
    ++current_;
    enter(static_cast<std::size_t>(current_));
  }
  HandTarget out;
  out.segment = current_;
  out.button = button_;
  out.clutch = clutch_;
  out.p_WT = to_;
  if (current_ < 0 || current_ >= static_cast<int>(count_)) return out;
  const auto i = static_cast<std::size_t>(current_);
  const double time = rt::seconds(starts_[i + 1] - starts_[i]);
  if (from_ == to_ || !(time > 0)) return out;
  const double f = std::clamp(rt::seconds(since_start - starts_[i]) / time, 0.0, 1.0);
  const Blend b = kinds_[i] == Kind::kSlide ? soft_ends(f) : minimum_jerk(f);
  out.p_WT = from_ + b.s * (to_ - from_);
  out.v_WT = (b.ds / time) * (to_ - from_);
  return out;
}

// Segment i starts: the last one has ended where it wanted to.
void HandScript::enter(std::size_t i) noexcept {
  from_ = to_;
  if (i >= count_) return;
  const HandSegmentConfig& c = config_.segments[i];
  const Kind kind = kinds_[i];
  if (kind == Kind::kButtonDown) button_ = true;
  if (kind == Kind::kButtonUp) button_ = false;
  if (kind == Kind::kClutchDown) clutch_ = true;
  if (kind == Kind::kClutchUp) clutch_ = false;
  if (kind != Kind::kMove && kind != Kind::kPress && kind != Kind::kSlide) return;
  const bool own = c.source != "last";
  if (own && !slots_[i].ready.load(std::memory_order_acquire)) {
    ++unresolved_;
    return;  // holds
  }
  if (own) {
    anchor_ = slots_[i].p_W;
    normal_ = slots_[i].normal_W;
  }
  if (kind == Kind::kMove) offset_ = c.standoff_m;
  if (kind == Kind::kPress) offset_ = -c.depth_m;
  to_ = anchor_ + offset_ * normal_;
}

}  // namespace drivers

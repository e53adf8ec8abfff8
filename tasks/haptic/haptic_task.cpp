#include "tasks/haptic/haptic_task.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::Mat3;
using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr double kFarthestHand_m = 10.0;  // beyond it a position is no position

// A mode in which the force is off at once.
bool puts_off(const ModeMsg& mode) noexcept {
  return mode.seq == 0 || mode.mode == Mode::kInit || mode.mode == Mode::kSafeStop;
}

}  // namespace

double HapticTask::take_time(const rt::Tick& tick) noexcept {
  const double since = have_release_ ? rt::seconds(tick.release - last_release_) : period_s_;
  last_release_ = tick.release;
  have_release_ = true;
  return std::clamp(since, 0.1 * period_s_, 0.1);
}

// How far the surface under the hand rises in the blend that begins. Where it goes away from under
// the hand instead, the hand may be let go (SurfaceLeft).
double HapticTask::look_ahead_m() noexcept {
  const Vec3 hand_W = to_world(hand_.p_D());
  return left_.look_ahead_m(
      blend_, contact_.proxy(),
      {hand_W, rendered_W_, SurfaceLeft::kLeaves_m_per_s * config_.scale * config_.blend_s,
       force_limit_N_ * config_.scale / std::max(effects_.stiffness_N_per_m(), 1e-9)});
}

// True: `patch` was refused as malformed.
bool HapticTask::take_patch(const SurfacePatch* patch) noexcept {
  using Taken = SurfaceBlend::Taken;
  const Taken taken = blend_.take(patch);
  if (taken == Taken::kNothing) return false;
  if (taken == Taken::kRefused) return true;
  if (taken == Taken::kOtherMap) {
    contact_.forget();
    gain_.fade_in();
    left_.end();
  }
  const double stiffness = effects_.stiffness_N_per_m();
  const double rise_N = blend_.blending() ? stiffness * look_ahead_m() / config_.scale : 0.0;
  blend_.begin(rise_N, (books_.elastic_D().norm() + 0.5 * rise_N) * rise_N / stiffness);
  // The energy observer (energy.hpp) counts by events, and a patch begins one. A fade is one event,
  // however many patches come in it.
  const double gain = gain_.value();
  if (gain <= 0 || gain >= 1) books_.begin_event();
  return false;
}

// True: what was handed in is malformed; then there is no surface to stand on.
bool HapticTask::take_surface(const SurfacePoints* surface) noexcept {
  if (surface == nullptr) return false;
  const bool good = surface->X_WC.matrix().allFinite() && surface->count <= surface->x.size();
  contact_.stand_on(good ? surface : nullptr);
  return !good;
}

// The hand's position of this tick; false when it is not a number.
bool HapticTask::take_hand(const drivers::StylusSample& stylus, const rt::Tick& tick, double dt,
                           Vec3& dx_D) noexcept {
  if (!finite(stylus.p_DH) || stylus.p_DH.norm() > kFarthestHand_m) return false;
  const bool goes_on = hand_.known();
  dx_D = hand_.take(stylus.p_DH, tick.release, dt);
  if (goes_on) {
    books_.move(guard_.f_D(), dx_D, dt);
  } else {
    books_.forget_hand();
    contact_.forget();
    gain_.disable();
  }
  books_.see(stylus.p_DH);
  return true;
}

// Let go: what is touched next is entered from seen-free space.
void HapticTask::end_leaving() noexcept {
  left_.end();
  contact_.start_again_at(to_world(hand_.p_D()));
  gain_.let_go();
}

// Forces off at once, and the next enable fades in. The proxy stays, but not on a surface that is
// leaving.
void HapticTask::safe(Out& out) noexcept {
  out.telemetry.step_N = guard_.f_D().norm();
  if (left_.leaving()) end_leaving();
  guard_.off();
  books_.off();
  gain_.off();
  out.force.f_H_D = Vec3::Zero();
}

// No sample: the last force is held for the device's liveness, unless the mode has put it off.
// After that forces are off, and the next sample is taken as the first of a hand.
rt::Health HapticTask::without_sample(const rt::Tick& tick, const ModeMsg& mode,
                                      Out& out) noexcept {
  if (puts_off(mode)) safe(out);
  rt::Health health = rt::Health::ok();
  const bool live =
      hand_.known() && rt::seconds(tick.release - hand_.time()) <= config_.device_liveness_s;
  if (live) {
    out.force.f_H_D = guard_.f_D();
    out.telemetry.in_contact = events_.contact() && gain_.enabled();
  } else {
    if (hand_.seen()) health = rt::Health::of(rt::Severity::kRampDown, kFaultHapticDeviceLost);
    hand_.forget();
    workspace_.forget_hand();
    contact_.forget();
    safe(out);
  }
  report(tick, events_.button() && live, out);
  return health;
}

rt::Health HapticTask::not_finite(const rt::Tick& tick, Out& out) noexcept {
  contact_.forget();
  hand_.forget();
  workspace_.forget_hand();
  safe(out);
  report(tick, false, out);
  return rt::Health::of(rt::Severity::kSafeStop, kFaultHapticNotFinite);
}

// The proxy goes towards the hand; the spring between them. Where the surface left, its last plane.
template <bool kEffects>
Spring HapticTask::find_spring(const Vec3& p_WH) noexcept {
  if (left_.leaving()) return left_.spring(p_WH);
  contact_.step(blend_.field(), p_WH);
  if constexpr (kEffects) {
    return effects_.spring(p_WH, contact_,
                           {blend_.field(), blend_.newest(), hand_, events_.contact()});
  } else {
    Spring spring;
    spring.rendered_W = contact_.proxy().rendered_WP();
    spring.pull_W = spring.elastic_W = spring.rendered_W - p_WH;
    spring.length_m = spring.pull_W.norm();
    spring.contact = contact_.touches();
    return spring;
  }
}

// What is to be said of this tick's surface and hand; what is stale is added to `health`.
void HapticTask::observe(const rt::Tick& tick, const In& in, const Vec3& p_WH, bool blending,
                         HapticTelemetry& t, rt::Health& health) const noexcept {
  const Field& field = blend_.field();
  const SurfacePatch* newest = blend_.newest();
  const ProxyState& proxy = contact_.proxy();
  t.held = proxy.held;
  t.leaving = left_.leaving();
  t.near_edge = newest != nullptr && (field.near_edge(p_WH) || field.near_edge(proxy.p_WP()));
  t.unresolved = contact_.thin(field, p_WH);
  t.clutched = in.clutch;
  t.beyond = workspace_.beyond();
  t.patch_age_s = newest != nullptr ? rt::seconds(tick.release - newest->fused) : 0;
  // A blend that the energy budget slows down outlasts the liveness of its patch, and nothing newer
  // is taken before it ends: that says nothing of the publications.
  t.stale = newest != nullptr && !blending && t.patch_age_s > config_.patch_liveness_s;
  if (t.stale) {
    health = rt::worst(health, rt::Health::of(rt::Severity::kDegraded, kFaultHapticPatchStale));
  }
  if (in.surface_stale) {
    t.stale = true;
    health = rt::worst(health, rt::Health::of(rt::Severity::kDegraded, kFaultHapticSurfaceStale));
  }
}

// Spring and effects, faded -> force limit -> the books -> passivity, force limit -> guard (which
// ends with the force limit).
template <bool kEffects>
void HapticTask::render(const In& in, const Spring& spring, const Motion& motion,
                        Out& out) noexcept {
  HapticTelemetry& t = out.telemetry;
  t.in_contact = spring.contact;
  const double stiffness = effects_.stiffness_N_per_m(), gain_before = gain_.value();
  const bool ramp_down =
      t.stale || TouchRules::clutch_fades(in.clutch) || in.mode.mode == Mode::kRampDown;
  t.gain = gain_.advance({ramp_down, contact_.touches(), contact_.proxy().started_inside,
                          left_.leaving(), books_.pace()},
                         motion.dt);
  const double to_N_per_m = t.gain * stiffness / config_.scale;
  const Mat3 R_DW = workspace_.R_WD().transpose();
  Vec3 f = Vec3::Zero(), elastic_D = Vec3::Zero();
  if (spring.contact) {
    f = to_N_per_m * (R_DW * spring.pull_W);
    elastic_D = to_N_per_m * (R_DW * spring.elastic_W);
  }
  if constexpr (kEffects) {
    t.friction_N = effects_.friction_N(spring);
    f += effects_.drag_D(t.gain, hand_.v_D());
  }
  const double size = f.norm();
  t.limit_active = size > force_limit_N_;
  if (t.limit_active) f *= force_limit_N_ / size;
  // Where not only the hand moved, the spring gained what the hand's motion does not explain.
  using Mover = EnergyBooks::Mover;
  const bool more =
      t.gain != gain_before || stiffness != motion.stiffness_before_N_per_m || workspace_.moved();
  const Mover mover = more ? Mover::kMore : motion.surface_moves ? Mover::kSurface : Mover::kHand;
  const EnergyBooks::Entry entry{spring,    elastic_D, motion.dx_D, t.gain,
                                 stiffness, mover,     motion.dt};
  books_.book(entry, contact_, blend_.field());
  if (t.in_contact) {
    Vec3 allowed = f;
    if (books_.make_passive(allowed, size, entry)) {
      t.controller_N = (allowed - f).norm();
      f = limited(allowed, force_limit_N_);
    }
  }
  out.force.f_H_D = guard_.guard(f, {motion.dx_D, blend_.steps(), in.clutch}, t);
}

// Events and state of this tick, whatever became of it.
void HapticTask::report(const rt::Tick& tick, bool button, Out& out) noexcept {
  HapticTelemetry& t = out.telemetry;
  const ProxyState& proxy = contact_.proxy();
  events_.tell({tick.release, t.in_contact, button, left_.take_told(), out.force.f_H_D}, proxy,
               {out.events, out.event_count});
  const SurfacePatch* newest = blend_.newest();
  HapticState& s = out.state;
  s.seq = ++state_seq_;
  s.stamp = tick.release;
  s.p_WH = hand_.known() ? to_world(hand_.p_D()) : Vec3::Zero();
  s.v_WH = workspace_.R_WD() * (config_.scale * hand_.v_D());
  s.p_WP = hand_.known() && newest != nullptr ? rendered_W_ : s.p_WH;
  s.f_H_W = workspace_.R_WD() * out.force.f_H_D;
  s.normal_W = t.in_contact ? proxy.normal_W() : Vec3::Zero();
  s.contacts = t.in_contact ? proxy.contacts : 0;
  s.button = button;
  s.patch_seq = newest != nullptr ? newest->seq : 0;
  s.mark_seq = events_.mark_seq();
  s.p_mark_W = events_.mark_begin_W();
  t.energy_J = books_.observer().energy_J();
  t.booked_J = books_.observer().booked_J();
  t.credit_J = books_.observer().credit_J();
  t.blend = blend_.share();
  t.reach = hand_.known() ? hand_.p_D().norm() / device_radius_m_ : 0;
  t.work = blend_.field().take_work();
}

template <bool kEffects>
rt::Health HapticTask::cycle(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out = Out{};
  const double dt = take_time(tick);
  rt::Health health = rt::Health::ok();
  if (take_patch(in.patch_newest)) {
    health = rt::Health::of(rt::Severity::kDegraded, kFaultHapticBadPatch);
  }
  if (take_surface(in.surface)) {
    health = rt::Health::of(rt::Severity::kDegraded, kFaultHapticBadPatch);
  }
  const bool blending = blend_.blending();
  if (blending) blend_.advance(dt, books_.pace());
  if (!in.stylus_ok) return rt::worst(health, without_sample(tick, in.mode, out));

  Vec3 dx_D;
  if (!take_hand(in.stylus, tick, dt, dx_D)) return not_finite(tick, out);
  const Vec3 p_WH = workspace_.advance(hand_.p_D(), TouchRules::clutch_holds_hand(in.clutch),
                                       in.view_yaw_rad, dt);
  const double stiffness_before = effects_.stiffness_N_per_m();
  contact_.begin_tick();
  const Spring spring = find_spring<kEffects>(p_WH);
  rendered_W_ = spring.rendered_W;
  if (!finite(spring.pull_W)) return not_finite(tick, out);

  observe(tick, in, p_WH, blending, out.telemetry, health);
  const bool allowed = !puts_off(in.mode) && blend_.newest() != nullptr &&
                       in.stylus.state == drivers::DeviceState::kForce;
  if (!allowed) {
    safe(out);
  } else {
    out.telemetry.penetration_m = spring.contact ? (rendered_W_ - p_WH).norm() : 0;
    render<kEffects>(in, spring, {dx_D, blending, stiffness_before, dt}, out);
    if (left_.leaving() && (gain_.ramp() <= 0 || !spring.contact)) end_leaving();
  }
  report(tick, in.stylus.button, out);
  return health;
}

rt::Health HapticTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  if constexpr (TouchRules::kEffects) {
    if (effects_.any()) return cycle<true>(tick, in, out);
  }
  return cycle<false>(tick, in, out);
}

}  // namespace tasks

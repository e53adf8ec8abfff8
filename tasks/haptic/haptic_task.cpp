#include "tasks/haptic/haptic_task.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::SurfacePatch;
using perception::Vec3;

namespace {

// Blend and fade beyond what may be put into the spring.
// chosen on: not recorded; judged on: stability 12, 13, 14, 17, 20
constexpr double kSlowed = 0.25;

// A surface that rises by more than this over one period under a hand, and hardly did over the last one, steps. One that
// moves at 100 mm/s adds 100 N/s at 1 N/mm.
// chosen on: not recorded; judged on: stability 12, 13, 14, 17, 20
constexpr double kStep_N_per_s = 130, kGoesOn = 0.25;

// What puts more into the spring of a hand that stands is slowed for that, and would come too late.
constexpr double kStepMost_J = 0.05;  // derived: the budget of an event (energy.hpp)

// A step's blend lasts so many periods: at 30 Hz it is felt whole within 50 ms of its publication. It is quick at its ends, as near
// to the slew guard's 300 N/s as it can be without meeting it, and slow between: this much of the way. A hand that yields
// meanwhile takes less energy, the least where it is quick at the ends alone.
// chosen on: stability 12, 20; judged on: nothing else
constexpr double kStepPeriods = 1.46;
constexpr double kStepQuick_N_per_s = 270, kStepBetween = 0.06;

// The hand is let go in this time.
constexpr double kLeave_s = 0.045;  // derived: less than 0.3 N a tick from 12 N

// Share of a step's blend. `quick`: how much faster its ends go than it does on average.
double step_share(double time, double quick) noexcept {
  constexpr double kEnd = 0.5 * (1 - kStepBetween);
  const double ends = kEnd / quick;  // of the time, each
  if (!(ends < kEnd)) return time;   // so high that all of it has to be quick
  const double slow = kStepBetween / (1 - 2 * ends);
  return quick * (std::min(time, ends) + std::max(0.0, time - 1 + ends)) +
         slow * (std::clamp(time, ends, 1 - ends) - ends);
}

bool finite(const Vec3& v) noexcept {
  return std::isfinite(v.x()) && std::isfinite(v.y()) && std::isfinite(v.z());
}

// A patch that the field can be built on; anything else is refused, not clamped.
bool well_formed(const SurfacePatch& p) noexcept {
  return p.seq > 0 && p.nodes >= 8 && p.nodes <= SurfacePatch::kMaxNodes && p.nodes % 4 == 0 &&
         std::isfinite(p.voxel_size) && p.voxel_size >= 1e-4 && p.voxel_size <= 1.0 &&
         std::isfinite(p.metres_per_unit) && p.metres_per_unit > 0;
}

Vec3 limited(const Vec3& f, double limit) noexcept {
  const double norm = f.norm();
  return norm > limit ? Vec3(f * (limit / norm)) : f;
}

// Energy of a spring whose force is cut at `limit`.
double spring_energy(double stiffness, double stretch, double limit) noexcept {
  const double knee = limit / stiffness;
  return stretch <= knee ? 0.5 * stiffness * stretch * stretch
                         : 0.5 * stiffness * knee * knee + limit * (stretch - knee);
}

}  // namespace

// Every pointer handed in is one acquire of the channel: what was taken before the last one is
// about to be reused, whether or not this task liked what came since. True: `patch` was refused as
// malformed.
bool HapticTask::take_patch(const SurfacePatch* patch) noexcept {
  if (patch == nullptr || !wants_patch() || patch == newer_) return false;
  if (!well_formed(*patch)) {
    if (patch->seq == 0) return false;  // nothing published yet
    blend_allowed_ = false;
    return true;
  }
  const bool same_map = newer_ != nullptr && patch->map_id == newer_->map_id;
  const bool blends = same_map && blend_allowed_ && config_.blend_s > 0 &&
                      patch->seq != newer_->seq && Field::compatible(*newer_, *patch);
  if (newer_ != nullptr && !same_map) {
    proxy_ = ProxyState{};  // another map: old places mean nothing in it
    fade_ = 0;
    leaving_ = false;
  }
  older_ = blends ? newer_ : nullptr;
  newer_ = patch;
  blend_ = blend_time_ = blends ? 0.0 : 1.0;
  blend_allowed_ = true;
  const double last_N = rise_N_;
  rise_N_ = blends ? stiffness_ * look_ahead_m() / config_.scale : 0.0;
  const double before_N = f_elastic_D_.norm();
  const double held_J = (before_N + 0.5 * rise_N_) * rise_N_ / stiffness_;
  steps_ = rise_N_ > kStep_N_per_s * config_.blend_s && std::abs(last_N) < kGoesOn * rise_N_ &&
           held_J < kStepMost_J;
  const double gain = fade_ * ramp_;
  if (gain <= 0 || gain >= 1) energy_.begin_event();  // a fade is one event, as long as it takes
  field_.set(older_, newer_, blend_);
  return false;
}

// True: what was handed in is malformed; then there is no surface to stand on.
bool HapticTask::take_surface(const SurfacePoints* surface) noexcept {
  if (surface == nullptr) return false;
  const bool good = surface->X_WC.matrix().allFinite() && surface->count <= surface->x.size();
  proxy_config_.surface = good ? surface : nullptr;
  return !good;
}

void HapticTask::advance_blend(double dt) noexcept {
  if (older_ == nullptr) return;
  const double slow = energy_.over_budget() ? kSlowed : 1.0;
  // Half a tick short of the period: 30 Hz patches find the last blend finished.
  const double lasting =
      std::max((steps_ ? kStepPeriods : 1.0) * config_.blend_s - 0.5 * dt, 0.5 * dt);
  blend_time_ = std::min(1.0, blend_time_ + slow * dt / lasting);
  blend_ = steps_ ? step_share(blend_time_, kStepQuick_N_per_s * lasting / rise_N_) : blend_time_;
  if (blend_time_ > 1.0 - 1e-9) {
    blend_ = 1.0;
    older_ = nullptr;
  }
  field_.set(older_, newer_, blend_);
}

// Fade-in and ramps as one gain. `ramp_down` pulls to zero, recovery climbs as a fade-in does.
double HapticTask::advance_gain(bool ramp_down, double dt) noexcept {
  const double slow = energy_.over_budget() ? kSlowed : 1.0;
  const double up = config_.fade_in_s > 0 ? slow * dt / config_.fade_in_s : 1.0;
  if (!enabled_) {
    enabled_ = true;
    fade_ = proxy_.phase == ProxyState::Phase::kContact ? 0.0 : 1.0;
    ramp_ = ramp_down ? 0.0 : 1.0;
  }
  if (proxy_.started_inside) fade_ = 0;
  if (leaving_) {  // neither climbs meanwhile
    ramp_ = std::max(0.0, ramp_ - dt / kLeave_s);
    return fade_ * ramp_;
  }
  fade_ = std::min(1.0, fade_ + up);
  ramp_ = std::clamp(ramp_ + (ramp_down ? -dt / config_.ramp_s : up), 0.0, 1.0);
  return fade_ * ramp_;
}

// How far the force may go this tick: max(slew T, 1.1 K |dh|), and less under a hand that is nearly
// still. There the surface alone turns the force, and what turns it thirty times a second is noise;
// only where the surface steps, or the size of the force is more than 1 N behind, it goes at the full rate.
double HapticTask::slew_limit(const Vec3& change, double dh) const noexcept {
  constexpr double kCalmRise_N_per_m = 1000;  // a soft spring's hand is not stiller for it
  const double moved = config_.stiffness_N_per_m * dh;
  const double most = std::max(config_.slew_N_per_s * period_s_, 1.1 * moved);
  if (steps_) return most;
  const double calm = std::min(
      config_.slew_calm_N_per_s * period_s_ + 2 * std::max(moved, kCalmRise_N_per_m * dh), most);
  const double size = f_D_.norm();
  const double along = size > 0.1 ? std::abs(change.dot(f_D_)) / size : change.norm();
  return calm + (most - calm) * std::clamp(along - 1.0, 0.0, 1.0);
}

// Energy that the surface, a fade or a moving workspace put into the spring: what it holds more than the hand's
// motion against its own force explains. Friction, viscosity and the controller only take energy out, so they have
// no part in it.
// A proxy that slips over an edge or lets go loses what its spring held: that is dissipated, and no surface took more of it than it went back.
void HapticTask::book(const Spring& spring, double to_N_per_m, Mover mover, const Vec3& dx_D,
                      double dt) noexcept {
  const Vec3 before = f_elastic_D_;
  f_elastic_D_ =
      spring.contact
          ? limited(to_N_per_m * (workspace_.R_WD().transpose() * spring.elastic_W), force_limit_N_)
          : Vec3::Zero();
  const double gain = fade_ * ramp_;
  const double spring_J =
      gain > 0 && spring.contact
          ? gain * spring_energy(stiffness_, spring.length_m / config_.scale, force_limit_N_ / gain)
          : 0;
  double injected =
      mover != Mover::kHand ? spring_J - spring_J_ + 0.5 * (before + f_elastic_D_).dot(dx_D) : 0;
  constexpr double kSlip_J = 1e-4;
  constexpr double kSharpest = 4;  // the apex of a crease goes so much farther than its faces
  if (injected < -kSlip_J && mover == Mover::kSurface) {
    const double back = gone_back(field_, rested_W_, proxy_config_.tip_radius_m);
    injected = std::max(injected, -kSharpest * before.norm() * back / config_.scale);
  }
  energy_.book(injected, spring_J - spring_J_, dt);
  spring_J_ = spring_J;
}

// Slew guard; fills force and telemetry, and remembers both forces.
void HapticTask::guard_force(const Vec3& f_D, const Vec3& dx_D, bool clutch, Out& out) noexcept {
  HapticTelemetry& t = out.telemetry;
  const double dh = dx_D.norm();
  Vec3 f = f_D;
  t.f_raw_D = f;
  t.step_raw_N = (f - f_raw_D_).norm();
  t.guard_use = t.in_contact && t.step_raw_N > config_.stiffness_N_per_m * dh + 0.1;
  f_raw_D_ = f;
  const Vec3 change = f - f_D_;
  const double size = change.norm(), most = slew_limit(change, dh);
  if (config_.guard && size > most) {
    f = f_D_ + change * (most / size);
    t.guard_active = true;
  }
  f = limited(f, force_limit_N_);
  t.step_N = (f - f_D_).norm();
  f_D_ = TouchRules::behind_guard(f, clutch);
  out.force.f_H_D = f_D_;
}

// Spring and effects -> force limit -> the books -> passivity -> guard.
template <bool kEffects>
void HapticTask::render(const In& in, const Vec3& dx_D, const Spring& spring, bool surface_moves,
                        double stiffness_before, double dt, Out& out) noexcept {
  HapticTelemetry& t = out.telemetry;
  t.in_contact = spring.contact;
  const double gain_before = fade_ * ramp_;
  t.gain = advance_gain(
      t.stale || TouchRules::clutch_fades(in.clutch) || in.mode.mode == Mode::kRampDown, dt);
  const double to_N_per_m = t.gain * stiffness_ / config_.scale;
  Vec3 f = t.in_contact ? Vec3(to_N_per_m * (workspace_.R_WD().transpose() * spring.pull_W))
                        : Vec3(Vec3::Zero());
  if constexpr (kEffects) f += viscous(spring, t);
  const double size = f.norm();
  t.limit_active = size > force_limit_N_;
  if (t.limit_active) f *= force_limit_N_ / size;
  // Where not only the hand moved, the spring gained what the hand's motion does not explain.
  const bool more = t.gain != gain_before || stiffness_ != stiffness_before || workspace_.moved();
  const Mover mover = more ? Mover::kMore : surface_moves ? Mover::kSurface : Mover::kHand;
  book(spring, to_N_per_m, mover, dx_D, dt);
  if (config_.passivity_controller && t.in_contact &&
      !passivity_.idle(f, std::min(size, force_limit_N_), dx_D, energy_.reserve_J(), spring_J_,
                       dt)) {
    const Vec3 allowed =
        passivity_.limited(f, dx_D, energy_.reserve_J(), spring_J_, stiffness_, dt);
    t.controller_N = (allowed - f).norm();
    f = limited(allowed, force_limit_N_);
  }
  guard_force(f, dx_D, in.clutch, out);
}

// Forces off at once; what is remembered of the surface stays, and the next enable fades in.
void HapticTask::safe(Out& out) noexcept {
  out.telemetry.step_N = f_D_.norm();
  if (leaving_) end_leaving();
  f_D_ = f_raw_D_ = f_elastic_D_ = Vec3::Zero();
  enabled_ = false;
  fade_ = ramp_ = 0;
  spring_J_ = 0;
  out.force.f_H_D = Vec3::Zero();
}

void HapticTask::emit(Out& out, TouchEvent::Kind kind, const rt::Tick& tick) noexcept {
  if (out.event_count >= static_cast<std::int32_t>(out.events.size())) return;
  TouchEvent& e = out.events[static_cast<std::size_t>(out.event_count++)];
  e = TouchEvent{};
  e.seq = ++event_seq_;
  e.stamp = tick.release;
  e.kind = kind;
  e.p_W = proxy_.p_WP();
  e.normal_W = proxy_.normal_W();
  e.force_N = out.force.f_H_D.norm();
}

// At most four a tick: a contact begins and its mark with it, or the reverse.
void HapticTask::events(const rt::Tick& tick, bool button, Out& out) noexcept {
  using Kind = TouchEvent::Kind;
  const bool contact = out.telemetry.in_contact;
  if (contact && !was_contact_) emit(out, Kind::kContactBegin, tick);
  if (left_) emit(out, Kind::kSurfaceLeft, tick);
  left_ = false;
  if (marking_ && (!contact || !button)) {
    emit(out, Kind::kMarkEnd, tick);
    marking_ = false;
  }
  if (contact && button && !was_button_ && !marking_) {
    emit(out, Kind::kMarkBegin, tick);
    marking_ = true;
    mark_p_W_ = mark_begin_W_ = proxy_.p_WP();
    mark_seq_ = event_seq_;
    mark_time_ = tick.release;
  } else if (marking_ && ((proxy_.p_WP() - mark_p_W_).norm() >= config_.mark_spacing_m ||
                          rt::seconds(tick.release - mark_time_) >= 1.0 / config_.mark_rate_hz)) {
    emit(out, Kind::kMarkPoint, tick);
    mark_p_W_ = proxy_.p_WP();
    mark_time_ = tick.release;
  }
  if (!contact && was_contact_) emit(out, Kind::kContactEnd, tick);
  was_contact_ = contact;
  was_button_ = button;
}

void HapticTask::report(const rt::Tick& tick, bool button, Out& out) noexcept {
  HapticState& s = out.state;
  s.seq = ++state_seq_;
  s.stamp = tick.release;
  s.p_WH = have_hand_ ? to_world(h_D_) : Vec3::Zero();
  s.v_WH = workspace_.R_WD() * (config_.scale * v_D_);
  s.p_WP = have_hand_ && newer_ != nullptr ? rendered_W_ : s.p_WH;
  s.f_H_W = workspace_.R_WD() * out.force.f_H_D;
  s.normal_W = out.telemetry.in_contact ? proxy_.normal_W() : Vec3::Zero();
  s.contacts = out.telemetry.in_contact ? proxy_.contacts : 0;
  s.button = button;
  s.patch_seq = newer_ != nullptr ? newer_->seq : 0;
  s.mark_seq = mark_seq_;
  s.p_mark_W = mark_begin_W_;
  HapticTelemetry& t = out.telemetry;
  t.energy_J = energy_.energy_J();
  t.booked_J = energy_.booked_J();
  t.credit_J = energy_.credit_J();
  t.blend = blend_;
  t.reach = have_hand_ ? h_D_.norm() / device_radius_m_ : 0;
  t.work = field_.take_work();
}

// No sample: the last force is held for its liveness, unless the mode has put it off; then forces are off and the
// hand is new again.
rt::Health HapticTask::without_sample(const rt::Tick& tick, const ModeMsg& mode,
                                      Out& out) noexcept {
  if (mode.seq == 0 || mode.mode == Mode::kInit || mode.mode == Mode::kSafeStop) safe(out);
  rt::Health health = rt::Health::ok();
  const bool live =
      have_hand_ && rt::seconds(tick.release - hand_time_) <= config_.device_liveness_s;
  if (live) {
    out.force.f_H_D = f_D_;
    out.telemetry.in_contact = was_contact_ && enabled_;
  } else {
    if (seen_hand_) health = rt::Health::of(rt::Severity::kRampDown, kFaultHapticDeviceLost);
    have_hand_ = false;
    workspace_.forget_hand();
    proxy_ = ProxyState{};
    safe(out);
  }
  events(tick, was_button_ && live, out);
  report(tick, was_button_ && live, out);
  return health;
}

// The hand's position of this tick; false when it is not a number.
bool HapticTask::take_hand(const drivers::StylusSample& stylus, const rt::Tick& tick, double dt,
                           Vec3& dx_D) noexcept {
  dx_D = Vec3::Zero();
  if (!finite(stylus.p_DH) || stylus.p_DH.norm() > kFarthestHand_m) return false;
  if (have_hand_) {
    dx_D = stylus.p_DH - h_D_;
    constexpr double kVelocityTime_s = 0.01;
    v_D_ += (dx_D / dt - v_D_) * std::min(1.0, dt / kVelocityTime_s);
    energy_.move(f_D_, dx_D);
    energy_.credit(credit_N_s_per_m_ * dx_D.squaredNorm() / dt);
  } else {
    v_D_ = Vec3::Zero();
    passivity_.forget();
    proxy_ = ProxyState{};
    enabled_ = false;
  }
  if (config_.passivity_controller) passivity_.see(stylus.p_DH);
  have_hand_ = seen_hand_ = true;
  h_D_ = stylus.p_DH;
  hand_time_ = tick.release;
  return true;
}

// Less than a voxel of solid under the proxy, or a sheet before the hand that the samples hold no
// solid of: such a wall is not to be relied on.
bool HapticTask::thin(const Vec3& p_WH) const noexcept {
  const double voxel = field_.voxel();
  if (proxy_.phase == ProxyState::Phase::kContact) {
    return field_.sample(proxy_.p_WP() - voxel * proxy_.normal_W()).value > 0;
  }
  if (field_.empty() || proxy_.phase != ProxyState::Phase::kFree) return false;
  const FieldSample here = field_.sample(p_WH);
  const double slope = here.gradient.norm();
  if (!here.known || here.value > 0.5 * voxel || slope < 0.3) return false;
  return field_.sample(p_WH - (voxel / slope) * here.gradient).value > 0;
}

rt::Health HapticTask::not_finite(const rt::Tick& tick, Out& out) noexcept {
  proxy_ = ProxyState{};
  have_hand_ = false;
  workspace_.forget_hand();
  safe(out);
  events(tick, false, out);
  report(tick, false, out);
  return rt::Health::of(rt::Severity::kSafeStop, kFaultHapticNotFinite);
}

template <bool kEffects>
rt::Health HapticTask::cycle(const rt::Tick& tick, const In& in, Out& out) noexcept {
  out = Out{};
  const double since = have_release_ ? rt::seconds(tick.release - last_release_) : period_s_;
  const double dt = std::clamp(since, 0.1 * period_s_, 0.1);
  last_release_ = tick.release;
  have_release_ = true;

  rt::Health health = rt::Health::ok();
  if (take_patch(in.patch_newest)) {
    health = rt::Health::of(rt::Severity::kDegraded, kFaultHapticBadPatch);
  }
  if (take_surface(in.surface)) {
    health = rt::Health::of(rt::Severity::kDegraded, kFaultHapticBadPatch);
  }
  const bool blending = older_ != nullptr;
  advance_blend(dt);
  if (!in.stylus_ok) return rt::worst(health, without_sample(tick, in.mode, out));

  Vec3 dx_D;
  if (!take_hand(in.stylus, tick, dt, dx_D)) {
    return not_finite(tick, out);
  }
  const Vec3 p_WH =
      workspace_.advance(h_D_, TouchRules::clutch_holds_hand(in.clutch), in.view_yaw_rad, dt);
  const double stiffness_before = stiffness_;
  rested_W_ = proxy_.p_WP();
  if (!leaving_) proxy_step_(field_, p_WH, proxy_, proxy_config_);
  Spring spring;
  if (leaving_) {
    spring = held_spring(p_WH);
  } else if constexpr (kEffects) {
    spring = spring_of(p_WH);
  } else {
    rendered_W_ = proxy_.rendered_WP();
    spring.pull_W = spring.elastic_W = rendered_W_ - p_WH;
    spring.length_m = spring.pull_W.norm();
    spring.contact = proxy_.phase == ProxyState::Phase::kContact;
  }
  if (!finite(spring.pull_W)) {
    return not_finite(tick, out);
  }

  HapticTelemetry& t = out.telemetry;
  t.held = proxy_.held;
  t.leaving = leaving_;
  t.near_edge = newer_ != nullptr && (field_.near_edge(p_WH) || field_.near_edge(proxy_.p_WP()));
  t.unresolved = thin(p_WH);
  t.clutched = in.clutch;
  t.beyond = workspace_.beyond();
  t.patch_age_s = newer_ != nullptr ? rt::seconds(tick.release - newer_->fused) : 0;
  // A blend that the energy budget slows down outlasts the liveness of its patch, and nothing newer is taken before it
  // ends: that says nothing of the publications.
  t.stale = newer_ != nullptr && !blending && t.patch_age_s > config_.patch_liveness_s;
  if (t.stale) {
    health = rt::worst(health, rt::Health::of(rt::Severity::kDegraded, kFaultHapticPatchStale));
  }
  if (in.surface_stale) {
    t.stale = true;
    health = rt::worst(health, rt::Health::of(rt::Severity::kDegraded, kFaultHapticSurfaceStale));
  }
  const bool allowed = in.mode.seq > 0 && newer_ != nullptr &&
                       in.stylus.state == drivers::DeviceState::kForce &&
                       in.mode.mode != Mode::kInit && in.mode.mode != Mode::kSafeStop;
  if (!allowed) {
    safe(out);
  } else {
    t.penetration_m = spring.contact ? (rendered_W_ - p_WH).norm() : 0;
    render<kEffects>(in, dx_D, spring, blending, stiffness_before, dt, out);
    if (leaving_ && (ramp_ <= 0 || !spring.contact)) end_leaving();
  }
  events(tick, in.stylus.button, out);
  report(tick, in.stylus.button, out);
  return health;
}

rt::Health HapticTask::step(const rt::Tick& tick, const In& in, Out& out) noexcept {
  if constexpr (TouchRules::kEffects) {
    if (effects_) return cycle<true>(tick, in, out);
  }
  return cycle<false>(tick, in, out);
}

}  // namespace tasks

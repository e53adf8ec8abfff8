#include "tasks/haptic/surface_blend.hpp"

#include <algorithm>
#include <cmath>

namespace tasks {

using perception::SurfacePatch;

namespace {

// A surface that rises by more than this over one period under a hand, and hardly did over the last
// one, steps. One that moves at 100 mm/s adds 100 N/s at 1 N/mm.
// chosen on: not recorded; judged on: stability 12, 13, 14, 17, 20
constexpr double kStep_N_per_s = 130, kGoesOn = 0.25;

// A rise that would put more energy than this into the spring is not blended as a step: the energy
// budget would slow it until it came too late.
constexpr double kStepMost_J = 0.05;  // derived: the budget of an event (energy.hpp)

// A step's blend lasts so many periods: at 30 Hz it is felt whole within 50 ms of its publication.
// It is quick at its ends (kStepQuick_N_per_s), as near to the slew guard's 300 N/s as it can be
// without meeting it, and slow between, where it goes the share kStepBetween of the way. Of all
// blends as long, one that is quick at its ends alone gives the least energy to a hand that yields.
// chosen on: stability 12, 20; judged on: nothing else
constexpr double kStepPeriods = 1.46;
constexpr double kStepQuick_N_per_s = 270, kStepBetween = 0.06;

// Share of a step's blend. `quick`: how much faster its ends go than it does on average.
double step_share(double time, double quick) noexcept {
  constexpr double kEnd = 0.5 * (1 - kStepBetween);
  const double ends = kEnd / quick;  // of the time, each
  if (!(ends < kEnd)) return time;   // so high that all of it has to be quick
  const double slow = kStepBetween / (1 - 2 * ends);
  return quick * (std::min(time, ends) + std::max(0.0, time - 1 + ends)) +
         slow * (std::clamp(time, ends, 1 - ends) - ends);
}

// A patch that the field can be built on; anything else is refused, not clamped.
bool well_formed(const SurfacePatch& p) noexcept {
  return p.seq > 0 && p.nodes >= 8 && p.nodes <= SurfacePatch::kMaxNodes && p.nodes % 4 == 0 &&
         std::isfinite(p.voxel_size) && p.voxel_size >= 1e-4 && p.voxel_size <= 1.0 &&
         std::isfinite(p.metres_per_unit) && p.metres_per_unit > 0;
}

}  // namespace

SurfaceBlend::Taken SurfaceBlend::take(const SurfacePatch* patch) noexcept {
  if (patch == nullptr || !wants_patch() || patch == newer_) return Taken::kNothing;
  if (!well_formed(*patch)) {
    if (patch->seq == 0) return Taken::kNothing;  // nothing published yet
    allowed_ = false;
    return Taken::kRefused;
  }
  const bool first = newer_ == nullptr, same_map = !first && patch->map_id == newer_->map_id;
  const bool blends = same_map && allowed_ && blend_s_ > 0 && patch->seq != newer_->seq &&
                      Field::compatible(*newer_, *patch);
  older_ = blends ? newer_ : nullptr;
  newer_ = patch;
  share_ = time_ = blends ? 0.0 : 1.0;
  allowed_ = true;
  return first || same_map ? Taken::kOnward : Taken::kOtherMap;
}

void SurfaceBlend::begin(double rise_N, double held_J) noexcept {
  const double last_N = rise_N_;
  rise_N_ = rise_N;
  steps_ = rise_N_ > kStep_N_per_s * blend_s_ && std::abs(last_N) < kGoesOn * rise_N_ &&
           held_J < kStepMost_J;
  field_.set(older_, newer_, share_);
}

void SurfaceBlend::advance(double dt, double pace) noexcept {
  if (older_ == nullptr) return;
  // Half a tick short of the period: 30 Hz patches find the last blend finished.
  const double lasting = std::max((steps_ ? kStepPeriods : 1.0) * blend_s_ - 0.5 * dt, 0.5 * dt);
  time_ = std::min(1.0, time_ + pace * dt / lasting);
  share_ = steps_ ? step_share(time_, kStepQuick_N_per_s * lasting / rise_N_) : time_;
  if (time_ > 1.0 - 1e-9) {
    share_ = 1.0;
    older_ = nullptr;
  }
  field_.set(older_, newer_, share_);
}

}  // namespace tasks

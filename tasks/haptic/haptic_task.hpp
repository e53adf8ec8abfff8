// Haptic rendering, 1 kHz: stylus position in, force on the hand out, in the same tick.
//
//   sense   StylusSample          from drivers/haptic      outside step()
//   reads   Latest<SurfacePatch>  from tasks/fusion        retains 2; force ramps to zero
//                                                          when none is published for 100 ms
//           Latest<SurfacePoints> from tasks/fusion        method force_shading alone; same ramp
//           Latest<CameraPose>    from tasks/fusion        a clutch that turns with the view
//           Latest<ModeMsg>       from tasks/supervision
//   writes  HapticState           to tasks/fusion          every tick
//           Ring<TouchEvent>      to tasks/planning        0..4 a tick
//   act     ForceCommand          to drivers/haptic        outside step()
//   budget  100 us of the 1 ms period
//
// Pipeline, one type each:
//   position         Hand, Workspace
//   field            SurfaceBlend   two patches, blended over one fusion period, a step of the
//                                   surface over 1.46
//   proxy            Contact        SurfaceLeft while the surface goes from under the hand
//   spring           from hand to proxy; SurfaceEffects where friction, texture or materials are
//                    asked for
//   fade and ramps   ForceGain
//   force limit
//   energy           EnergyBooks    observer and passivity controller
//   slew guard       SlewGuard
//   events           TouchEvents
// Stiffness, force and energy are those at the device: F_D = K (p_WP - p_WH) / scale, turned into
// D. Frames: W world (= map), D haptic base, H stylus tip, P proxy.  SI.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "drivers/haptic/haptic_device.hpp"
#include "perception/patch/surface_patch.hpp"
#include "rt/clock/tick.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/haptic/contact.hpp"
#include "tasks/haptic/energy_books.hpp"
#include "tasks/haptic/force_gain.hpp"
#include "tasks/haptic/force_shading.hpp"
#include "tasks/haptic/hand.hpp"
#include "tasks/haptic/haptic_config.hpp"
#include "tasks/haptic/haptic_telemetry.hpp"
#include "tasks/haptic/slew_guard.hpp"
#include "tasks/haptic/surface_blend.hpp"
#include "tasks/haptic/surface_effects.hpp"
#include "tasks/haptic/surface_left.hpp"
#include "tasks/haptic/touch_events.hpp"
#include "tasks/haptic/workspace.hpp"

namespace tasks {

// Fault ids of this task (docs/faults.md). A sample missing for less than the device's liveness is
// no fault.
inline constexpr rt::FaultId kFaultHapticNotFinite = 101;   // NaN in or out: zero force
inline constexpr rt::FaultId kFaultHapticPatchStale = 102;  // no publication for the liveness time
inline constexpr rt::FaultId kFaultHapticDeviceLost = 103;  // no stylus sample for its liveness
inline constexpr rt::FaultId kFaultHapticBadPatch = 104;    // malformed patch or ray cast refused
inline constexpr rt::FaultId kFaultHapticSurfaceStale = 105;  // no ray cast for its liveness time

class HapticTask {
 public:
  struct In {
    drivers::StylusSample stylus;
    bool stylus_ok = false;  // sense() gave a sample this tick
    // The newest published patch, only looked at when wants_patch() was true before this step; may
    // be null. A pointer handed in must stay valid until the second one after it is handed in
    // (Latest with two retained values, acquired only while wants_patch()).
    const perception::SurfacePatch* patch_newest = nullptr;
    // Method force_shading: the newest ray cast, null = as before. It stays valid until another is
    // handed in (Latest with one retained value, acquired at the latch and handed in at every
    // step).
    const SurfacePoints* surface = nullptr;
    bool surface_stale = false;  // none was published for its liveness: the force ramps to zero
    // seq 0 = none yet. One that is too old comes as a ramp down, and so does a hold with a cause.
    ModeMsg mode;
    bool clutch = false;  // held: forces fade out, the device moves, the hand in the scene does not
    std::optional<double> view_yaw_rad;  // taken over while the clutch is held (yaw_of_view())
  };
  struct Out {
    drivers::ForceCommand force;
    HapticState state;
    std::array<TouchEvent, 4> events{};
    std::int32_t event_count = 0;
    HapticTelemetry telemetry;
  };

  // Throws std::runtime_error naming both figures: stiffness above the device's limit at this
  // period, a window whose half-extent is below speed limit x scale x 100 ms + 50 mm, bad method
  // name. `window_half_extent_m` 0: not checked.
  HapticTask(rt::NonRealtime&, const HapticConfig&, const drivers::DeviceProperties&,
             double period_s, double window_half_extent_m = 0);

  // No blend is running: the graph should acquire the newest patch for the next step.
  [[nodiscard]] bool wants_patch() const noexcept { return blend_.wants_patch(); }

  // One cycle. No throw, lock, allocation or I/O. `out` is overwritten.
  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;

  [[nodiscard]] const ProxyState& proxy() const noexcept { return contact_.proxy(); }
  [[nodiscard]] const Field& field() const noexcept { return blend_.field(); }
  [[nodiscard]] const HapticConfig& config() const noexcept { return config_; }
  // Down to which depth a bump is felt as high as it is (effects.hpp), scene metres; infinite
  // without bumps.
  [[nodiscard]] double texture_reach_m() const noexcept { return effects_.texture_reach_m(); }
  [[nodiscard]] const Workspace& workspace() const noexcept { return workspace_; }
  // p_WH = X_WD * (scale * p_DH), X_WD as of the last step.
  [[nodiscard]] perception::Vec3 to_world(const perception::Vec3& p_DH) const noexcept {
    return workspace_.to_world(p_DH);
  }
  [[nodiscard]] perception::Vec3 to_device(const perception::Vec3& p_W) const noexcept {
    return workspace_.to_device(p_W);
  }

 private:
  // step() built twice: a tick without effects pays one branch for all of them.
  template <bool kEffects>
  rt::Health cycle(const rt::Tick& tick, const In& in, Out& out) noexcept;
  // Seconds since the last tick.
  double take_time(const rt::Tick& tick) noexcept;
  bool take_patch(const perception::SurfacePatch* patch) noexcept;
  bool take_surface(const SurfacePoints* surface) noexcept;
  bool take_hand(const drivers::StylusSample& stylus, const rt::Tick& tick, double dt,
                 perception::Vec3& dx_D) noexcept;
  [[nodiscard]] double look_ahead_m() noexcept;
  void end_leaving() noexcept;
  rt::Health without_sample(const rt::Tick& tick, const ModeMsg& mode, Out& out) noexcept;
  rt::Health not_finite(const rt::Tick& tick, Out& out) noexcept;
  void safe(Out& out) noexcept;
  template <bool kEffects>
  [[nodiscard]] Spring find_spring(const perception::Vec3& p_WH) noexcept;
  void observe(const rt::Tick& tick, const In& in, const perception::Vec3& p_WH, bool blending,
               HapticTelemetry& t, rt::Health& health) const noexcept;
  // What render() needs of a tick beside the spring.
  struct Motion {
    const perception::Vec3& dx_D;
    bool surface_moves = false;
    double stiffness_before_N_per_m = 0;
    double dt = 0;
  };
  template <bool kEffects>
  void render(const In& in, const Spring& spring, const Motion& motion, Out& out) noexcept;
  void report(const rt::Tick& tick, bool button, Out& out) noexcept;

  HapticConfig config_;
  double period_s_;
  double force_limit_N_;
  double device_radius_m_;
  Workspace workspace_;
  Hand hand_;
  SurfaceBlend blend_;
  Contact contact_;
  SurfaceEffects effects_;
  SurfaceLeft left_;
  ForceGain gain_;
  EnergyBooks books_;
  SlewGuard guard_;
  TouchEvents events_;
  perception::Vec3 rendered_W_ = perception::Vec3::Zero();  // proxy with friction
  rt::Time last_release_{};
  bool have_release_ = false;
  std::uint64_t state_seq_ = 0;
};

}  // namespace tasks

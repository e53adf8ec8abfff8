// Haptic rendering, 1 kHz: stylus position in, force on the hand out, in the same tick.
//
//   sense   StylusSample          from drivers/omega       outside step()
//   reads   Latest<SurfacePatch>  from tasks/fusion        retains 2; force ramps to zero
//                                                          when none is published for 100 ms
//           Latest<SurfacePoints> from tasks/fusion        method force_shading alone; the same ramp
//           Latest<ModeMsg>       from tasks/supervision
//   writes  HapticState           to tasks/fusion          every tick
//           Ring<TouchEvent>      to tasks/planning        0..4 a tick
//   act     ForceCommand          to drivers/omega         outside step()
//   budget  100 us of the 1 ms period
//
// Pipeline: position -> field (two patches, blended over one fusion period, a step of the surface
// over 1.46) -> proxy -> spring at the device -> fade and ramps -> force limit -> slew guard -> energy observer.
// Stiffness, force and energy are those at the device: F_D = K (p_WP - p_WH) / scale, turned into
// D. Frames: W world (= map), D haptic base, H stylus tip, P proxy.  SI.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "drivers/omega/haptic_device.hpp"
#include "perception/patch/surface_patch.hpp"
#include "rt/health.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/tick.hpp"
#include "tasks/contract/messages.hpp"
#include "tasks/haptic/effects.hpp"
#include "tasks/haptic/energy.hpp"
#include "tasks/haptic/field.hpp"
#include "tasks/haptic/force_shading.hpp"
#include "tasks/haptic/haptic_config.hpp"
#include "tasks/haptic/passivity.hpp"
#include "tasks/haptic/proxy.hpp"
#include "tasks/haptic/touch_rules.hpp"
#include "tasks/haptic/workspace.hpp"

namespace tasks {

// Fault ids of this task (docs/faults.md). A sample missing for less than the device's liveness is
// no fault.
inline constexpr rt::FaultId kFaultHapticNotFinite = 101;   // NaN in or out: zero force
inline constexpr rt::FaultId kFaultHapticPatchStale = 102;  // no publication for the liveness time
inline constexpr rt::FaultId kFaultHapticDeviceLost = 103;  // no stylus sample for its liveness
inline constexpr rt::FaultId kFaultHapticBadPatch = 104;    // malformed patch or ray cast refused
inline constexpr rt::FaultId kFaultHapticSurfaceStale = 105;  // no ray cast for its liveness time

// For recording and figures; not a message of another task.
struct HapticTelemetry {
  perception::Vec3 f_raw_D =
      perception::Vec3::Zero();  // spring, faded and limited, before the guard
  double step_raw_N = 0;         // |F_raw(k) - F_raw(k-1)|
  double step_N = 0;             // the same after all guards
  double penetration_m = 0;      // |p_WP - p_WH| in contact, scene metres
  double gain = 0;               // fade and ramps, 0..1
  double friction_N = 0;         // K |proxy with friction - frictionless proxy|
  double controller_N = 0;       // of the passivity controller
  double blend = 1;              // s of the running blend; 1 = settled
  double energy_J = 0;           // observer E
  double booked_J = 0;           // injections booked apart
  double credit_J = 0;           // dissipated by the device's own damping
  double patch_age_s = 0;
  double reach = 0;        // |p_DH| over the radius of the device's workspace; 1: at its edge
  std::uint32_t work = 0;  // field samples of this tick
  bool in_contact = false;
  bool guard_active = false;  // the slew guard changed the force
  bool guard_use = false;     // contact tick with |dF_raw| > K |dh| + 0.1 N
  bool limit_active = false;  // the force limit cut
  bool held = false;          // held contact frame in use
  bool unresolved = false;    // less than a voxel of solid is under the proxy or beside the hand
  bool near_edge = false;     // hand or proxy within two voxels of the window's edge
  bool stale = false;
  bool clutched = false;  // the hand in the scene stands while the device moves
  bool beyond = false;    // the hand is beyond the border: the workspace moves
  bool leaving =
      false;  // the surface under the hand went, or came too fast: the hand is being let go
};

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
    // handed in (Latest with one retained value, acquired at the latch and handed in at every step).
    const SurfacePoints* surface = nullptr;
    bool surface_stale = false;  // none was published for its liveness: the force ramps to zero
    ModeMsg mode;                // seq 0 = none yet
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
  [[nodiscard]] bool wants_patch() const noexcept { return older_ == nullptr; }

  // One cycle. No throw, lock, allocation or I/O. `out` is overwritten.
  [[nodiscard]] rt::Health step(const rt::Tick&, const In&, Out&) noexcept;

  [[nodiscard]] const ProxyState& proxy() const noexcept { return proxy_; }
  [[nodiscard]] const Field& field() const noexcept { return field_; }
  [[nodiscard]] const HapticConfig& config() const noexcept { return config_; }
  // Down to which depth a bump is felt as high as it is (effects.hpp), scene metres; infinite without bumps.
  [[nodiscard]] double texture_reach_m() const noexcept;
  [[nodiscard]] const Workspace& workspace() const noexcept { return workspace_; }
  // p_WH = X_WD * (scale * p_DH), X_WD as of the last step.
  [[nodiscard]] perception::Vec3 to_world(const perception::Vec3& p_DH) const noexcept {
    return workspace_.to_world(p_DH);
  }
  [[nodiscard]] perception::Vec3 to_device(const perception::Vec3& p_W) const noexcept {
    return workspace_.to_device(p_W);
  }

 private:
  static constexpr double kFarthestHand_m = 10.0;  // beyond it a position is no position

  // What pulls at the hand, F = K pull, scene metres.
  struct Spring {
    perception::Vec3 pull_W = perception::Vec3::Zero();
    perception::Vec3 elastic_W =
        perception::Vec3::Zero();  // without friction: the slope of the energy
    double length_m = 0;           // K length^2 / 2 is that energy
    double friction_m = 0;         // of pull_W
    bool contact = false;
  };
  // step() built twice: a tick without effects pays one branch for all of them.
  template <bool kEffects>
  rt::Health cycle(const rt::Tick& tick, const In& in, Out& out) noexcept;
  [[nodiscard]] Spring spring_of(const perception::Vec3& p_WH) noexcept;
  [[nodiscard]] perception::Vec3 viscous(const Spring& spring, HapticTelemetry& t) const noexcept;
  void follow_material(const perception::Vec3& p_WH) noexcept;
  [[nodiscard]] double reach_m(double side_N_per_m) const noexcept;
  enum class Mover : std::uint8_t {
    kHand,
    kSurface,
    kMore
  };  // what may have moved beside the hand
  void book(const Spring& spring, double to_N_per_m, Mover mover, const perception::Vec3& dx_D,
            double dt) noexcept;
  bool take_patch(const perception::SurfacePatch* patch) noexcept;
  bool take_surface(const SurfacePoints* surface) noexcept;
  void advance_blend(double dt) noexcept;
  [[nodiscard]] double look_ahead_m() noexcept;
  [[nodiscard]] Spring held_spring(const perception::Vec3& p_WH) noexcept;
  void end_leaving() noexcept;
  double advance_gain(bool ramp_down, double dt) noexcept;
  bool take_hand(const drivers::StylusSample& stylus, const rt::Tick& tick, double dt,
                 perception::Vec3& dx_D) noexcept;
  rt::Health without_sample(const rt::Tick& tick, const ModeMsg& mode, Out& out) noexcept;
  rt::Health not_finite(const rt::Tick& tick, Out& out) noexcept;
  void safe(Out& out) noexcept;
  template <bool kEffects>
  void render(const In& in, const perception::Vec3& dx_D, const Spring& spring, bool surface_moves,
              double stiffness_before, double dt, Out& out) noexcept;
  void guard_force(const perception::Vec3& f_D, const perception::Vec3& dx_D, bool clutch,
                   Out& out) noexcept;
  [[nodiscard]] double slew_limit(const perception::Vec3& change, double dh) const noexcept;
  [[nodiscard]] bool thin(const perception::Vec3& p_WH) const noexcept;
  void emit(Out& out, TouchEvent::Kind kind, const rt::Tick& tick) noexcept;
  void events(const rt::Tick& tick, bool button, Out& out) noexcept;
  void report(const rt::Tick& tick, bool button, Out& out) noexcept;

  HapticConfig config_;
  ProxyConfig proxy_config_;
  ProxyStep proxy_step_;
  double period_s_;
  double force_limit_N_;
  double device_radius_m_;
  Workspace workspace_;

  // The surface as the effects have it, this tick.
  bool effects_ = false;
  Surface surface_;
  TouchRules::Side side_;  // how stiff a bump may be along the surface
  perception::Vec3 rendered_W_ = perception::Vec3::Zero();  // proxy with friction
  perception::Vec3 rested_W_ = perception::Vec3::Zero();    // where the proxy was last tick
  double stiffness_ = 0;                                    // K of this tick

  Field field_;
  ProxyState proxy_;
  EnergyObserver energy_;
  PassivityController passivity_;
  const perception::SurfacePatch* older_ = nullptr;  // non-null while blending
  const perception::SurfacePatch* newer_ = nullptr;
  double blend_ = 1;
  double blend_time_ = 1;  // 0 to 1, what the blend's share is made of
  bool steps_ = false;     // this blend is a step of the surface
  double rise_N_ = 0;      // what this blend adds to the force on a hand that stands

  // The surface went from under the hand, or came at it too fast to be followed: the last contact plane is kept, and fades.
  bool leaving_ = false, left_ = false;  // left_: to be told in this tick
  perception::Vec3 left_p_W_ = perception::Vec3::Zero(), left_n_W_ = perception::Vec3::Zero();

  bool blend_allowed_ = true;  // false: what older_ would be is no longer retained

  bool have_hand_ = false, seen_hand_ = false;
  perception::Vec3 h_D_ = perception::Vec3::Zero();  // last sample
  rt::Time hand_time_{};
  perception::Vec3 v_D_ = perception::Vec3::Zero();
  perception::Vec3 f_raw_D_ = perception::Vec3::Zero();      // of the last tick
  perception::Vec3 f_elastic_D_ = perception::Vec3::Zero();  // the spring's part of it
  perception::Vec3 f_D_ = perception::Vec3::Zero();
  double credit_N_s_per_m_ = 0;
  double fade_ = 0, ramp_ = 0;
  double spring_J_ = 0;  // energy in the spring last tick
  bool enabled_ = false;
  bool was_contact_ = false, was_button_ = false, marking_ = false;
  perception::Vec3 mark_p_W_ = perception::Vec3::Zero(), mark_begin_W_ = perception::Vec3::Zero();
  rt::Time mark_time_{};
  rt::Time last_release_{};
  bool have_release_ = false;
  std::uint64_t state_seq_ = 0, event_seq_ = 0, mark_seq_ = 0;
};

}  // namespace tasks
